"""The contact of a pressed state as a freely moving collider feels it.

A collider that moves by a twist about its centre c is the same as the body moved the other way, F included: in the
words of `load_press.py` and `runtime/rigid/twist.py`, with the displaced loads y and their arms a = y - c,

    dxi = -(I, E_k a),      eta = (0, E_k f),

are further columns of dxi and eta, and as moving so is not affine in the twist, -f . d2xi adds to the Hessian what it
adds for any points at y with the gradient -f, whose motion by the rows is dx + dF v.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from runtime.arrays import Array
from runtime.corrections.load_press import LoadPress
from runtime.rigid.twist import point_motion, relative_curvature, turned_along


class TwistedPress:
    """Of a press in which some load bears pressure; centre: c (dim,) [m]."""

    def __init__(self, press: LoadPress, centre: Array) -> None:
        self._press = press
        b, solution = press.bearing, press.solution
        self._force = solution.force[b]
        self._arms = press.problem.position[b] + solution.moved[b] - centre
        self._carried = -point_motion(self._arms).reshape(self._force.size, -1)

    @property
    def gradient(self) -> Array:
        """dW/dtwist (n_twist,)."""
        return -(self._force.ravel() @ self._carried)

    def blocks(self) -> tuple[Array, Array]:
        """d2W/drows dtwist (n_rows*dim, n_twist) and d2W/dtwist2 (n_twist, n_twist)."""
        press, eta = self._press, self._eta
        c = self._carried + press.given(eta)
        mixed = press.stiffened.T @ c - press.given(press.eta).T @ eta
        mixed -= press.carried.T @ eta
        own = c.T @ press.stiffen(c) - eta.T @ press.given(eta)
        return mixed, own + relative_curvature(self._arms, -self._force)

    @cached_property
    def _eta(self) -> Array:
        """(0, E_k f) (k*dim, n_twist)."""
        return np.asarray(turned_along(self._force).reshape(self._force.size, -1))
