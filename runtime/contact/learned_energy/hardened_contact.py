"""A contact under the learned energy W~(W, W_2, W_3, W_4, W_E): exact gradient, forces at points, and the Hessian.

W has derivatives from one contact solve (`runtime/contact/linearised/`), and so have the energies of the dent, W_2 to
W_4 and W_E (`runtime/contact/dents/dent_energies.py`), by the contact forces. With w = dM/dphi the derivative of one of
them by the forces in rest coordinates, and in the symbols of `linearised_contact.py`, it changes by w . (dphi + A^T
df):

    -lambda . dxi - mu . dphi,    lambda = D (I + G_w D)^-1 A w,    mu = G A^T lambda - w,

and W_E by dW_E/dE : dE, too, with the strain of the body. So W~ pushes the body with the forces W~_W f_j + lambda_j
where W pushes it with f_j, by moments A mu x f, and by stresses dW_E/dE in its cells: forces and moments on body and
collider balance. In l = (log W, W_2, W_3, W_4, W_E),

    dW~ = W~_l . dl,    d2W~ = dl . W~_ll dl + W~_l . d2l,

with d2 of the energies of the dent in `dent_curvature.py`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, BoolArray
from softprint.runtime.contact.dents.dent_energies import DentEnergies
from softprint.runtime.contact.learned_energy.dent_curvature import DentCurvature
from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy
from softprint.runtime.contact.linearised.collider_sensitivity import ColliderSensitivity
from softprint.runtime.contact.linearised.contact_motions import ContactMotions
from softprint.runtime.contact.linearised.linearised_contact import LinearisedContact
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


class HardenedContact:
    """The learned energy of a contact with active points, with the energies of its dent."""

    def __init__(self, contact: LinearisedContact, learned: LearnedEnergy, dent: DentEnergies) -> None:
        self._contact, self._mechanics, self._dent = contact, contact.solved.solution.energy, dent
        self._terms = learned.terms(self._mechanics, dent.values)

    @property
    def energy(self) -> float:
        """W~ [J]."""
        return self._terms.value

    @property
    def gradient(self) -> Array:
        """dW~/drows (n_rows, dim) [N]."""
        forces, moved = self._weighted_response
        by_points = self._contact.work(self._stiffened * self._contact.force + forces, moved)
        return self._dent.prestrain.pulled_back(self._stresses) - by_points

    def hessian(self, along: Array | None = None) -> Array:
        """d2W~/drows2, see `RowHessian`."""
        contact, of_dent = self._contact, self._curvature
        motions, slopes = contact.motions.along(along), self._row_slopes
        slopes = slopes if along is None else along.T @ slopes
        found = self._stiffened * motions.second(motions) + slopes @ self._outer @ slopes.T
        strains = self._dent.prestrain.motions(along)
        rows = of_dent.by_rows(motions, strains, along)
        found = found + of_dent.between(rows, rows) + strains.bending(self._stresses)
        forces = self._stiffened * contact.force + self._weighted_response[0]
        moments = self._stiffened * contact.moments + of_dent.moments
        return np.asarray(found - contact.bending(forces, moments, along))

    def twist_gradient(self, own: ColliderSensitivity) -> Array:
        """dW~/dtwist (n_twist,) of a collider."""
        return np.asarray(self._twist_slopes(own) @ self._terms.slope)

    def blocks(self, own: ColliderSensitivity) -> tuple[Array, Array]:
        """See `ColliderSensitivity`."""
        (mixed, twice), slopes = own.blocks(), self._twist_slopes(own)
        mixed = self._stiffened * mixed + self._row_slopes @ self._outer @ slopes.T
        twice = self._stiffened * twice + slopes @ self._outer @ slopes.T
        of_dent = self._curvature
        strains, twist = self._dent.prestrain.motions(), of_dent.by_twist(own)
        rows = of_dent.by_rows(self._contact.motions, strains)
        return mixed + of_dent.mixed(rows, own, twist), twice + of_dent.twice(own, twist)

    def link(self, one: ColliderSensitivity, other: ColliderSensitivity) -> Array:
        """See `ColliderSensitivity`."""
        outer = self._twist_slopes(one) @ self._outer @ self._twist_slopes(other).T
        twists = (self._curvature.by_twist(of) for of in (one, other))
        return np.asarray(self._stiffened * one.link(other) + outer + self._curvature.between(*twists))

    @lazy
    def point_forces(self) -> PointForces:
        """See `PointForces`."""
        solution = self._contact.solved.solution
        b = solution.active
        f, p, g = solution.force[b], solution.pressure[b], solution.normal[b]
        more, at_rest = self._weighted_response
        moved = self._contact.factor.to_world(at_rest.reshape(-1, 1)).reshape(f.shape)
        along = (more * g).sum(axis=1) / (g * g).sum(axis=1)
        pressure = self._stiffened * p + along
        lever = moved * p[:, None]
        # Where a pressure vanishes, so does its moment: a point that is about to leave.
        return PointForces(pressure, more - along[:, None] * g, _divided(lever, pressure))

    @lazy
    def _response(self) -> tuple[Array, Array]:
        """lambda and mu (k*dim, 4) of W_2, W_3, W_4 and W_E."""
        factor, slopes = self._contact.factor, self._dent.slopes
        forces = factor.effective_stiffness(factor.to_world(slopes)).astype(np.float64)
        moved = factor.rest_displacement(factor.to_rest(forces)) - slopes
        return forces, np.asarray(moved, dtype=np.float64)

    @lazy
    def _weighted_response(self) -> tuple[Array, Array]:
        """lambda and mu (k, dim), each times the derivative of W~ by that energy."""
        forces, moved = (part @ self._terms.slope[1:] for part in self._response)
        shape = self._contact.force.shape
        return forces.reshape(shape), moved.reshape(shape)

    @property
    def _stresses(self) -> Array:
        """W~_W_E dW_E/dE (n, dim^2) [J]."""
        return self._terms.slope[4] * self._dent.by_prestrain

    @lazy
    def _row_slopes(self) -> Array:
        """dl (R, 5) by the rows."""
        by_energy = self._contact.gradient.reshape(-1, 1) / self._mechanics
        by_dent = -_work(self._contact.motions, self._response)
        by_dent[:, 3] += self._dent.prestrain.pulled_back(self._dent.by_prestrain).ravel()
        return np.hstack([by_energy, by_dent])

    def _twist_slopes(self, own: ColliderSensitivity) -> Array:
        """dl (n_twist, 5) by the motion of a collider."""
        by_energy = own.gradient[:, None] / self._mechanics
        return np.hstack([by_energy, -_work(own.motions, self._response)])

    @lazy
    def _curvature(self) -> DentCurvature:
        """W~_l . d2l of the energies of the dent."""
        return DentCurvature(self._contact, self._weighted_response, self._terms.slope[1:], self._dent)

    @property
    def _stiffened(self) -> float:
        """What d2W is multiplied by."""
        return float(self._terms.slope[0] / self._mechanics)

    @lazy
    def _outer(self) -> Array:
        """(5, 5) what multiplies products of dl."""
        outer = self._terms.curvature.copy()
        outer[0, 0] -= self._terms.slope[0]
        return outer


def _work(motions: ContactMotions, response: tuple[Array, Array]) -> Array:
    """lambda . dxi + mu . dphi (n, 4) of n motions."""
    forces, moved = response
    return np.asarray(motions.position.T @ forces + motions.force.T @ moved)


def _divided(moments: Array, pressure: Array) -> Array:
    """Moments (k, dim) by pressures (k,), none for none."""
    return np.divide(moments, pressure[:, None], out=np.zeros_like(moments), where=pressure[:, None] != 0.0)
