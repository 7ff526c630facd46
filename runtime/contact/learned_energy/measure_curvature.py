"""Second derivatives of the measures psi and rho of a solved contact (`dent_network.py`).

With weights held, m = w_psi psi + w_rho rho is a function of the deformed positions y. With lambda and nu as in
`hardened_contact.py`, weighted in the same manner, and in the symbols of
`runtime/contact/linearised/contact_motions.py`, for two motions

    d2m = dy . C dy' - [dA^T lambda . dv' + dA nu . df' + the same with the motions exchanged]
          + (w_rho / P) sum_c dF_c . (I - u u^T) dF_c' / L_c - (dP dm' + dm dP') / P - lambda . d2A v - f . d2A nu,

F_c the force on a collider, L_c its length, u its direction, P the sum of pressures. At every point

    C = share Hess p + Hess(f . t),    share = (w_psi ([pressed] - psi) - w_rho rho) / P,    t = (w_rho / P) u - A nu,
    Hess p = p'' g g^T - p' H,    Hess(f . t) = p'' (t . g) g g^T - p' ((t . g) H + g (H t)^T + (H t) g^T) + p t . d3s,

for a fixed vector t, p' = 2 p / e and p'' = 2 p / e^2.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.contact.learned_energy.dent_network import DentShape
from softprint.runtime.contact.linearised.collider_sensitivity import ColliderSensitivity
from softprint.runtime.contact.linearised.contact_motions import ContactMotions
from softprint.runtime.contact.linearised.linearised_contact import LinearisedContact
from softprint.runtime.contact.solver.contact_point_kernels import blocks_to_world
from softprint.runtime.linalg.sparse_directions import times_directions


class MeasuredMotions(NamedTuple):
    """n motions, and what they change of m. carried: dA nu, pulled_back: dA^T lambda (k*dim, n); slope: dm (n,)."""

    motions: ContactMotions
    carried: Array
    pulled_back: Array
    slope: Array


class MeasureCurvature:
    """d2m of a contact with active points. response: lambda and nu (k, dim), weighted by weights (w_psi, w_rho)."""

    def __init__(
        self, contact: LinearisedContact, response: tuple[Array, Array], weights: Array, shape: DentShape
    ) -> None:
        solved, factor = contact.solved, contact.factor
        solution, b = solved.solution, solved.solution.active
        p, e, g, H = solution.pressure[b], solution.penetration[b], solution.normal[b], solution.curvature[b]
        self._contact, self._weights, self._total = contact, weights, p.sum()
        self._forces, self._at_rest = response
        self._moved = factor.to_world(self._at_rest.reshape(-1, 1)).reshape(g.shape)
        self._owner, self._shape = solved.owner[b], shape
        self._slope = (2.0 * p / e)[:, None] * g
        share = (weights[0] * (solved.is_pressed - shape.borne) - weights[1] * shape.shape) / self._total
        t = weights[1] / self._total * shape.directions[self._owner] - self._moved
        self._curvature = _force_curvature(p, e, g, _symmetric(H), share, t)
        self._curvature += p[:, None, None] * _symmetric(contact.curvature_change(t))

    @property
    def moments(self) -> Array:
        """lambda (x) v + f (x) nu (k, dim, dim)."""
        solution = self._contact.solved.solution
        found = self._forces[:, :, None] * solution.rest_displacement[solution.active][:, None, :]
        return np.asarray(found + self._contact.force[:, :, None] * self._at_rest[:, None, :])

    def by_rows(self, motions: ContactMotions, slope: Array, along: Array | None = None) -> MeasuredMotions:
        """By the rows; along: see `RowHessian`; motions, and slope: dm/drows, along the same directions."""
        carried, pulled_back = self._contact.carrier_motion(self._forces, self._at_rest)
        if along is not None:
            kind = motions.position.dtype
            carried = times_directions(carried.astype(kind), along)
            pulled_back = times_directions(pulled_back.astype(kind), along)
        return MeasuredMotions(motions, carried, pulled_back, slope)

    def by_twist(self, own: ColliderSensitivity, slope: Array) -> MeasuredMotions:
        """By the twist of a collider; slope: dm/dtwist."""
        pulled_back = self._contact.factor.to_rest(own.rotated(self._forces))
        return MeasuredMotions(own.motions, -own.rotated(self._moved), pulled_back, slope)

    def mixed(self, rows: MeasuredMotions, own: ColliderSensitivity, twist: MeasuredMotions) -> Array:
        """d2m/drows dtwist (R, n_twist)."""
        found = self.between(rows, twist) - rows.motions.position.T @ own.rotated(self._forces)
        return np.asarray(found - rows.carried.T @ own.rotated(self._contact.force))

    def twice(self, own: ColliderSensitivity, twist: MeasuredMotions) -> Array:
        """d2m/dtwist2 (n_twist, n_twist)."""
        found = self.between(twist, twist) + own.curvature(own.arms, -self._forces)
        return np.asarray(found + own.turned_curvature(self._moved, -self._contact.force))

    def between(self, one: MeasuredMotions, other: MeasuredMotions) -> Array:
        """(n, n'), without the second derivatives of A."""
        bent = blocks_to_world(self._curvature, other.motions.deformed)
        crossed = self._crossed(one, other)
        crossed += crossed.T if one is other else self._crossed(other, one).T
        return np.asarray(one.motions.deformed.T @ bent + crossed + self._by_resultants(one, other))

    def _crossed(self, one: MeasuredMotions, other: MeasuredMotions) -> Array:
        """-dA^T lambda . dv' - dA nu . df' - dm dP' / P (n, n')."""
        found = one.carried.T @ other.motions.reaction - one.pulled_back.T @ other.motions.displaced
        return np.asarray(found - np.outer(one.slope, self._pressures(other) / self._total))

    def _pressures(self, motions: MeasuredMotions) -> Array:
        """dP (n,)."""
        return np.asarray(-(self._slope.ravel() @ motions.motions.deformed))

    def _by_resultants(self, one: MeasuredMotions, other: MeasuredMotions) -> Array:
        """(w_rho / P) sum_c dF_c . (I - u u^T) dF_c' / L_c (n, n')."""
        found = np.zeros((len(one.slope), len(other.slope)))
        for number, length in enumerate(self._shape.lengths):
            if length == 0.0:
                continue
            force, force_other = (
                of.motions.reaction.reshape(*self._forces.shape, -1)[self._owner == number].sum(axis=0)
                for of in (one, other)
            )
            unit = self._shape.directions[number]
            found += force.T @ (force_other - np.outer(unit, unit @ force_other)) / length
        return self._weights[1] / self._total * found


def _force_curvature(p: Array, e: Array, g: Array, H: Array, share: Array, t: Array) -> Array:
    """C (k, dim, dim), see the module."""
    along, turned = (g * t).sum(axis=1), np.matmul(H, t[..., None])[..., 0]
    first, second = 2.0 * p / e, 2.0 * p / e**2
    crossed = g[:, :, None] * turned[:, None, :]
    found = (second * (share + along))[:, None, None] * g[:, :, None] * g[:, None, :]
    found -= (first * (share + along))[:, None, None] * H
    return np.asarray(found - first[:, None, None] * (crossed + crossed.transpose(0, 2, 1)))


def _symmetric(H: Array) -> Array:
    return 0.5 * (H + H.transpose(0, 2, 1))
