"""The excess of a dent: how much more energy the body has for the dent of linear mechanics than linear mechanics has.

Where the displacement of linear mechanics is u, the body has the energy W + sum_c V_c (Psi(I + H_c) - Psi_2(H_c)), to
third order in u, with H = grad u, the energy density Psi of its material, and that of linear elasticity, Psi_2 = mu
eps:eps + lambda/2 (tr eps)^2. So the ratio of both tells how a dent hardens, wherever it is and whatever makes it. Its
logarithm is taken at contact nodes i, with the forces phi_i on them in the weights (`dent_strain.py`),

    chi = sum_i |phi_i|^2 sum_c V_ic L(x_ic) / sum_i |phi_i|^2 sum_c V_ic,    L(x) = ln(1 + x),
    x = (Psi - Psi_2) / psi,    psi = Psi_2(H) + 1e-8 mu,

for x < 0, where Psi may vanish, L to second order: x - x^2/2; 1e-8 mu only keeps round-off of strains below 1e-4 out.
A sum of Psi - Psi_2 in place of the mean logarithm would be that of the few cells under a tip, in which linear
mechanics concentrates strain and the body does not. chi is a function of the contact forces in rest coordinates:
rotating the body with all colliders changes nothing. It is that of each dent where like dents lie apart. A node that
begins to bear, or ends to, changes it smoothly. With chi held in r = L(x) - chi, and B the denominator,

    dchi = dR / B,    d2chi = (d2R - dchi dB - dB dchi) / B,    R = sum_i |phi_i|^2 sum_c V_ic r_ic,
    dr = L'/psi s,    s = dPsi - (1 + x) dPsi_2,
    d2r = L'/psi [d2Psi - (1 + x) d2Psi_2 - (s dPsi_2^T + dPsi_2 s^T) / psi] + L''/psi^2 s s^T.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.contact.learned_energy.continued_logarithm import ContinuedLogarithm
from softprint.runtime.contact.learned_energy.dent_strain import CELLS, DentStrain, StrainAmong
from softprint.runtime.elasticity.materials import Material
from softprint.runtime.lazy import lazy
from softprint.runtime.linalg.means import shared
from softprint.runtime.mechanics.loaded_points import LoadedPoints

# In mu: the energy density of a strain of 1e-4.
_ROUNDED = 1e-8
_TINY = float(np.finfo(np.float64).tiny)


class _Cells(NamedTuple):
    """Of the cells (m CELLS,). below: psi [J/m^3]; ratio: 1 + x; log: L, and its slope and bend: L' and L''; stress:
    dPsi, and linear_stress: dPsi_2 (m CELLS, dim, dim)."""

    below: Array
    ratio: Array
    log: Array
    slope: Array
    bend: Array
    stress: Array
    linear_stress: Array

    @property
    def s(self) -> Array:
        """(m CELLS, dim^2) [J/m^3]."""
        return (self.stress - self.ratio[:, None, None] * self.linear_stress).reshape(len(self.ratio), -1)


class _Terms(NamedTuple):
    """value: chi; scale: of the weights [N^2], which are at most one, however small the forces are; total: B by this
    scale; weight: |phi|^2 (m,) by it; excess: sum_c V r, and by_strain: its derivative by H (m, CELLS dim^2); volume:
    sum_c V (m,); these three in B."""

    value: float
    scale: float
    total: float
    weight: Array
    excess: Array
    volume: Array
    by_strain: Array


class _Changes(NamedTuple):
    """n changes, of the forces dphi (m*dim, n), of the weights d|phi|^2 (m, n), and of the strains dH (m, CELLS dim^2,
    n)."""

    forces: Array
    weights: Array
    strains: Array


@dataclass(frozen=True, eq=False)
class DentExcess:
    """chi of a contact with m loaded contact nodes. forces: phi (m, dim) [N] on them; strain: D among these;
    material: of the m CELLS cells, linear: linear elasticity with its moduli, and volumes: theirs (m, CELLS); corners
    and shares: (k, c) the nodes of k points, by their places among these, and their shares of a force on the point."""

    forces: Array
    strain: StrainAmong
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
        cells = (nodes[:, None] * CELLS + np.arange(CELLS)).ravel()
        material, linear = strain.material.at(cells), strain.linear.at(cells)
        return cls(phi, strain.among(nodes), material, linear, strain.volumes[nodes], corners, shares)

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
        return _Changes(flat, 2.0 / self._terms.scale * weights, self.strain.strains(flat))

    def _crossed(self, one: _Changes, other: _Changes) -> Array:
        """d|phi|^2 dr - dB dchi (n, n'), in B."""
        by_weight = np.einsum("ms,msn->mn", self._terms.by_strain, other.strains)
        total = self._terms.volume @ one.weights
        return np.asarray(one.weights.T @ by_weight - np.outer(total, self._by_nodes.ravel() @ other.forces))

    @property
    def _dim(self) -> int:
        return self.forces.shape[1]

    @lazy
    def _F(self) -> Array:
        """I + H (m CELLS, dim, dim)."""
        H = self.strain.strains(self.forces.reshape(-1, 1))
        return np.asarray(np.eye(self._dim) + H.reshape(-1, self._dim, self._dim))

    @lazy
    def _cells(self) -> _Cells:
        (psi, stress), (linear, linear_stress) = (
            of.energy_and_stress(self._F) for of in (self.material, self.linear)
        )
        below = linear + _ROUNDED * self.material.lame_mu
        x = (psi - linear) / below
        return _Cells(below, 1.0 + x, *ContinuedLogarithm.of(x), stress, linear_stress)

    @lazy
    def _terms(self) -> _Terms:
        of = self._cells
        square, volume = np.square(self.forces).sum(axis=1), self.volumes.sum(axis=1)
        scale = max(float(square.max()), _TINY)
        weight = square / scale
        total = float(weight @ volume)
        log = (self.volumes * of.log.reshape(self.volumes.shape)).sum(axis=1)
        chi = float(weight @ log) / total
        by_strain = (self.volumes.ravel() / total * of.slope / of.below)[:, None] * of.s
        return _Terms(
            chi,
            scale,
            total,
            weight,
            (log - chi * volume) / total,
            volume / total,
            by_strain.reshape(len(log), -1),
        )

    @lazy
    def _tangent(self) -> Array:
        """|phi|^2 V d2r/dH2 (m CELLS, dim^2, dim^2), in B."""
        of, s = self._cells, self._cells.s
        one = of.linear_stress.reshape(s.shape)

        def scaled(factor: Array, tangent: Array) -> Array:
            return factor[:, None, None] * tangent.reshape(*s.shape, -1)

        tangent = self.material.tangent(self._F).reshape(*s.shape, -1).copy()
        tangent -= scaled(of.ratio, self.linear.tangent(self._F))
        crossed = scaled(1.0 / of.below, s[:, :, None] * one[:, None, :])
        tangent -= crossed + crossed.transpose(0, 2, 1)
        tangent += scaled(of.bend / (of.slope * of.below), s[:, :, None] * s[:, None, :])
        share = np.repeat(self._terms.weight / self._terms.total, CELLS) * self.volumes.ravel()
        return scaled(share * of.slope / of.below, tangent)

    @lazy
    def _by_nodes(self) -> Array:
        """dchi/dphi (m, dim) [1/N]."""
        terms = self._terms
        by_weight = 2.0 / terms.scale * terms.excess[:, None] * self.forces
        return by_weight + self.strain.pulled_back(terms.weight[:, None] * terms.by_strain)
