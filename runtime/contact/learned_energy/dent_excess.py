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
from softprint.runtime.contact.learned_energy.dent_strain import CELLS, DentStrain
from softprint.runtime.elasticity.materials import Material, make_material
from softprint.runtime.lazy import lazy
from softprint.runtime.mechanics.loaded_points import LoadedPoints

# In mu: the energy density of a strain of 1e-4.
_ROUNDED = 1e-8


class _Changes(NamedTuple):
    """n changes, of the forces dphi (m*dim, n), of the weights d|phi|^2 (m, n), and of the strains dH (m, CELLS dim^2,
    n)."""

    forces: Array
    weights: Array
    strains: Array


@dataclass(frozen=True, eq=False)
class DentExcess:
    """chi of a contact with m loaded contact nodes. forces: phi (m, dim) [N] on them; strain: D (m CELLS dim^2, m dim);
    material: of the m CELLS cells, and volumes: theirs (m, CELLS); corners and shares: (k, c) the nodes of k points, by
    their places among these, and their shares of a force on the point."""

    forces: Array
    strain: Array
    material: Material
    volumes: Array
    corners: IntArray
    shares: Array

    @classmethod
    def of(cls, strain: DentStrain, loaded: LoadedPoints, active: IntArray, forces: Array) -> DentExcess:
        """Of forces (k, dim) [N], in rest coordinates, on active points (k,)."""
        _, corners, shares = loaded.among(active)
        nodes, phi = loaded.to_nodes(active, forces)
        D = strain.among(nodes).reshape(-1, phi.size)
        cells = (nodes[:, None] * CELLS + np.arange(CELLS)).ravel()
        return cls(phi, D, strain.material.at(cells), strain.volumes[nodes], corners, shares)

    @lazy
    def value(self) -> float:
        """chi."""
        return float(self._weight @ self._above / self._total)

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
        found += (2.0 / self._scale * np.repeat(self._excess, self._dim) * a.forces.T) @ b.forces
        crossed = self._crossed(a, b)
        return np.asarray(found + crossed + (crossed.T if b is a else self._crossed(b, a).T))

    def _changes(self, of_points: Array) -> _Changes:
        """By changes (k*dim, n) of the forces on the points."""
        n = of_points.shape[1]
        change = np.zeros((*self.forces.shape, n))
        np.add.at(change, self.corners, self.shares[..., None, None] * of_points.reshape(-1, 1, self._dim, n))
        weights = 2.0 / self._scale * np.einsum("ma,man->mn", self.forces, change)
        flat = change.reshape(-1, n)
        return _Changes(flat, weights, (self.strain @ flat).reshape(len(change), -1, n))

    def _crossed(self, one: _Changes, other: _Changes) -> Array:
        """d|phi|^2 dr - dB dchi (n, n'), in B."""
        by_weight = np.einsum("ms,msn->mn", self._stress, other.strains)
        return np.asarray(
            one.weights.T @ by_weight
            - np.outer(self._total_by_nodes.ravel() @ one.forces, self._by_nodes.ravel() @ other.forces)
        )

    @property
    def _dim(self) -> int:
        return self.forces.shape[1]

    @lazy
    def _scale(self) -> float:
        """Of the weights [N^2]: they are at most one, however small the forces are."""
        return max(float(np.square(self.forces).sum(axis=1).max()), float(np.finfo(np.float64).tiny))

    @lazy
    def _weight(self) -> Array:
        """|phi|^2 (m,), by their scale."""
        return np.asarray(np.square(self.forces).sum(axis=1) / self._scale)

    @lazy
    def _F(self) -> Array:
        """I + H (m CELLS, dim, dim)."""
        H = (self.strain @ self.forces.ravel()).reshape(-1, self._dim, self._dim)
        return np.asarray(np.eye(self._dim) + H)

    @lazy
    def _linear(self) -> Material:
        """Linear elasticity, with the moduli of the material."""
        return make_material("linear", self.material.young, self.material.poisson)

    @lazy
    def _densities(self) -> tuple[Array, Array, Array, Array]:
        """Psi, its stress, and Psi_2, its stress (m CELLS, ...)."""
        return *self.material.energy_and_stress(self._F), *self._linear.energy_and_stress(self._F)

    @lazy
    def _above(self) -> Array:
        """sum_c V (Psi - Psi_2) (m,) [J]."""
        psi, _, linear, _ = self._densities
        return self._of_nodes(psi - linear)

    @lazy
    def _below(self) -> Array:
        """sum_c V (Psi_2 + 1e-8 mu) (m,) [J]."""
        return self._of_nodes(self._densities[2] + _ROUNDED * self.material.lame_mu)

    @lazy
    def _total(self) -> float:
        """B, by the scale of the weights."""
        return float(self._weight @ self._below)

    @lazy
    def _excess(self) -> Array:
        """sum_c V r (m,), in B."""
        return np.asarray((self._above - self.value * self._below) / self._total)

    @lazy
    def _stress(self) -> Array:
        """Its derivative by H (m, CELLS dim^2)."""
        _, stress, _, linear = self._densities
        return self._weighted(stress - (1.0 + self.value) * linear)

    @lazy
    def _tangent(self) -> Array:
        """|phi|^2 V d2r/dH2 (m CELLS, dim^2, dim^2), in B."""
        tangent = self.material.tangent(self._F) - (1.0 + self.value) * self._linear.tangent(self._F)
        weight = np.repeat(self._weight / self._total, CELLS) * self.volumes.ravel()
        return np.asarray(weight[:, None, None] * tangent.reshape(len(tangent), self._dim**2, -1))

    @lazy
    def _by_nodes(self) -> Array:
        """dchi/dphi (m, dim) [1/N]."""
        return self._by_forces(self._excess, self._stress)

    @lazy
    def _total_by_nodes(self) -> Array:
        """dB/dphi (m, dim) [1/N], in B."""
        return self._by_forces(self._below / self._total, self._weighted(self._densities[3]))

    def _of_nodes(self, density: Array) -> Array:
        """sum_c V of a density (m CELLS,) at each node (m,)."""
        return np.asarray((self.volumes * density.reshape(self.volumes.shape)).sum(axis=1))

    def _weighted(self, stress: Array) -> Array:
        """V times a stress (m CELLS, dim, dim), in B: (m, CELLS dim^2)."""
        stress = self.volumes.reshape(-1, 1, 1) / self._total * stress
        return np.asarray(stress.reshape(len(self.forces), -1))

    def _by_forces(self, value: Array, stress: Array) -> Array:
        """The derivative (m, dim) by the forces of sum |phi_i|^2 r_i, of r (m,) with derivatives (m, CELLS dim^2)."""
        by_strain = (self._weight[:, None] * stress).ravel() @ self.strain
        return np.asarray(
            2.0 / self._scale * value[:, None] * self.forces + by_strain.reshape(self.forces.shape)
        )
