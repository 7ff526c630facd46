"""What is done with a compliance in every step, compiled: of its matrices only what some tens of loads need is read."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array, IntArray
from runtime.compiled import compiled, summing


@summing
def apply(
    loads: IntArray,
    forces: NDArray[Any],
    operator: NDArray[np.float32],
    share: tuple[NDArray[np.int32], NDArray[np.int32], Array],
    near: tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]],
) -> NDArray[Any]:
    """sum_j G_Xj forces_j, flat: (n_nodes*dim,) in the type of forces (m, dim), on the loads (m,).

    operator: (n_anchors, dim, n_nodes*dim); share, near: row starts, columns and entries of P and N^T of
    `SurfaceCompliance`.
    """
    n_anchors, dim, size = operator.shape
    total = np.zeros(size, dtype=forces.dtype)
    shared = np.zeros((n_anchors, dim), dtype=forces.dtype)
    starts, columns, entries = near
    for j in range(len(loads)):
        for entry in range(share[0][loads[j]], share[0][loads[j] + 1]):
            shared[share[1][entry]] += share[2][entry] * forces[j]
        # The rows of one load have their entries in the same columns.
        first = starts[loads[j] * dim]
        count = starts[loads[j] * dim + 1] - first
        for i in range(dim):
            row, force = entries[first + i * count : first + (i + 1) * count], forces[j, i]
            for entry in range(count):
                total[columns[first + entry]] += row[entry] * force
    for anchor in range(n_anchors):
        force = shared[anchor]
        if not force.any():
            continue
        column = operator[anchor]
        # All of them at once, for it is the memory that takes the time.
        if dim == 3:
            for at in range(size):
                total[at] += force[0] * column[0, at] + force[1] * column[1, at] + force[2] * column[2, at]
        else:
            for at in range(size):
                total[at] += force[0] * column[0, at] + force[1] * column[1, at]
    return total


@compiled
def gathered(pairs: NDArray[np.float32], loads: IntArray) -> NDArray[np.float32]:
    """G (m*dim, m*dim) [m/N] among the loads (m,); pairs: G (n_loads, n_loads, dim, dim)."""
    m, dim = len(loads), pairs.shape[2]
    result = np.empty((m, dim, m, dim), dtype=pairs.dtype)
    for i in range(m):
        for j in range(m):
            G = pairs[loads[i], loads[j]]
            for a in range(dim):
                # In 2D the second is taken twice.
                result[i, a, j, 0], result[i, a, j, 1] = G[a, 0], G[a, 1]
                result[i, a, j, dim - 1] = G[a, dim - 1]
    return result.reshape(m * dim, m * dim)


@summing
def displacement(pairs: NDArray[np.float32], at: IntArray, loads: IntArray, forces: Array) -> Array:
    """sum_j G_ij phi_j (n, dim) [m] at the loads `at` (n,) by forces (m, dim) on the loads (m,); pairs: as for
    `gathered`."""
    n, dim = len(at), pairs.shape[2]
    result = np.zeros((n, dim))
    for i in range(n):
        for j in range(len(loads)):
            G = pairs[at[i], loads[j]]
            for a in range(dim):
                for b in range(dim):
                    result[i, a] += G[a, b] * forces[j, b]
    return result


@summing
def turned(given: NDArray[Any], basis_gradient: NDArray[Any], rows: NDArray[Any]) -> Array:
    """F v (n, dim) of displacements v = given (n, dim) in rest coordinates, F_aj = sum_r rows_ra dU_rj; basis_gradient:
    dU_r/dX_j (n, dim, n_rows) over (j, r); all in one precision."""
    n, dim, n_rows = basis_gradient.shape
    columns = np.ascontiguousarray(rows.T)
    result = np.empty((n, dim))
    along = np.empty(n_rows, dtype=given.dtype)
    for i in range(n):
        along[:] = given[i, 0] * basis_gradient[i, 0]
        for j in range(1, dim):
            for r in range(n_rows):
                along[r] += given[i, j] * basis_gradient[i, j, r]
        for a in range(dim):
            entry = along[0] * columns[a, 0]
            for r in range(1, n_rows):
                entry += along[r] * columns[a, r]
            result[i, a] = entry
    return result
