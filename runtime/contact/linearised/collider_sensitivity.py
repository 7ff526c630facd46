"""Derivatives of the energy of a solved contact by the motion of a free collider.

Moving a collider by a twist about its centre c is equivalent to moving the body, carriers A included, by the inverse
motion. In the symbols of `linearised_contact.py` and `runtime/rigid/twist.py`, with the deformed positions y and their
arms a = y - c, a twist adds the columns

    dxi = -(I, E_k a),      dphi = A^T (0, E_k f)

to the position and force Jacobians. This motion is not affine in the twist, so that -f . d2xi contributes to the
Hessian as well: the same contribution as for any points at y with the gradient -f that move by dx + dA v with the rows.
"""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array, BoolArray
from softprint.runtime.contact.linearised.contact_motions import ContactMotions
from softprint.runtime.contact.linearised.linearised_contact import LinearisedContact
from softprint.runtime.rigid.twist import (
    own_curvature,
    point_motion,
    relative_curvature,
    rotation_derivatives,
)


class ColliderSensitivity:
    """The derivatives for one collider. contact: one with active points; centre: c (dim,) [m]; owned: (k,) which of the
    active points touch this collider. Points that touch another collider do not move with this one.

    arms: a (k, dim) [m]; motions: by the twist, n_twist of them."""

    def __init__(self, contact: LinearisedContact, centre: Array, owned: BoolArray) -> None:
        self._contact, self._owned = contact, owned
        solved = contact.solved
        self._force = solved.solution.force[solved.solution.active]
        self.arms = solved.deformed_position[solved.solution.active] - centre
        position = -self._mine(point_motion(self.arms))
        self.motions = ContactMotions(
            contact.factor, position, contact.factor.to_rest(self.rotated(self._force))
        )

    @property
    def gradient(self) -> Array:
        """dW/dtwist (n_twist,)."""
        return -(self._force.ravel() @ self.motions.position)

    def blocks(self) -> tuple[Array, Array]:
        """d2W/drows dtwist (n_rows*dim, n_twist) and d2W/dtwist2 (n_twist, n_twist)."""
        by_rows, force = self._contact.motions, self._force
        mixed = by_rows.second(self.motions) - by_rows.position.T @ self.rotated(force)
        return mixed, self.motions.second(self.motions) + self.curvature(self.arms, -force)

    def link(self, other: ColliderSensitivity) -> Array:
        """d2W/dtwist dtwist' (n_twist, n_twist) with the twist of another collider in the same contact: the coupling of
        the two colliders through the body."""
        return np.asarray(self.motions.second(other.motions))

    def rotated(self, vectors: Array) -> Array:
        """(0, E_k v) (k*dim, n_twist) of vectors (k, dim) at the points of this collider, zero at others."""
        return self._mine(rotation_derivatives(vectors))

    def curvature(self, arms: Array, gradient: Array) -> Array:
        """The second derivative (n_twist, n_twist) by the twist of sum g . x at points of this collider, at arms a and
        with gradients g (k, dim)."""
        return relative_curvature(arms, np.where(self._owned[:, None], gradient, 0.0))

    def turned_curvature(self, vectors: Array, gradient: Array) -> Array:
        """The same of vectors that the twist only turns."""
        return own_curvature(vectors, np.where(self._owned[:, None], gradient, 0.0))

    def _mine(self, motion: Array) -> Array:
        """(k*dim, n_twist) of (k, dim, n_twist), zero at points of other colliders."""
        return np.where(self._owned[:, None, None], motion, 0.0).reshape(self._force.size, -1)
