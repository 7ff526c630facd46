"""Derivatives of the energy of a solved contact by the motion of a free collider.

Moving a collider by a twist about its centre c is equivalent to moving the body, F included, by the inverse motion. In
the symbols of `linearised_contact.py` and `runtime/rigid/twist.py`, with the deformed positions y and their arms
a = y - c, a twist adds the columns

    dxi = -(I, E_k a),      dphi = F^T (0, E_k f)

to the position and force Jacobians. This motion is not affine in the twist, so that -f . d2xi contributes to the
Hessian as well: the same contribution as for any points at y with the gradient -f that move by dx + dF v with the rows.
"""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array, BoolArray
from softprint.runtime.contact.condensed.linearised_contact import LinearisedContact
from softprint.runtime.lazy import lazy
from softprint.runtime.rigid.twist import point_motion, relative_curvature, rotation_derivatives


class ColliderSensitivity:
    """The derivatives for one collider. contact: one with active points; centre: c (dim,) [m]; owned: (k,) which of the
    active points touch this collider. Points that touch another collider do not move with this one."""

    def __init__(self, contact: LinearisedContact, centre: Array, owned: BoolArray) -> None:
        self._contact = contact
        solved = contact.solved
        b = solved.solution.active
        self._force = np.where(owned[:, None], solved.solution.force[b], 0.0)
        self._arms = solved.deformed_position[b] - centre
        motion = -point_motion(self._arms)
        motion[~owned] = 0.0
        self._position_jacobian = motion.reshape(self._force.size, -1)

    @property
    def gradient(self) -> Array:
        """dW/dtwist (n_twist,)."""
        return -(self._force.ravel() @ self._position_jacobian)

    def along(self, forces: Array, moved: Array) -> Array:
        """(n_twist, n) of -lambda . dxi - nu . dphi, for lambda and nu (k*dim, n) of `hardened_contact.py`."""
        return np.asarray(-(self._position_jacobian.T @ forces + self._force_jacobian.T @ moved))

    def blocks(self) -> tuple[Array, Array]:
        """d2W/drows dtwist (n_rows*dim, n_twist) and d2W/dtwist2 (n_twist, n_twist)."""
        contact, by_force, c = self._contact, self._force_jacobian, self._c
        mixed = contact.force_response.T @ c - contact.displacement_jacobian.T @ by_force
        mixed -= contact.position_jacobian.T @ self._rotated_force
        factor = contact.factor
        own = c.T @ factor.effective_stiffness(c) - by_force.T @ factor.rest_displacement(by_force)
        return mixed, own + relative_curvature(self._arms, -self._force)

    def link(self, other: ColliderSensitivity) -> Array:
        """d2W/dtwist dtwist' (n_twist, n_twist) with the twist of another collider in the same contact: the coupling of
        the two colliders through the body."""
        factor = self._contact.factor
        return np.asarray(
            self._c.T @ factor.effective_stiffness(other._c)
            - self._force_jacobian.T @ factor.rest_displacement(other._force_jacobian)
        )

    @lazy
    def _c(self) -> Array:
        """c (k*dim, n_twist)."""
        factor = self._contact.factor
        return self._position_jacobian + factor.to_world(factor.rest_displacement(self._force_jacobian))

    @lazy
    def _rotated_force(self) -> Array:
        """(0, E_k f) (k*dim, n_twist)."""
        return np.asarray(rotation_derivatives(self._force).reshape(self._force.size, -1))

    @lazy
    def _force_jacobian(self) -> Array:
        """dphi (k*dim, n_twist)."""
        return self._contact.factor.to_rest(self._rotated_force)
