"""The potentials of gravity, inertia and springs, each with value, gradient and Hessian contribution.

All act on node positions x (n_nodes, dim) in the mesh's order, and return this rank's shares
(`fem_truth.parts.share`) if their node data are those of the nodes that it owns.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from softprint.fem_truth.linalg.block_matrix import BlockMatrix
from softprint.runtime.arrays import Array


class Potential(Protocol):
    """A term W(x) [J] of the energy; `add_hessian` adds its second derivative at x to the matrix (convex: the
    positive semi-definite part of it)."""

    def energy(self, x: Array) -> float: ...
    def gradient(self, x: Array) -> Array: ...
    def add_hessian(self, x: Array, matrix: BlockMatrix, convex: bool) -> None: ...

    def accepted(self, x: Array) -> bool:
        """Called with the positions after every step of Newton's method; whether the energy is another one now."""
        return False


@dataclass(frozen=True, eq=False)
class Gravity(Potential):
    """W = - sum_i m_i g . (x_i - X_i). mass: (n_nodes,) [kg]; acceleration: g (dim,) [m/s^2]; rest: X
    (n_nodes, dim)."""

    mass: Array
    acceleration: Array
    rest: Array

    @cached_property
    def _weight(self) -> Array:
        """(n_nodes, dim) [N]"""
        return self.mass[:, None] * self.acceleration

    def energy(self, x: Array) -> float:
        return -float(np.vdot(self._weight, x - self.rest))

    def gradient(self, x: Array) -> Array:
        return -self._weight

    def add_hessian(self, x: Array, matrix: BlockMatrix, convex: bool) -> None:
        """Nothing: the energy is linear in x."""


@dataclass(frozen=True, eq=False)
class Inertia(Potential):
    """W = 1/(2 h^2) sum_i m_i |x_i - x*_i|^2, thesis eq. 5.5. predicted: x* = x_old + h v_old; time_step: h
    [s]."""

    mass: Array
    predicted: Array
    time_step: float

    def energy(self, x: Array) -> float:
        return 0.5 / self.time_step**2 * float(self.mass @ ((x - self.predicted) ** 2).sum(axis=1))

    def gradient(self, x: Array) -> Array:
        return (self.mass / self.time_step**2)[:, None] * (x - self.predicted)

    def add_hessian(self, x: Array, matrix: BlockMatrix, convex: bool) -> None:
        matrix.add_diagonal(np.arange(len(x)), (self.mass / self.time_step**2)[:, None, None])


@dataclass(frozen=True, eq=False)
class LinearSpring(Potential):
    """W = k/2 |w^T x - target|^2: a spring [N/m] on a weighted sum of nodes. weights: w (n_nodes,); target:
    (dim,) [m].

    With the mean of a region it acts on its centroid; with a row of the region's least-squares fit, on its
    orientation.
    """

    weights: Array
    stiffness: float
    target: Array

    def energy(self, x: Array) -> float:
        return 0.5 * self.stiffness * float(((self.weights @ x - self.target) ** 2).sum())

    def gradient(self, x: Array) -> Array:
        return self.stiffness * self.weights[:, None] * (self.weights @ x - self.target)

    def add_hessian(self, x: Array, matrix: BlockMatrix, convex: bool) -> None:
        matrix.add_low_rank(self.weights, self.stiffness)
