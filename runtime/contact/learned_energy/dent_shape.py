"""What the learned energy of contact reads of the contact forces: how a dent is borne, how steep it is, and how many
dents there are.

The energy W [J] of mechanics knows how large a dent is. How steep it is shows in the contact forces f_j = p_j g_j [N]:
where the surface wraps around a tip they turn away from each other. Contacts that lie apart, of several colliders or
of one that several fingers hold, are dents of their own: each is as steep, and hardens, by itself. So forces of one
collider are compared with those near them, with weights by the distance of their points at rest,

    K_jk = exp -|X_j - X_k|^2 / 2 reach^2,    0 for two colliders,

    rho = sum_jk f_j . f_k K_jk / Q,    Q = sum_jk p_j p_k K_jk.

rho is 1 where forces are parallel within each dent, and less where they turn. With P = sum_j p_j,

    nu = log(P^2 / Q)

is the logarithm of the number of dents: 0 for one that is much smaller than the reach, log n for n like it far apart.
And where a collider is curved more finely than contact points are apart, sharp points of it press the body
(`runtime/contact/solver/pressed_points.py`): they bear the share

    psi = sum_pressed p_j / P.

No direction is in these, so that rotating the body with all colliders changes nothing, and rotating one with its forces
changes nothing of its own. They are smooth functions of the forces.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.compiled import compiled
from softprint.runtime.contact.linearised.linearised_contact import LinearisedContact


class DentShape(NamedTuple):
    """What bears the dents of k active points. values: (psi, rho, nu); slopes: omega (k, dim, 3) [1/m] of each: they
    change by -sum_j omega_j . dy_j with the deformed positions y, of the penalty law p ~ e^2; near: K (k, k);
    pressure_near: K p (k,) and force_near: K f (k, dim) [N]; total: P [N]; paired: Q [N^2]."""

    values: Array
    slopes: Array
    near: Array
    pressure_near: Array
    force_near: Array
    total: float
    paired: float

    @classmethod
    def of(cls, contact: LinearisedContact, reach: float) -> DentShape:
        """Of a contact with active points; reach: [m]."""
        solved, solution = contact.solved, contact.solved.solution
        b = solution.active
        forces = solution.pressure[b], solution.penetration[b], solution.normal[b], solution.curvature[b]
        rest, bearing = contact.points.rest(solved.active), (solved.owner[b], solved.is_pressed)
        return cls(*dent_shape(*forces, rest, *bearing, reach))

    def by_pressure(self, weights: Array) -> Array:
        """sum_m w_m dm/dp (k,) [1/N] of the measures (psi, rho, nu) with the forces held, without that of psi by the
        pressure of pressed points."""
        psi, rho = self.values[:2]
        of_pairs = 2.0 * (weights[1] * rho + weights[2]) / self.paired
        return np.asarray((2.0 * weights[2] - weights[0] * psi) / self.total - of_pairs * self.pressure_near)


def spread(pressure: Array, rest: Array) -> float:
    """The RMS distance [m] of pressures (k,) at rest positions (k, dim) from their middle."""
    share = pressure / pressure.sum()
    return float(np.sqrt(share @ np.square(rest - share @ rest).sum(axis=1)))


def _dent_shape(
    p: Array, e: Array, g: Array, H: Array, X: Array, owner: IntArray, pressed: BoolArray, reach: float
) -> tuple[Array, Array, Array, Array, Array, float, float]:
    K = np.exp(-np.square(X[:, None] - X[None]).sum(axis=2) / (2.0 * reach**2))
    K *= owner[:, None] == owner
    f = p[:, None] * g
    at_p, at_f, P = K @ p, K @ f, p.sum()
    Q = p @ at_p
    psi, rho, nu = p[pressed].sum() / P, (f * at_f).sum() / Q, np.log(P**2 / Q)
    stiff = (2.0 * p / e)[:, None] * g
    turned = p[:, None] * np.einsum("kab,kb->ka", H, at_f)
    of_psi = stiff * ((pressed - psi) / P)[:, None]
    of_rho = 2.0 / Q * (stiff * ((g * at_f).sum(axis=1) - rho * at_p)[:, None] - turned)
    of_nu = stiff * (2.0 / P - 2.0 * at_p / Q)[:, None]
    return np.array([psi, rho, nu]), np.stack([of_psi, of_rho, of_nu], axis=2), K, at_p, at_f, P, Q


@compiled(reference=_dent_shape)
def dent_shape(
    p: Array, e: Array, g: Array, H: Array, X: Array, owner: IntArray, pressed: BoolArray, reach: float
) -> tuple[Array, Array, Array, Array, Array, float, float]:
    """The values of `DentShape`. p [N], e [m]: (k,); g (k, dim), H (k, dim, dim) [1/m]: derivatives of the distance; X
    (k, dim) [m]; owner: (k,) numbers of colliders; pressed: (k,) by sharp points; reach: [m]."""
    k, dim = g.shape
    K, at_p, at_f = np.empty((k, k)), np.zeros(k), np.zeros((k, dim))
    values, slopes = np.zeros(3), np.empty((k, dim, 3))
    P = Q = S = 0.0
    for j in range(k):
        for i in range(j + 1):
            square = 0.0
            for a in range(dim):
                square += (X[j, a] - X[i, a]) ** 2
            K[i, j] = K[j, i] = np.exp(-square / (2.0 * reach**2)) if owner[i] == owner[j] else 0.0
    for j in range(k):
        P += p[j]
        values[0] += p[j] if pressed[j] else 0.0
        for i in range(k):
            push = K[j, i] * p[i]
            at_p[j] += push
            for a in range(dim):
                at_f[j, a] += push * g[i, a]
        Q += p[j] * at_p[j]
        for a in range(dim):
            S += p[j] * g[j, a] * at_f[j, a]
    values[0], values[1], values[2] = values[0] / P, S / Q, np.log(P**2 / Q)
    for j in range(k):
        along, stiff = 0.0, 2.0 * p[j] / e[j]
        for a in range(dim):
            along += g[j, a] * at_f[j, a]
        for a in range(dim):
            turned = 0.0
            for b in range(dim):
                turned += H[j, a, b] * at_f[j, b]
            push = stiff * g[j, a]
            slopes[j, a, 0] = push * ((1.0 if pressed[j] else 0.0) - values[0]) / P
            slopes[j, a, 1] = 2.0 / Q * (push * (along - values[1] * at_p[j]) - p[j] * turned)
            slopes[j, a, 2] = push * (2.0 / P - 2.0 * at_p[j] / Q)
    return values, slopes, K, at_p, at_f, P, Q
