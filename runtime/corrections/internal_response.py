"""How the body settles where the subspace cannot follow: its internal equilibrium, linear in the reduced state.

At a reduced state q the truth is not U q but U q + u, with u the free equilibrium in the null space of U (thesis
5.3.3, without contact). To first order about rest, with the null-space response G of `rest_response.py`, the
stiffness K at rest and the lumped masses m,

    u = L (q - q_rest) + w g,        L = -G K U,    w = G m,

so that U + L are the modes of static condensation (Guyan 1965). L annihilates translations and infinitesimal
rotations. A rotation R of the body as a whole, the *turn*, is taken out first,

    u = R [L (R^T q - q_rest) + w R^T g],        R = polar factor of the volume mean of the deformation gradient,

so that u turns with the body. The turn is an argument everywhere: with it frozen, as within a time step, u is affine
in the *strain* d = R^T q - q_rest. All of this belongs to the body and to gravity alone; nothing is learned.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array, IntArray
from runtime.body.body import ReducedBody
from runtime.body.rotations import nearest_rotation
from runtime.corrections import internal_kernels
from runtime.corrections.rest_response import RestResponse, rest_stiffness

_PREFIX = "internal."


@dataclass(frozen=True, eq=False)
class InternalResponse:
    """u of n nodes of a body.

    modes: L (n, dim, n_rows, dim); weight: w (n, dim, dim) [s^2]; both float32, for every evaluation reads all of
    them. gravity: g (dim,) [m/s^2]; rest_rows: q_rest (n_rows, dim); mean_gradient: (n_rows, dim) [1/m] volume mean
    of the basis gradient, so that the mean deformation gradient is rows^T mean_gradient; positions: (n_rows,) 1 for
    rows that are positions, 0 for those of the rotations of frames, so that a translation t moves rows by
    positions (x) t.
    """

    modes: NDArray[np.floating[Any]]
    weight: NDArray[np.floating[Any]]
    gravity: Array
    rest_rows: Array
    mean_gradient: Array
    positions: Array

    def __len__(self) -> int:
        return len(self.modes)

    def turn(self, rows: Array) -> Array:
        """R (dim, dim), the rotation of the body as a whole at handle rows (n_rows, dim)."""
        return nearest_rotation(rows.T @ self.mean_gradient)

    def displacement(self, rows: Array, turn: Array, index: IntArray | None = None) -> Array:
        """u (m, dim) [m] of some of the nodes (all by default), world frame."""
        kind, dim = self.modes.dtype, len(turn)
        strain = self.strain(rows, turn).astype(kind).ravel()
        hanging = (self.gravity @ turn).astype(kind)
        if index is not None:
            return internal_kernels.displacement(self.modes, self.weight, index, strain, hanging, turn)
        u = self.modes.reshape(-1, strain.size) @ strain + self.weight.reshape(-1, dim) @ hanging
        return np.asarray(u.astype(np.float64).reshape(-1, dim) @ turn.T)

    def reach(self, rows: Array, turn: Array) -> Array:
        """(n,) [m], what |u| does not exceed: |u| <= |L| |d| + |w| |g|, in Euclidean and spectral norms."""
        by_strain, by_gravity = self._norms
        return by_strain * np.linalg.norm(self.strain(rows, turn)) + by_gravity

    def strain(self, rows: Array, turn: Array) -> Array:
        """d (n_rows, dim), less its mean translation, which strains nothing and would only be rounded: a body may
        be far from where it began."""
        strain = rows @ turn - self.rest_rows
        return np.asarray(strain - np.outer(self.positions, self._mean @ strain))

    def derivative(self, turn: Array, index: IntArray | None = None) -> Array:
        """du_a/drows_rb (m, dim, n_rows, dim) of some of the nodes (all by default), the turn held; world frame."""
        index = np.arange(len(self)) if index is None else index
        return internal_kernels.derivative(self.modes, index, self._mean, self.positions, turn)

    def at(self, nodes: IntArray) -> InternalResponse:
        """The response of some of the nodes, by their numbers here."""
        modes, weight = np.ascontiguousarray(self.modes[nodes]), np.ascontiguousarray(self.weight[nodes])
        return replace(self, modes=modes, weight=weight)

    def under(self, gravity: Array) -> InternalResponse:
        """The same body under another gravity (dim,) [m/s^2]."""
        return replace(self, gravity=gravity)

    @cached_property
    def _mean(self) -> Array:
        """(n_rows,) the mean of rows that are positions."""
        return np.asarray(self.positions / self.positions.sum())

    @cached_property
    def _norms(self) -> tuple[Array, Array]:
        """Spectral norms (n,) of L, and those of w times |g|."""
        n, dim, _, _ = self.modes.shape
        modes = np.linalg.norm(self.modes.reshape(n, dim, -1).astype(np.float64), 2, axis=(1, 2))
        weight = np.linalg.norm(self.weight.astype(np.float64), 2, axis=(1, 2))
        return modes, weight * float(np.linalg.norm(self.gravity))


def compute_internal_response(
    body: ReducedBody, gravity: Sequence[float] | Array | None, response: RestResponse
) -> InternalResponse:
    """Of all nodes of the body: n_rows*dim + dim solves. gravity: (dim,) [m/s^2]; response: of the same body."""
    dim, size = body.dim, body.n_rows * body.dim
    identity = np.eye(dim)
    spread = np.einsum("nr,ab->narb", body.basis, identity).reshape(-1, size)
    forces = -(rest_stiffness(body) @ spread).reshape(body.n_nodes, dim, size)
    weights = body.node_mass[:, None, None] * identity
    mesh = body.mesh
    share = np.zeros_like(mesh.points)  # int of the gradient of every hat function
    np.add.at(share, mesh.cells, mesh.cell_volumes[:, None, None] * mesh.cell_gradients)
    return InternalResponse(
        response.solve(forces).astype(np.float32).reshape(body.n_nodes, dim, body.n_rows, dim),
        response.solve(weights).astype(np.float32),
        np.zeros(dim) if gravity is None else np.array(gravity, dtype=np.float64),
        body.rest_rows,
        body.basis.T @ share / mesh.cell_volumes.sum(),
        body.handles.affine_part,
    )


def internal_arrays(response: InternalResponse) -> dict[str, NDArray[np.floating[Any]]]:
    """Named arrays for a correction file."""
    return {_PREFIX + field.name: getattr(response, field.name) for field in fields(response)}


def take_internal(arrays: dict[str, Any]) -> InternalResponse | None:
    """Takes the arrays (or torch tensors) of `internal_arrays` out of those of a file; None where it has none."""
    names = [field.name for field in fields(InternalResponse)]
    if not any(_PREFIX + name in arrays for name in names):
        return None
    own: Mapping[str, Any] = {name: np.asarray(arrays.pop(_PREFIX + name)) for name in names}
    return InternalResponse(**own)
