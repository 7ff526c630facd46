"""What the learned energy of contact reads of the contact forces: how wide a dent is, and how many there are.

The energy W [J] of mechanics knows how large a dent is. How wide it is shows in the pressures p_j [N] of its points.
Contacts that lie apart, of several colliders or of one that several fingers hold, are dents of their own: each is as
wide, and hardens, by itself. So pressures of one collider are compared with those near them, with weights by the
distance of their points at rest,

    K_jk = exp -|X_j - X_k|^2 / 2 reach^2,    0 for two colliders,    Q = sum_jk p_j p_k K_jk,

and with those nearer still, Q' = sum_jk p_j p_k K'_jk, the same with half the reach. With P = sum_j p_j,

    omega = log(Q / Q'),    nu = log(P^2 / Q).

omega is 0 for a point, and grows with the width of a dent; it is that of each dent where they lie apart. nu is the
logarithm of the number of dents: 0 for one that is much smaller than the reach, log n for n like it far apart.

No direction is in these, so that rotating the body with all colliders changes nothing, and rotating one with its forces
changes nothing of its own. They are smooth functions of the pressures. That matters as much as what they tell: the
energy pushes with their derivatives, too. How far the forces turn away from each other, and which share sharp points of
the collider bear, tell a little more of a still contact, and leap as an edge passes a contact point.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.compiled import compiled
from softprint.runtime.contact.linearised.linearised_contact import LinearisedContact


class Pairs(NamedTuple):
    """Pressures of k points compared with those near them. near: K (k, k); sums: K p (k,) [N]; total: Q [N^2]."""

    near: Array
    sums: Array
    total: float

    @property
    def slope(self) -> Array:
        """dlog Q/dp (k,) [1/N]."""
        return np.asarray(2.0 * self.sums / self.total)

    def curvature(self, one: Array, other: Array) -> Array:
        """d2log Q (n, n') along changes of the pressures (k, n) and (k, n')."""
        twice = 2.0 / self.total * (one.T @ (self.near.astype(other.dtype) @ other))
        return np.asarray(twice - np.outer(self.slope @ one, self.slope @ other))


class DentShape(NamedTuple):
    """How the dents of k active points are shaped. wide, narrow: pairs within the reach, and within half of it; total:
    P [N]; steepness: -dp/dy (k, dim) [N/m] of the pressures by the deformed positions."""

    wide: Pairs
    narrow: Pairs
    total: float
    steepness: Array

    @classmethod
    def of(cls, contact: LinearisedContact, reach: float) -> DentShape:
        """Of a contact with active points; reach: [m]."""
        solved, solution = contact.solved, contact.solved.solution
        b = solution.active
        p, e, g = solution.pressure[b], solution.penetration[b], solution.normal[b]
        compared = pairs(p, contact.points.rest(solved.active), solved.owner[b], reach)
        # The penalty law is p ~ e^2.
        steepness = (2.0 * p / e)[:, None] * g
        return cls(Pairs(*compared[:3]), Pairs(*compared[3:]), float(p.sum()), steepness)

    @property
    def values(self) -> Array:
        """(omega, nu)."""
        P, Q, close = self.total, self.wide.total, self.narrow.total
        return np.log([Q / close, P**2 / Q])

    @property
    def by_pressure(self) -> Array:
        """Derivatives of (omega, nu) by the pressures (k, 2) [1/N]."""
        wide = self.wide.slope
        return np.stack([wide - self.narrow.slope, 2.0 / self.total - wide], axis=1)

    @property
    def slopes(self) -> Array:
        """a (k, dim, 2) [1/m]: (omega, nu) change by -sum_j a_j . dy_j with the deformed positions y."""
        return np.asarray(self.steepness[:, :, None] * self.by_pressure[:, None, :])

    def curvature(self, weights: Array, one: Array, other: Array) -> Array:
        """Second derivative (n, n') of w . (omega, nu) along changes of the pressures (k, n) and (k, n')."""
        by_width, by_number = weights
        found = (by_width - by_number) * self.wide.curvature(one, other)
        found -= by_width * self.narrow.curvature(one, other)
        return np.asarray(
            found - 2.0 * by_number / self.total**2 * np.outer(one.sum(axis=0), other.sum(axis=0))
        )


def spread(pressure: Array, rest: Array) -> float:
    """The RMS distance [m] of pressures (k,) at rest positions (k, dim) from their middle."""
    share = pressure / pressure.sum()
    return float(np.sqrt(share @ np.square(rest - share @ rest).sum(axis=1)))


def _pairs(
    p: Array, X: Array, owner: IntArray, reach: float
) -> tuple[Array, Array, float, Array, Array, float]:
    K = np.exp(-np.square(X[:, None] - X[None]).sum(axis=2) / (2.0 * reach**2))
    K *= owner[:, None] == owner
    close = K**4
    return K, K @ p, p @ K @ p, close, close @ p, p @ close @ p


@compiled(reference=_pairs)
def pairs(
    p: Array, X: Array, owner: IntArray, reach: float
) -> tuple[Array, Array, float, Array, Array, float]:
    """The values of `Pairs` within the reach [m], and within half of it. p (k,) [N]; X (k, dim) [m]; owner: (k,)
    numbers of colliders."""
    k, dim = X.shape
    K, close = np.empty((k, k)), np.empty((k, k))
    for j in range(k):
        for i in range(j + 1):
            square = 0.0
            for a in range(dim):
                square += (X[j, a] - X[i, a]) ** 2
            K[i, j] = K[j, i] = np.exp(-square / (2.0 * reach**2)) if owner[i] == owner[j] else 0.0
            close[i, j] = close[j, i] = K[j, i] ** 4  # half the reach
    near, nearer, Q, less = np.zeros(k), np.zeros(k), 0.0, 0.0
    for j in range(k):
        for i in range(k):
            near[j] += K[j, i] * p[i]
            nearer[j] += close[j, i] * p[i]
        Q += p[j] * near[j]
        less += p[j] * nearer[j]
    return K, near, Q, close, nearer, less
