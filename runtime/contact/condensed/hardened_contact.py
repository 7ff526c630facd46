"""A contact under the learned energy: the exact gradient of W~(W, phi, rho), forces at points, and the Hessian.

W has derivatives from one contact solve (`linearised_contact.py`), and so have the measures phi and rho of the contact
forces (`runtime/contact/solver/dent_network.py`). Where a measure changes by -omega . dy with the deformed positions,
and as dy = (I + G_w D)^-1 c in the symbols of `linearised_contact.py`, it changes by

    -lambda . dxi - nu . dphi,    lambda = omega - D (I + G_w D)^-1 G_w omega,    nu = G A^T lambda,

with dphi the change of rest forces. So W~ pushes the body with the forces W~_W f_j + lambda_j where W pushes it with
f_j, and by moments A nu x f: forces and moments on body and collider balance. In l = (log W, phi, rho),

    dW~ = W~_l . dl,    d2W~ = dl . W~_ll dl + W~_l . d2l,

where d2l is exact for log W and left out for the others, as it would need third derivatives of the distance: only the
direction of a Newton step depends on it.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol, Self, TypeVar

import numpy as np

from softprint.runtime.arrays import Array, BoolArray
from softprint.runtime.contact.condensed.learned_energy import LearnedEnergy
from softprint.runtime.contact.condensed.linearised_contact import LinearisedContact
from softprint.runtime.contact.solver.dent_network import dent_measures, measure_slopes
from softprint.runtime.lazy import lazy


class PointForces(NamedTuple):
    """What pushes the body at k active points. pressure: p~ (k,) [N] along the normals; across: (k, dim) [N] across
    them, None for nothing; lever: (k, dim) [m], by which pressures act beside the deformed positions, or 0.0."""

    pressure: Array
    across: Array | None = None
    lever: Array | float = 0.0

    def among(self, which: BoolArray) -> PointForces:
        """Those of some of the points (k,)."""
        if self.across is None or not isinstance(self.lever, np.ndarray):
            return PointForces(self.pressure[which])
        return PointForces(self.pressure[which], self.across[which], self.lever[which])


class Sensitivity(Protocol):
    """What moving one collider does to the energy of mechanics: `ColliderSensitivity`."""

    @property
    def gradient(self) -> Array: ...
    def along(self, forces: Array, moved: Array, /) -> Array: ...
    def blocks(self) -> tuple[Array, Array]: ...
    def link(self, other: Self, /) -> Array: ...


SensitivityT = TypeVar("SensitivityT", bound=Sensitivity)


class HardenedContact:
    """The learned energy of a contact with active points."""

    def __init__(self, contact: LinearisedContact, learned: LearnedEnergy) -> None:
        self._contact, self._learned = contact, learned
        measures = dent_measures(contact.solved)
        self._mechanics = measures[0]
        self._terms = learned.terms(measures)

    @property
    def energy(self) -> float:
        """W~ [J]."""
        return self._terms.value

    @property
    def gradient(self) -> Array:
        """dW~/drows (n_rows, dim) [N]."""
        contact = self._contact
        found = self._stiffened * contact.gradient
        if self._response is None:
            return np.asarray(found)
        return np.asarray(found + (self._row_slopes[:, 1:] @ self._terms.slope[1:]).reshape(found.shape))

    def hessian(self, along: Array | None = None) -> Array:
        """d2W~/drows2, see `RowHessian`."""
        slopes = self._row_slopes if along is None else along.T @ self._row_slopes
        second = self._stiffened * self._contact.hessian(along)
        return np.asarray(second + slopes @ self._outer @ slopes.T)

    def twist_gradient(self, own: Sensitivity) -> Array:
        """dW~/dtwist (n_twist,) of a collider."""
        return np.asarray(self._twist_slopes(own) @ self._terms.slope)

    def blocks(self, own: Sensitivity) -> tuple[Array, Array]:
        """See `ColliderSensitivity`."""
        (mixed, twice), slopes = own.blocks(), self._twist_slopes(own)
        mixed = self._stiffened * mixed + self._row_slopes @ self._outer @ slopes.T
        return mixed, self._stiffened * twice + slopes @ self._outer @ slopes.T

    def link(self, one: SensitivityT, other: SensitivityT) -> Array:
        """See `ColliderSensitivity`."""
        outer = self._twist_slopes(one) @ self._outer @ self._twist_slopes(other).T
        return np.asarray(self._stiffened * one.link(other) + outer)

    @lazy
    def point_forces(self) -> PointForces:
        """See `PointForces`."""
        solution = self._contact.solved.solution
        b = solution.active
        f, p, g = solution.force[b], solution.pressure[b], solution.normal[b]
        slope = self._stiffened
        if self._response is None:
            return PointForces(slope * p)
        weights = self._terms.slope[1:]
        more, moved = ((part @ weights).reshape(f.shape) for part in self._response)
        along = (more * g).sum(axis=1) / (g * g).sum(axis=1)
        pressure = slope * p + along
        lever = self._contact.factor.to_world(moved.reshape(-1, 1)).reshape(f.shape) * p[:, None]
        # Where a pressure vanishes, so does its moment: a point that is about to leave.
        return PointForces(pressure, more - along[:, None] * g, _divided(lever, pressure))

    @lazy
    def _response(self) -> tuple[Array, Array] | None:
        """lambda and nu (k*dim, 2) of phi and rho; None without a network."""
        return None if self._learned.network is None else measure_response(self._contact)

    @lazy
    def _row_slopes(self) -> Array:
        """dl (R, n) of the measures that the energy depends on, by the rows."""
        return dent_slopes(self._contact, self._response)

    def _twist_slopes(self, own: Sensitivity) -> Array:
        """dl (n_twist, n) by the motion of a collider."""
        by_energy = own.gradient[:, None] / self._mechanics
        return by_energy if self._response is None else np.hstack([by_energy, own.along(*self._response)])

    @property
    def _stiffened(self) -> float:
        """What d2W is multiplied by."""
        return float(self._terms.slope[0] / self._mechanics)

    @lazy
    def _outer(self) -> Array:
        """(n, n) what multiplies products of dl."""
        outer = self._terms.curvature.copy()
        outer[0, 0] -= self._terms.slope[0]
        return outer


def measure_response(contact: LinearisedContact) -> tuple[Array, Array]:
    """lambda and nu (k*dim, 2) of phi and rho of a contact with active points."""
    factor, omega = contact.factor, measure_slopes(contact.solved)
    omega = omega.reshape(-1, omega.shape[2])
    given_way = factor.to_world(factor.rest_displacement(factor.to_rest(omega)))
    forces = omega - factor.effective_stiffness(given_way)
    return forces, np.asarray(factor.rest_displacement(factor.to_rest(forces)), dtype=np.float64)


def dent_slopes(contact: LinearisedContact, response: tuple[Array, Array] | None) -> Array:
    """dl/drows (R, N_MEASURES) of a contact with active points; (R, 1) of log W alone without a response."""
    by_energy = contact.gradient.reshape(-1, 1) / contact.solved.solution.energy
    if response is None:
        return by_energy
    forces, moved = response
    found = contact.position_jacobian.T @ forces + contact.force_jacobian.T @ moved
    return np.hstack([by_energy, -found])


def _divided(moments: Array, pressure: Array) -> Array:
    """Moments (k, dim) by pressures (k,), none for none."""
    return np.divide(moments, pressure[:, None], out=np.zeros_like(moments), where=pressure[:, None] != 0.0)
