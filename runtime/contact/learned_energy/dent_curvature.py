"""Second derivatives of the energies of the dent of a solved contact, times their shares.

The energies M (`runtime/contact/dents/dent_energies.py`) are functions of the contact forces phi in rest coordinates
and of the strain E of the body. With lambda and mu as in `hardened_contact.py`, and in the symbols of
`runtime/contact/linearised/contact_motions.py`, for two motions

    d2M = d(phi, E) . M_zz d(phi, E)' + dy . C dy'
          - [dA^T lambda . dv' + dA mu . df' + the same with the motions exchanged] - lambda . d2A v - f . d2A mu,

with dphi the whole change of the forces; M_E . d2E is not here. At every point, for a fixed vector t = -A mu,

    C = Hess(f . t) = p'' (t . g) g g^T - p' ((t . g) H + g (H t)^T + (H t) g^T) + p t . d3s,

p' = 2 p / e and p'' = 2 p / e^2: the penalty law is p ~ e^2.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.contact.dents.dent_energies import DentChange, DentEnergies
from softprint.runtime.contact.dents.prestrain import StrainMotions
from softprint.runtime.contact.linearised.collider_sensitivity import ColliderSensitivity
from softprint.runtime.contact.linearised.contact_motions import ContactMotions
from softprint.runtime.contact.linearised.linearised_contact import LinearisedContact
from softprint.runtime.contact.solver.contact_point_kernels import blocks_to_world
from softprint.runtime.linalg.sparse_directions import times_directions


class DentMotions(NamedTuple):
    """n motions, and what they change. carried: dA mu, pulled_back: dA^T lambda, and forces: df (k*dim, n); dent: the
    whole of dphi, and dE."""

    motions: ContactMotions
    carried: Array
    pulled_back: Array
    forces: Array
    dent: DentChange


class DentCurvature:
    """share . d2(W_2, W_3, W_4, W_E) of a contact with active points. share: (4,); response: lambda and mu (k, dim), of
    the same shares."""

    def __init__(
        self,
        contact: LinearisedContact,
        response: tuple[Array, Array],
        share: Array,
        dent: DentEnergies,
    ) -> None:
        factor, solution = contact.factor, contact.solved.solution
        b = solution.active
        p, e, g, H = solution.pressure[b], solution.penetration[b], solution.normal[b], solution.curvature[b]
        self._contact, self._share, self._dent = contact, share, dent
        self._forces, self._at_rest = response
        self._moved = factor.to_world(self._at_rest.reshape(-1, 1)).reshape(g.shape)
        self._curvature = _force_curvature(p, e, g, _symmetric(H), -self._moved)
        self._curvature -= p[:, None, None] * _symmetric(contact.curvature_change(self._moved))

    @property
    def moments(self) -> Array:
        """lambda (x) v + f (x) mu (k, dim, dim)."""
        found = self._forces[:, :, None] * self._contact.carried[:, None, :]
        return np.asarray(found + self._contact.force[:, :, None] * self._at_rest[:, None, :])

    def by_rows(
        self, motions: ContactMotions, strains: StrainMotions, along: Array | None = None
    ) -> DentMotions:
        """By the rows, along the same directions as the motions; along: see `RowHessian`."""
        carried, pulled_back = self._contact.carrier_motion(self._forces, self._at_rest)
        if along is not None:
            kind = motions.position.dtype
            carried = times_directions(carried.astype(kind), along)
            pulled_back = times_directions(pulled_back.astype(kind), along)
        return self._measured(motions, carried, pulled_back, strains.strain)

    def by_twist(self, own: ColliderSensitivity) -> DentMotions:
        """By the twist of a collider."""
        pulled_back = self._contact.factor.to_rest(own.rotated(self._forces))
        return self._measured(own.motions, -own.rotated(self._moved), pulled_back)

    def _measured(
        self, motions: ContactMotions, carried: Array, pulled_back: Array, strain: Array | None = None
    ) -> DentMotions:
        forces = -motions.reaction
        rest_forces = np.asarray(motions.force + self._contact.factor.to_rest(forces), dtype=np.float64)
        return DentMotions(motions, carried, pulled_back, forces, DentChange(rest_forces, strain))

    def mixed(self, rows: DentMotions, own: ColliderSensitivity, twist: DentMotions) -> Array:
        """d2M/drows dtwist (R, n_twist)."""
        found = self.between(rows, twist) - rows.motions.position.T @ own.rotated(self._forces)
        return np.asarray(found - rows.carried.T @ own.rotated(self._contact.force))

    def twice(self, own: ColliderSensitivity, twist: DentMotions) -> Array:
        """d2M/dtwist2 (n_twist, n_twist)."""
        found = self.between(twist, twist) + own.curvature(own.arms, -self._forces)
        return np.asarray(found + own.turned_curvature(self._moved, -self._contact.force))

    def between(self, one: DentMotions, other: DentMotions) -> Array:
        """(n, n'), without the second derivatives of A."""
        bent = blocks_to_world(self._curvature, other.motions.deformed)
        crossed = _crossed(one, other)
        crossed = crossed + (crossed.T if one is other else _crossed(other, one).T)
        by_dent = self._dent.curvature(self._share, one.dent, other.dent)
        return np.asarray(one.motions.deformed.T @ bent + crossed + by_dent)


def _crossed(one: DentMotions, other: DentMotions) -> Array:
    """-dA^T lambda . dv' - dA mu . df' (n, n')."""
    return np.asarray(-one.carried.T @ other.forces - one.pulled_back.T @ other.motions.displaced)


def _force_curvature(p: Array, e: Array, g: Array, H: Array, t: Array) -> Array:
    """C (k, dim, dim) but its last term, see the module."""
    along, turned = (g * t).sum(axis=1), np.matmul(H, t[..., None])[..., 0]
    first, second = 2.0 * p / e, 2.0 * p / e**2
    crossed = g[:, :, None] * turned[:, None, :]
    found = (second * along)[:, None, None] * g[:, :, None] * g[:, None, :]
    found -= (first * along)[:, None, None] * H
    return np.asarray(found - first[:, None, None] * (crossed + crossed.transpose(0, 2, 1)))


def _symmetric(H: Array) -> Array:
    return 0.5 * (H + H.transpose(0, 2, 1))
