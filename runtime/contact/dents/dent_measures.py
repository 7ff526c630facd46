"""What is measured of a dent: how it hardens as it grows, and how the strain of the body stiffens it.

Both are means over cells at the loaded contact nodes i (`dent_strain.py`), with the contact forces phi_i in the
weights,

    mean(f) = sum_i |phi_i|^2 sum_c V_ic f_ic / B,    B = sum_i |phi_i|^2 sum_c V_ic.

*The excess.* Where the displacement of linear mechanics is u, the body has the energy W + sum_c V_c (Psi(I + H_c) -
Psi_2(H_c)), to third order in u, with H = grad u, the energy density Psi of its material, and that of linear
elasticity, Psi_2 = mu eps:eps + lambda/2 (tr eps)^2. So the ratio of both tells how a dent hardens, wherever it is and
whatever makes it:

    chi = mean L((Psi - Psi_2) / psi),    psi = Psi_2(H) + 1e-8 mu,    L(x) = ln(1 + x),

for x < 0, where Psi may vanish, L to second order: x - x^2/2; 1e-8 mu only keeps round-off of strains below 1e-4 out.
A sum of Psi - Psi_2 in place of the mean logarithm would be that of the few cells under a tip, in which linear
mechanics concentrates strain and the body does not.

*The stiffening* by the strain E_i that the body has there without the dent (`prestrain.py`). To first order in E the
dent has the energy densities Psi_2 + Q, Q = 1/2 D3Psi(I)[H, H, E] (`runtime/elasticity/strained_stiffness.py`):

    sigma = mean tanh(Q(H, E) / psi),

bounded, so that no strain is beyond it. Both are functions of the contact forces in rest coordinates, and sigma of
the strain of the body, too: rotating the body with all colliders changes nothing. They are those of each dent where
like dents lie apart. A node that begins to bear, or ends to, changes them smoothly. With z = (H, E), of a measure M

    dM = dR / B,    d2M = (d2R - dM dB - dB dM) / B,    R = sum_i |phi_i|^2 sum_c V_ic (f_ic - M), M held,

and df and d2f in `cell_ratios.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.contact.dents.cell_ratios import CellRatios, Density
from softprint.runtime.contact.dents.dent_strain import CELLS, DentStrain, StrainAmong
from softprint.runtime.contact.dents.prestrain import NodePrestrain, Prestrain
from softprint.runtime.contact.dents.ratio_functions import bounded, continued_logarithm
from softprint.runtime.elasticity.material import Material
from softprint.runtime.elasticity.strained_stiffness import StrainedStiffness, n_strains
from softprint.runtime.lazy import lazy
from softprint.runtime.linalg.means import shared
from softprint.runtime.mechanics.body_mechanics import BodyMechanics
from softprint.runtime.mechanics.loaded_points import LoadedPoints

# In mu: the energy density of a strain of 1e-4.
_ROUNDED = 1e-8
_TINY = float(np.finfo(np.float64).tiny)


class CellMaterials(NamedTuple):
    """Of the cells (m CELLS,). material: theirs; linear: linear elasticity with its moduli; strained: B."""

    material: Material
    linear: Material
    strained: StrainedStiffness


class _Weights(NamedTuple):
    """scale: of the weights [N^2], which are at most one, however small the forces are; total: B by this scale; weight:
    |phi|^2 (m,) by it."""

    scale: float
    total: float
    weight: Array


class _Mean(NamedTuple):
    """value: M; excess: sum_c V (f - M) (m,), and its derivatives by H (m, CELLS dim^2) and by E (m, s); all in B."""

    value: float
    excess: Array
    by_H: Array
    by_E: Array


class DentChange(NamedTuple):
    """n changes. forces: of those on the points (k*dim, n); strain: of the components of E (m, s, n), None for none."""

    forces: Array
    strain: Array | None = None


class _Changes(NamedTuple):
    """n changes, of the forces dphi (m*dim, n), of the weights d|phi|^2 (m, n), of H (m, CELLS dim^2, n) and of E (m,
    s, n)."""

    forces: Array
    weights: Array
    H: Array
    E: Array | None


class DentCells(NamedTuple):
    """The cells at the contact nodes of a body, in which dents are measured."""

    strain: DentStrain
    prestrain: Prestrain

    @classmethod
    def of(cls, body: ReducedBody, mechanics: BodyMechanics) -> DentCells:
        """Of a body with surface compliance."""
        compliance = mechanics.surface_compliance
        return cls(DentStrain.of(body, compliance), Prestrain.of(body, compliance, mechanics.condensation))

    def measures(
        self, loaded: LoadedPoints, active: IntArray, forces: Array, rows: Array, frame_rows: Array
    ) -> DentMeasures:
        """Of forces (k, dim) [N], in rest coordinates, on active points (k,), at handle rows in a step that starts at
        frame rows (n_rows, dim)."""
        nodes, corners, shares = loaded.among(active)
        phi = shared(forces, corners, shares, len(nodes))
        cells, strain = (nodes[:, None] * CELLS + np.arange(CELLS)).ravel(), self.strain
        materials = CellMaterials(
            strain.material.at(cells), strain.linear.at(cells), strain.strained.at(cells)
        )
        at_nodes = strain.among(nodes), self.prestrain.at(nodes, rows, frame_rows)
        return DentMeasures(phi, *at_nodes, materials, strain.volumes[nodes], corners, shares)


@dataclass(frozen=True, eq=False)
class DentMeasures:
    """sigma and chi, in this order, of a contact with m loaded contact nodes. forces: phi (m, dim) [N] on them; strain:
    D among these; prestrain: E there; materials: of the m CELLS cells, and volumes: (m, CELLS) [m^dim]; corners and
    shares: (k, c) the nodes of k points, by their places among these, and their shares of a force on the point."""

    forces: Array
    strain: StrainAmong
    prestrain: NodePrestrain
    materials: CellMaterials
    volumes: Array
    corners: IntArray
    shares: Array

    @property
    def stiffening(self) -> float:
        """sigma."""
        return self._means[0].value

    @property
    def excess(self) -> float:
        """chi."""
        return self._means[1].value

    @lazy
    def slopes(self) -> Array:
        """By the forces on the points, in rest coordinates (k*dim, 2) [1/N]."""
        by_H, excess = (np.stack([getattr(of, name) for of in self._means], axis=-1) for name in ("by_H", "excess"))
        weight, (k, _), dim = self._weights, self.corners.shape, self._dim
        by_nodes = self.strain.pulled_back(weight.weight[:, None, None] * by_H)
        by_nodes += 2.0 / weight.scale * self.forces[:, :, None] * excess[:, None]
        return np.asarray((self.shares[..., None, None] * by_nodes[self.corners]).sum(axis=1).reshape(k * dim, 2))

    @property
    def by_prestrain(self) -> Array:
        """dsigma by the components of E (m, s)."""
        return np.asarray(self._weights.weight[:, None] * self._means[0].by_E)

    def curvature(self, counted: Array, one: DentChange, other: DentChange) -> Array:
        """d2(a sigma + b chi) (n, n') along changes, counted: (a, b)."""
        mean = self._combined(counted)
        a = self._changes(one)
        b = a if other is one else self._changes(other)
        found = self._bent(counted, a, b)
        found += (2.0 / self._weights.scale * np.repeat(mean.excess, self._dim) * a.forces.T) @ b.forces
        crossed = self._crossed(mean, a, b)
        return np.asarray(found + crossed + (crossed.T if b is a else self._crossed(mean, b, a).T))

    def _changes(self, of: DentChange) -> _Changes:
        (m, dim), n = self.forces.shape, of.forces.shape[1]
        on_points = np.ascontiguousarray(of.forces).reshape(-1, dim * n)
        flat = shared(on_points, self.corners, self.shares, m).reshape(m * dim, n)
        weights = np.einsum("ma,man->mn", self.forces, flat.reshape(m, dim, n))
        return _Changes(flat, 2.0 / self._weights.scale * weights, self.strain.strains(flat), of.strain)

    def _bent(self, counted: Array, one: _Changes, other: _Changes) -> Array:
        """sum_i |phi_i|^2 sum_c V_ic (a d2tanh + b d2L) (n, n'), in B."""
        tangent, k = self._tangent(counted), self._dim**2
        bent = tangent[:, :k, :k] @ other.H.reshape(-1, k, other.H.shape[2])
        found = _flat(one.H).T @ _flat(bent)
        by_H = tangent[:, :k, k:].reshape(len(self.forces), CELLS * k, -1).swapaxes(1, 2)
        if one.E is not None:
            mixed = _flat(one.E).T @ _flat(by_H @ other.H)
            found += mixed
            if one is other:
                found += mixed.T
        if other.E is not None and one is not other:
            found += _flat(by_H @ one.H).T @ _flat(other.E)
        if one.E is not None and other.E is not None:
            by_E = tangent[:, k:, k:].reshape(len(self.forces), CELLS, *2 * one.E.shape[1:2]).sum(axis=1)
            found += _flat(one.E).T @ _flat(by_E @ other.E)
        return np.asarray(found)

    def _crossed(self, mean: _Mean, one: _Changes, other: _Changes) -> Array:
        """d|phi|^2 df - dB dM (n, n'), in B."""
        of = self._weights
        by_nodes = (mean.by_H[:, None] @ other.H)[:, 0]
        if other.E is not None:
            by_nodes += (mean.by_E[:, None] @ other.E)[:, 0]
        change = of.weight @ by_nodes + mean.excess @ other.weights
        total = (self.volumes.sum(axis=1) / of.total) @ one.weights
        return np.asarray(one.weights.T @ by_nodes - np.outer(total, change))

    def _tangent(self, counted: Array) -> Array:
        """a |phi|^2 V d2tanh/dz2 + b |phi|^2 V d2L/dz2 (m CELLS, z, z), in B."""
        stiffening, excess = self._ratios
        found, k = counted[0] * stiffening.bend, self._dim**2
        found[:, :k, :k] += counted[1] * excess.bend
        return np.asarray((self._share * np.repeat(self._weights.weight, CELLS))[:, None, None] * found)

    def _combined(self, counted: Array) -> _Mean:
        """a sigma + b chi."""
        both = zip(*self._means, strict=True)
        return _Mean(*(counted[0] * one + counted[1] * other for one, other in both))

    @lazy
    def _means(self) -> tuple[_Mean, _Mean]:
        """sigma and chi."""
        one, other = (self._mean(of) for of in self._ratios)
        return one, other

    def _mean(self, of: CellRatios) -> _Mean:
        weights, share, m, k = self._weights, self._share, len(self.forces), self._dim**2
        found = (share * of.f.value).reshape(m, -1).sum(axis=1)
        value = float(weights.weight @ found)
        excess = found - value * self.volumes.sum(axis=1) / weights.total
        slope = share[:, None] * of.slope
        by_E = np.zeros((m, n_strains(self._dim)))
        if slope.shape[1] > k:
            by_E = slope[:, k:].reshape(m, CELLS, -1).sum(axis=1)
        return _Mean(value, excess, slope[:, :k].reshape(m, -1), by_E)

    @lazy
    def _ratios(self) -> tuple[CellRatios, CellRatios]:
        """Of sigma, by z = (H, E), and of chi, by H."""
        of, linear = self.materials, self._density(self.materials.linear)
        below = linear._replace(value=linear.value + _ROUNDED * of.material.lame_mu)
        more = self._density(of.material, linear)
        Q = self._strained
        return (
            CellRatios(bounded(Q.value / below.value), Q, below),
            CellRatios(continued_logarithm(more.value / below.value), more, below),
        )

    @lazy
    def _strained(self) -> Density:
        """Q, by z = (H, E)."""
        H, E, of = self._H, np.repeat(self.prestrain.value, CELLS, axis=0), self.materials.strained
        B = of.stiffness(E)
        by_H = (B @ H[..., None])[..., 0]
        by_E, mixed = of.by_strain(H)

        @cache
        def bend() -> Array:
            return np.block([[B, mixed.swapaxes(1, 2)], [mixed, np.zeros((len(H), *2 * E.shape[1:]))]])

        return Density(0.5 * (H * by_H).sum(axis=1), np.hstack([by_H, by_E]), bend)

    def _density(self, material: Material, less: Density | None = None) -> Density:
        """Psi(I + H), less another."""
        F, k = np.eye(self._dim) + self._H.reshape(-1, self._dim, self._dim), self._dim**2
        value, stress = material.energy_and_stress(F)
        slope = stress.reshape(-1, k)

        @cache
        def bend() -> Array:
            return material.tangent(F).reshape(-1, k, k)

        if less is None:
            return Density(value, slope, bend)
        return Density(value - less.value, slope - less.slope, lambda: bend() - less.bend())

    @lazy
    def _weights(self) -> _Weights:
        square, volume = np.square(self.forces).sum(axis=1), self.volumes.sum(axis=1)
        scale = max(float(square.max()), _TINY)
        weight = square / scale
        return _Weights(scale, float(weight @ volume), weight)

    @property
    def _share(self) -> Array:
        """V (m CELLS,), in B."""
        return self.volumes.ravel() / self._weights.total

    @lazy
    def _H(self) -> Array:
        """(m CELLS, dim^2)."""
        return self.strain.strains(self.forces.reshape(-1, 1)).reshape(self.volumes.size, -1)

    @property
    def _dim(self) -> int:
        return self.forces.shape[1]


def _flat(blocks: Array) -> Array:
    """(m*s, n) of (m, s, n)."""
    return blocks.reshape(-1, blocks.shape[2])
