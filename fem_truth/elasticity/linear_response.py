"""Elasticity linearised about an internal equilibrium: the baseline for learned corrections.

W(x) ~ W(x0) + g^T u + 1/2 u^T H u,   u = x - x0,   g = W'(x0),  H = W''(x0).
"""

from __future__ import annotations

import numpy as np

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.linalg.block_matrix import BlockMatrix
from softprint.runtime.arrays import Array


class QuadraticElasticity:
    """The second-order model of the elastic energy about x0 (n_nodes, dim), assembled once."""

    def __init__(self, elasticity: FullSpaceElasticity, x0: Array) -> None:
        self._x0 = x0
        self.unit_energy = elasticity.unit_energy
        self._energy, self._gradient = elasticity.energy_gradient(x0)
        self._hessian = elasticity.hessian(x0)

    def energy(self, x: Array) -> float:
        return self.energy_gradient(x)[0]

    def gradient(self, x: Array) -> Array:
        return self.energy_gradient(x)[1]

    def energy_gradient(self, x: Array) -> tuple[float, Array]:
        u = x - self._x0
        change = self._hessian.apply(u)
        return self._energy + float(np.vdot(self._gradient + 0.5 * change, u)), self._gradient + change

    def hessian(self, x: Array) -> BlockMatrix:
        return self._hessian.copy()
