"""The excess of a dent: by how much the energy of the body for the dent of linear mechanics exceeds that which linear
mechanics has.

Where the displacement of linear mechanics is u, the body has the energy W + sum_c V_c (Psi(I + H_c) - Psi_2(H_c)), to
third order in u, with H = grad u, the energy density Psi of its material, and that of linear elasticity, Psi_2 = mu
eps:eps + lambda/2 (tr eps)^2. So this difference tells how a dent hardens, wherever it is and whatever makes it. Taken
at contact nodes i, with the forces phi_i on them as weights (`dent_strain.py`),

    chi = sum_i |phi_i|^2 sum_c V_ic (Psi - Psi_2)(H_ic) / sum_i |phi_i|^2 sum_c V_ic (Psi_2(H_ic) + 1e-8 mu),

where the last term only keeps round-off of strains below 1e-4 out. chi is a function of the contact forces in rest
coordinates: rotating the body with all colliders changes nothing. It is that of each dent where like dents lie apart. A
node that begins to bear, or ends to, changes it smoothly. With chi held in r = Psi - Psi_2 - chi (Psi_2 + 1e-8 mu), and
B the denominator,

    dchi = dR / B,    d2chi = (d2R - dchi dB - dB dchi) / B,    R = sum_i |phi_i|^2 sum_c V_ic r(H_ic).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.compiled import compiled
from softprint.runtime.contact.learned_energy.dent_strain import CELLS, DentStrain
from softprint.runtime.elasticity.materials import Material
from softprint.runtime.lazy import lazy
from softprint.runtime.linalg.means import shared
from softprint.runtime.mechanics.loaded_points import LoadedPoints

# In mu: the energy density of a strain of 1e-4.
_ROUNDED = 1e-8
_TINY = float(np.finfo(np.float64).tiny)


class _Terms(NamedTuple):
    """value: chi; scale: of the weights [N^2], which are at most one, however small the forces are; total: B by this
    scale; weight: |phi|^2 (m,) by it; excess: sum_c V r, and stress: its derivative by H (m, CELLS dim^2); below: sum_c
    V (Psi_2 + 1e-8 mu) (m,), and linear_stress: its derivative; these four in B."""

    value: float
    scale: float
    total: float
    weight: Array
    excess: Array
    below: Array
    stress: Array
    linear_stress: Array


class _Changes(NamedTuple):
    """n changes, of the forces dphi (m*dim, n), of the weights d|phi|^2 (m, n), and of the strains dH (m, CELLS dim^2,
    n)."""

    forces: Array
    weights: Array
    strains: Array


@dataclass(frozen=True, eq=False)
class DentExcess:
    """chi of a contact with m loaded contact nodes. forces: phi (m, dim) [N] on them; strain: D (m CELLS dim^2, m dim);
    material: of the m CELLS cells, linear: linear elasticity with its moduli, and volumes: theirs (m, CELLS); corners
    and shares: (k, c) the nodes of k points, by their places among these, and their shares of a force on the point."""

    forces: Array
    strain: Array
    material: Material
    linear: Material
    volumes: Array
    corners: IntArray
    shares: Array

    @classmethod
    def of(cls, strain: DentStrain, loaded: LoadedPoints, active: IntArray, forces: Array) -> DentExcess:
        """Of forces (k, dim) [N], in rest coordinates, on active points (k,)."""
        nodes, corners, shares = loaded.among(active)
        phi = shared(forces, corners, shares, len(nodes))
        D = strain.among(nodes).reshape(-1, phi.size)
        cells = (nodes[:, None] * CELLS + np.arange(CELLS)).ravel()
        material, linear = strain.material.at(cells), strain.linear.at(cells)
        return cls(phi, D, material, linear, strain.volumes[nodes], corners, shares)

    @lazy
    def value(self) -> float:
        """chi."""
        return self._terms.value

    @property
    def slope(self) -> Array:
        """dchi/dphi (k, dim) [1/N] by the forces on the points, in rest coordinates."""
        return np.asarray((self.shares[..., None] * self._by_nodes[self.corners]).sum(axis=1))

    def curvature(self, one: Array, other: Array) -> Array:
        """d2chi (n, n') along changes (k*dim, n) and (k*dim, n') of the forces on the points."""
        a = self._changes(one)
        b = a if other is one else self._changes(other)
        bent = np.matmul(self._tangent, b.strains.reshape(*self._tangent.shape[:2], -1))
        found = a.strains.reshape(-1, a.strains.shape[2]).T @ bent.reshape(-1, b.strains.shape[2])
        found += (2.0 / self._terms.scale * np.repeat(self._terms.excess, self._dim) * a.forces.T) @ b.forces
        crossed = self._crossed(a, b)
        return np.asarray(found + crossed + (crossed.T if b is a else self._crossed(b, a).T))

    def _changes(self, of_points: Array) -> _Changes:
        """By changes (k*dim, n) of the forces on the points."""
        (m, dim), n = self.forces.shape, of_points.shape[1]
        on_points = np.ascontiguousarray(of_points).reshape(-1, dim * n)
        flat = shared(on_points, self.corners, self.shares, m).reshape(m * dim, n)
        weights = np.einsum("ma,man->mn", self.forces, flat.reshape(m, dim, n))
        return _Changes(flat, 2.0 / self._terms.scale * weights, (self.strain @ flat).reshape(m, -1, n))

    def _crossed(self, one: _Changes, other: _Changes) -> Array:
        """d|phi|^2 dr - dB dchi (n, n'), in B."""
        by_weight = np.einsum("ms,msn->mn", self._terms.stress, other.strains)
        return np.asarray(
            one.weights.T @ by_weight
            - np.outer(self._total_by_nodes.ravel() @ one.forces, self._by_nodes.ravel() @ other.forces)
        )

    @property
    def _dim(self) -> int:
        return self.forces.shape[1]

    @lazy
    def _F(self) -> Array:
        """I + H (m CELLS, dim, dim)."""
        H = (self.strain @ self.forces.ravel()).reshape(-1, self._dim, self._dim)
        return np.asarray(np.eye(self._dim) + H)

    @lazy
    def _terms(self) -> _Terms:
        psi, linear = self.material.energy_and_stress(self._F), self.linear.energy_and_stress(self._F)
        rounded = np.broadcast_to(_ROUNDED * self.material.lame_mu, len(self._F))
        return _Terms(*_sums(self.forces, self.volumes, rounded, *psi, *linear))

    @lazy
    def _tangent(self) -> Array:
        """|phi|^2 V d2r/dH2 (m CELLS, dim^2, dim^2), in B."""
        tangent = self.material.tangent(self._F) - (1.0 + self.value) * self.linear.tangent(self._F)
        weight = np.repeat(self._terms.weight / self._terms.total, CELLS) * self.volumes.ravel()
        return np.asarray(weight[:, None, None] * tangent.reshape(len(tangent), self._dim**2, -1))

    @lazy
    def _by_nodes(self) -> Array:
        """dchi/dphi (m, dim) [1/N]."""
        return self._by_forces(self._terms.excess, self._terms.stress)

    @lazy
    def _total_by_nodes(self) -> Array:
        """dB/dphi (m, dim) [1/N], in B."""
        return self._by_forces(self._terms.below, self._terms.linear_stress)

    def _by_forces(self, value: Array, stress: Array) -> Array:
        """The derivative (m, dim) by the forces of sum |phi_i|^2 r_i, of r (m,) with derivatives (m, CELLS dim^2)."""
        by_strain = (self._terms.weight[:, None] * stress).ravel() @ self.strain
        return np.asarray(
            2.0 / self._terms.scale * value[:, None] * self.forces + by_strain.reshape(self.forces.shape)
        )


def _in_sums(
    forces: Array,
    volumes: Array,
    rounded: Array,
    psi: Array,
    stress: Array,
    linear: Array,
    linear_stress: Array,
) -> tuple[float | Array, ...]:
    square = np.square(forces).sum(axis=1)
    scale = square.max()
    above, below = (
        (volumes * of.reshape(volumes.shape)).sum(axis=1) for of in (psi - linear, linear + rounded)
    )
    weight = square / scale
    total = weight @ below
    chi = weight @ above / total
    share = (volumes / total).reshape(-1, 1, 1)
    stresses = (
        (share * of).reshape(len(forces), -1) for of in (stress - (1.0 + chi) * linear_stress, linear_stress)
    )
    return chi, scale, total, weight, (above - chi * below) / total, below / total, *stresses


@compiled(reference=_in_sums)
def _sums(
    forces: Array,
    volumes: Array,
    rounded: Array,
    psi: Array,
    stress: Array,
    linear: Array,
    linear_stress: Array,
) -> tuple[float, float, float, Array, Array, Array, Array, Array]:
    """`_Terms` from Psi, its stress, Psi_2 and its stress in the m CELLS cells; rounded: 1e-8 mu (m CELLS,)."""
    m, cells = volumes.shape
    dim = forces.shape[1]
    weight, above, below = np.zeros(m), np.zeros(m), np.zeros(m)
    found, of_linear = np.empty((m, cells * dim * dim)), np.empty((m, cells * dim * dim))
    scale, value, total = _TINY, 0.0, 0.0
    for i in range(m):
        for a in range(dim):
            weight[i] += forces[i, a] * forces[i, a]
        scale = max(scale, weight[i])
        for k in range(cells):
            c = i * cells + k
            above[i] += volumes[i, k] * (psi[c] - linear[c])
            below[i] += volumes[i, k] * (linear[c] + rounded[c])
    for i in range(m):
        weight[i] /= scale
        value += weight[i] * above[i]
        total += weight[i] * below[i]
    value /= total
    for i in range(m):
        above[i] = (above[i] - value * below[i]) / total
        below[i] /= total
        at = 0
        for k in range(cells):
            c, share = i * cells + k, volumes[i, k] / total
            for a in range(dim):
                for b in range(dim):
                    found[i, at] = share * (stress[c, a, b] - (1.0 + value) * linear_stress[c, a, b])
                    of_linear[i, at] = share * linear_stress[c, a, b]
                    at += 1
    return value, scale, total, weight, above, below, found, of_linear
