"""What the displacement of linear mechanics has for energy in a dent, in powers of it and of the strain of the body.

In cells c near the contact nodes i (`dent_strain.py`), which stand for volumes V_ic, that displacement has the gradient
H_ic, and the body the strain E_i without the dent (`prestrain.py`). With the third and fourth derivatives D3 and D4 of
the energy density of its material at rest (`runtime/elasticity/rest_derivatives.py`),

    W_2 = sum_i s_i sum_c V_ic Psi_2(H_ic)              that of linear mechanics,
    W_3 = sum_i s_i sum_c V_ic 1/6 D3[H_ic, H_ic, H_ic]
    W_4 = sum_i s_i sum_c V_ic 1/24 D4[H_ic, H_ic, H_ic, H_ic]
    W_E = sum_i s_i sum_c V_ic (1/2 D3[H_ic, H_ic, E_i] + 1/4 D4[H_ic, H_ic, E_i, E_i])   in the strain of the body.

W_3 and W_E are right: a displacement that is right to first order, as that of linear mechanics is, has an energy that
is right to third (the 2n+1 theorem of perturbation theory, Gonze 1995). Of W_4 a part relaxes.

The cells of contact node i count where a node nearby bears: with omega_i = sum |phi_j|^2 over the loaded nodes j around
it,

    s_i = omega_i / (omega_i + (mu a / 20)^2),

mu the shear modulus and a the area of a contact node, so that a node which begins to bear, or ends to, changes all of
them smoothly; contacts with pressures below a twentieth of mu have no hardening to speak of. All are functions of the
contact forces in rest coordinates, and W_E of the strain of the body, too: rotating the body with all colliders changes
nothing. Dents that lie apart add up. With z = (H, E) and n_i = sum_c V_ic f_ic, for W = sum_i s_i n_i

    dW = sum_i s_i dn_i + n_i ds_i,    d2W = sum_i s_i d2n_i + ds_i dn_i + dn_i ds_i + n_i d2s_i.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.contact.dents.dent_strain import CELLS, DentStrain, StrainBetween
from softprint.runtime.contact.dents.prestrain import NodePrestrain, Prestrain
from softprint.runtime.elasticity.rest_derivatives import RestDerivatives
from softprint.runtime.lazy import lazy
from softprint.runtime.linalg.means import shared
from softprint.runtime.mechanics.body_mechanics import BodyMechanics
from softprint.runtime.mechanics.loaded_points import LoadedPoints

# The pressure on a node whose cells count by half, in mu.
_LIGHT = 0.05


class CellElasticity(NamedTuple):
    """Of the cells (n*CELLS,). tangent: D2Psi(I) (n*CELLS or 1, dim^2, dim^2) [Pa]; higher: D3 and D4."""

    tangent: Array
    higher: RestDerivatives


class DentChange(NamedTuple):
    """c changes. forces: of those on the points (k*dim, c); strain: of E at the nodes (n, dim^2, c), None for none."""

    forces: Array
    strain: Array | None = None


class _Changes(NamedTuple):
    """c changes, of the forces dphi (m*dim, c), of s (n, c), of omega (n, c), of H (n, CELLS dim^2, c), and of E (n,
    dim^2, c)."""

    forces: Array
    counted: Array
    omega: Array
    H: Array
    E: Array | None


class DentCells(NamedTuple):
    """The cells at the contact nodes of a body, in which the energies of dents are. tangent: D2Psi(I) of all, or one
    for all (n*CELLS or 1, dim^2, dim^2) [Pa]; light: mu a / 20 [N]."""

    strain: DentStrain
    prestrain: Prestrain
    tangent: Array
    light: float

    @classmethod
    def of(cls, body: ReducedBody, mechanics: BodyMechanics) -> DentCells:
        """Of a body with surface compliance."""
        compliance, dim = mechanics.surface_compliance, body.dim
        strain = DentStrain.of(body, compliance)
        tangent = strain.linear.tangent(np.broadcast_to(np.eye(dim), (strain.linear.lame_mu.size, dim, dim)))
        light = _LIGHT * float(np.median(body.material.lame_mu)) * strain.spacing ** (dim - 1)
        prestrain = Prestrain.of(body, compliance, mechanics.condensation)
        return cls(strain, prestrain, tangent.reshape(-1, dim * dim, dim * dim), light)

    def energies(
        self, loaded: LoadedPoints, active: IntArray, forces: Array, rows: Array, frame_rows: Array
    ) -> DentEnergies:
        """Of forces (k, dim) [N], in rest coordinates, on active points (k,), at handle rows in a step that starts at
        frame rows (n_rows, dim)."""
        nodes, corners, shares = loaded.among(active)
        phi = shared(forces, corners, shares, len(nodes))
        around, near = self.strain.around.of(nodes)
        cells = (around[:, None] * CELLS + np.arange(CELLS)).ravel()
        tangent = self.tangent if len(self.tangent) == 1 else self.tangent[cells]
        return DentEnergies(
            phi,
            self.strain.between(around, nodes),
            self.prestrain.at(around, rows, frame_rows),
            CellElasticity(tangent, self.strain.rest_derivatives.at(cells)),
            self.strain.volumes[around],
            near,
            self.light,
            corners,
            shares,
        )


@dataclass(frozen=True, eq=False)
class DentEnergies:
    """(W_2, W_3, W_4, W_E) of a contact with m loaded contact nodes, from the cells of n nodes around them. forces: phi
    (m, dim) [N]; strain: D; prestrain: E at the n nodes; elasticity: of their cells, and volumes: V (n, CELLS)
    [m^dim]; near: (n, m) which loaded nodes are around which; light: mu a / 20 [N]; corners and shares: (k, c) the
    loaded nodes of k points, by their places, and their shares of a force on the point."""

    forces: Array
    strain: StrainBetween
    prestrain: NodePrestrain
    elasticity: CellElasticity
    volumes: Array
    near: BoolArray
    light: float
    corners: IntArray
    shares: Array

    @lazy
    def values(self) -> Array:
        """(4,) [J]."""
        return np.asarray(self._counted[0] @ self._at_nodes)

    @lazy
    def slopes(self) -> Array:
        """By the forces on the points, in rest coordinates (k*dim, 4) [m]."""
        (s, by_omega, _), (k, _), dim = self._counted, self.corners.shape, self.forces.shape[1]
        by_H = np.stack([s[:, None] * self._over_cells(slope) for slope in self._slopes], axis=-1)
        by_nodes = self.strain.pulled_back(by_H)
        more = self.near.T @ (by_omega[:, None] * self._at_nodes)
        by_nodes += 2.0 * self.forces[:, :, None] * more[:, None]
        return np.asarray((self.shares[..., None, None] * by_nodes[self.corners]).sum(axis=1).reshape(k * dim, 4))

    @lazy
    def by_prestrain(self) -> Array:
        """dW_E by E at the nodes (n, dim^2) [J]."""
        s, (_, dim) = self._counted[0], self.forces.shape
        by_E = (self.volumes.reshape(-1, 1) * self._by_strain).reshape(len(s), CELLS, dim * dim).sum(axis=1)
        return np.asarray(s[:, None] * by_E)

    def curvature(self, share: Array, one: DentChange, other: DentChange) -> Array:
        """d2 of share . (W_2, W_3, W_4, W_E), share (4,), along changes (c, c')."""
        a = self._changes(one)
        b = a if other is one else self._changes(other)
        _, by_omega, bent = self._counted
        n = self._at_nodes @ share
        found = self._bent(share, a, b) + (a.omega.T * (n * bent)) @ b.omega
        around = self.near.T @ (n * by_omega)
        found += (2.0 * np.repeat(around, self.forces.shape[1]) * a.forces.T) @ b.forces
        crossed = a.counted.T @ self._by_nodes(share, b)
        return np.asarray(found + crossed + (crossed.T if b is a else self._by_nodes(share, a).T @ b.counted))

    def _changes(self, of: DentChange) -> _Changes:
        (m, dim), c = self.forces.shape, of.forces.shape[1]
        on_points = np.ascontiguousarray(of.forces).reshape(-1, dim * c)
        flat = shared(on_points, self.corners, self.shares, m).reshape(m * dim, c)
        omega = self.near @ (2.0 * np.einsum("ma,mac->mc", self.forces, flat.reshape(m, dim, c)))
        return _Changes(flat, self._counted[1][:, None] * omega, omega, self.strain.strains(flat), of.strain)

    def _by_nodes(self, share: Array, change: _Changes) -> Array:
        """share . dn (n, c)."""
        by_H = self._over_cells(np.tensordot(share, self._slopes, axes=1))
        found = (by_H[:, None] @ change.H)[:, 0]
        if change.E is not None:
            by_E = self._over_cells(self._by_strain).reshape(len(by_H), CELLS, -1).sum(axis=1)
            found += share[3] * (by_E[:, None] @ change.E)[:, 0]
        return np.asarray(found)

    def _bent(self, share: Array, one: _Changes, other: _Changes) -> Array:
        """share . sum_i s_i d2n_i (c, c')."""
        (n, _), k = self.volumes.shape, self.forces.shape[1] ** 2
        weight = (self._counted[0][:, None] * self.volumes).reshape(-1, 1, 1)
        by_order = (self.elasticity.tangent, self._tangent_3, 0.5 * self._tangent_4, self._tangent_E)
        tangent = weight * sum((part * by for part, by in zip(share, by_order, strict=True)), np.zeros(()))
        bent = tangent @ other.H.reshape(-1, k, other.H.shape[2])
        found = _flat(one.H).T @ _flat(bent)
        mixed = (share[3] * weight * self._mixed).reshape(n, CELLS * k, k).swapaxes(1, 2)
        if one.E is not None:
            crossed = _flat(one.E).T @ _flat(mixed @ other.H)
            found += crossed
            if one is other:
                found += crossed.T
        if other.E is not None and one is not other:
            found += _flat(mixed @ one.H).T @ _flat(other.E)
        if one.E is not None and other.E is not None:
            by_E = (0.5 * share[3] * weight * self._tangent_4).reshape(n, CELLS, k, k).sum(axis=1)
            found += _flat(one.E).T @ _flat(by_E @ other.E)
        return np.asarray(found)

    def _over_cells(self, by_H: Array) -> Array:
        """V by_H (n, CELLS dim^2) of what there is in the cells (n CELLS, dim^2)."""
        return np.asarray((self.volumes.reshape(-1, 1) * by_H).reshape(len(self.volumes), -1))

    @lazy
    def _counted(self) -> tuple[Array, Array, Array]:
        """s, and its first and second derivatives by omega (n,)."""
        omega, light = self.near @ np.square(self.forces).sum(axis=1), self.light**2
        below = 1.0 / (omega + light)
        return omega * below, light * below**2, -2.0 * light * below**3

    @lazy
    def _at_nodes(self) -> Array:
        """n of (W_2, W_3, W_4, W_E) (n, 4)."""
        # Each is homogeneous in H.
        by_H = np.einsum("znk,nk->zn", self._slopes, self._H) / np.array([2.0, 3.0, 4.0, 2.0])[:, None]
        return np.asarray((self.volumes.ravel() * by_H).reshape(4, -1, CELLS).sum(axis=2).T)

    @lazy
    def _slopes(self) -> Array:
        """Of the energy densities by H (4, n CELLS, dim^2)."""
        H = self._H[..., None]
        by = self.elasticity.tangent, 0.5 * self._tangent_3, self._tangent_4 / 6.0, self._tangent_E
        return np.stack([(tangent @ H)[..., 0] for tangent in by])

    @lazy
    def _by_strain(self) -> Array:
        """Of the energy density in the strain of the body, by E (n CELLS, dim^2)."""
        H = self._H[..., None]
        in_strain = (self._tangent_4 @ self._E[..., None])[..., 0]
        return np.asarray(0.5 * ((self._tangent_3 @ H)[..., 0] + in_strain))

    @lazy
    def _mixed(self) -> Array:
        """The same by H and E (n CELLS, dim^2, dim^2)."""
        return self._tangent_3 + self.elasticity.higher.fourth_along(self._H, self._E)

    @lazy
    def _tangent_E(self) -> Array:
        """D3[., ., E] + 1/2 D4[., ., E, E] (n CELLS, dim^2, dim^2)."""
        higher, E = self.elasticity.higher, self._E
        return higher.third_along(E) + 0.5 * higher.fourth_along(E, E)

    @lazy
    def _E(self) -> Array:
        """In the cells (n CELLS, dim^2)."""
        return np.repeat(self.prestrain.value, CELLS, axis=0)

    @lazy
    def _tangent_3(self) -> Array:
        """D3[., ., H] (n CELLS, dim^2, dim^2)."""
        return self.elasticity.higher.third_along(self._H)

    @lazy
    def _tangent_4(self) -> Array:
        """D4[., ., H, H] (n CELLS, dim^2, dim^2)."""
        return self.elasticity.higher.fourth_along(self._H, self._H)

    @lazy
    def _H(self) -> Array:
        """(n CELLS, dim^2)."""
        return self.strain.strains(self.forces.reshape(-1, 1)).reshape(self.volumes.size, -1)


def _flat(blocks: Array) -> Array:
    """(n*s, c) of (n, s, c)."""
    return blocks.reshape(-1, blocks.shape[2])
