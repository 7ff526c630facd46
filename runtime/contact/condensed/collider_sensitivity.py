"""The contact of a pressed state as a freely moving collider feels it.

A collider that moves by a twist about its centre c is the same as the body moved the other way, F included: in the
words of `equilibrium.py` and `runtime/rigid/twist.py`, with the displaced loads y and their arms a = y - c,

    dxi = -(I, E_k a),      dphi = F^T (0, E_k f),

are further columns of dxi and dphi, and as moving so is not affine in the twist, -f . d2xi adds to the Hessian what it
adds for any points at y with the gradient -f, whose motion by the rows is dx + dF v.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from runtime.arrays import Array, BoolArray
from runtime.contact.condensed.equilibrium import ContactEquilibrium
from runtime.rigid.twist import point_motion, relative_curvature, turned_along


class ColliderSensitivity:
    """Of a press in which some load bears pressure; centre: c (dim,) [m]; borne: (k,) whether a load presses on this
    collider, all of them by default. Those that press on another do not move with it."""

    def __init__(self, press: ContactEquilibrium, centre: Array, borne: BoolArray | None = None) -> None:
        self._press = press
        force = press.solution.force[press.bearing]
        self._force = force if borne is None else np.where(borne[:, None], force, 0.0)
        self._arms = press.displaced - centre
        motion = -point_motion(self._arms)
        if borne is not None:
            motion[~borne] = 0.0
        self._carried = motion.reshape(force.size, -1)

    @property
    def gradient(self) -> Array:
        """dW/dtwist (n_twist,)."""
        return -(self._force.ravel() @ self._carried)

    def blocks(self) -> tuple[Array, Array]:
        """d2W/drows dtwist (n_rows*dim, n_twist) and d2W/dtwist2 (n_twist, n_twist)."""
        press, turned, c = self._press, self._turned, self._c
        mixed = press.stiffened.T @ c - press.answer.T @ turned
        mixed -= press.carried.T @ self._turned_force
        own = c.T @ press.factor.stiffen(c) - turned.T @ press.factor.given(turned)
        return mixed, own + relative_curvature(self._arms, -self._force)

    def link(self, other: ColliderSensitivity) -> Array:
        """d2W/dtwist dtwist' (n_twist, n_twist) with the twist of another collider on the same press: what one feels of
        the other through the body."""
        factor = self._press.factor
        return np.asarray(self._c.T @ factor.stiffen(other._c) - self._turned.T @ factor.given(other._turned))

    @cached_property
    def _c(self) -> Array:
        """c (k*dim, n_twist)."""
        factor = self._press.factor
        return self._carried + factor.carried(factor.given(self._turned))

    @cached_property
    def _turned_force(self) -> Array:
        """(0, E_k f) (k*dim, n_twist)."""
        return np.asarray(turned_along(self._force).reshape(self._force.size, -1))

    @cached_property
    def _turned(self) -> Array:
        """dphi (k*dim, n_twist)."""
        return self._press.factor.carried_back(self._turned_force)
