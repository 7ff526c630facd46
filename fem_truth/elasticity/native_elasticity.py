"""The elastic energy of a whole body in compiled loops over its cells (`native/elastic.c`): ten times faster than
assembled forms, and equal to round-off. For materials that are functions of I_C and J."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import numpy as np

from softprint.fem_truth.linalg.block_matrix import BlockMatrix, BlockPattern, UpperBlocks
from softprint.fem_truth.native.library import load_library
from softprint.runtime.arrays import Array
from softprint.runtime.elasticity.materials import Material
from softprint.runtime.mesh import Mesh

#: Material models and their headers, with which `native/elastic.c` is compiled.
KERNELS = frozenset(header.stem for header in (Path(__file__).parent.parent / "native").glob("*.h"))

_LANES = 8  # cells processed together, as in elastic.c


class _Cells(ctypes.Structure):
    """The struct `Cells` of elastic.c."""

    _fields_ = (
        ("groups", ctypes.c_int64),
        *[(name, ctypes.c_void_p) for name in ("corners", "pairs", "gradients", "mu", "lambda")],
    )


class NativeElasticity:
    """W(x) [J] and its derivatives at node positions x (n_nodes, dim) [m]."""

    def __init__(self, mesh: Mesh, material: Material) -> None:
        self._n_nodes, self._dim = mesh.n_nodes, mesh.dim
        # With corners in ascending order, the block of corners a < b is above the diagonal.
        order = np.argsort(mesh.cells, axis=1)
        corners = np.take_along_axis(mesh.cells, order, axis=1)
        gradients = np.take_along_axis(mesh.cell_gradients, order[:, :, None], axis=1)
        first, second = np.triu_indices(mesh.dim + 1, 1)
        pairs = np.stack([corners[:, first], corners[:, second]], axis=-1)
        self.pattern, blocks = BlockPattern.from_pairs(pairs, mesh.n_nodes)
        moduli = (values * mesh.cell_volumes for values in (material.mu, material.lam))
        self._arrays = [
            *(_in_groups(values.astype(np.int32)) for values in (corners, blocks)),
            _in_groups(gradients[:, 1:]),
            # Padding cells in the last group have no weight.
            *(_in_groups(values, 0.0) for values in moduli),
        ]
        self._cells = _Cells(len(self._arrays[0]), *(array.ctypes.data for array in self._arrays))
        library = load_library("elastic.c", DIM=mesh.dim, DENSITY=f'"{material.model}.h"')
        address = ctypes.c_void_p
        self._energy_gradient, self._hessian = library.energy_gradient, library.hessian
        self._energy_gradient.argtypes = self._hessian.argtypes = [address] * 4
        self._energy_gradient.restype, self._hessian.restype = ctypes.c_double, None

    def energy(self, x: Array) -> float:
        """W(x) [J]."""
        return self._evaluate(x, None)[0]

    def min_det_F(self, x: Array) -> float:
        """The smallest volume ratio of a cell."""
        return self._evaluate(x, None)[1]

    def energy_gradient(self, x: Array) -> tuple[float, Array]:
        """W [J] and dW/dx (n_nodes, dim) [N]."""
        gradient = np.zeros((self._n_nodes, self._dim))
        return self._evaluate(x, gradient)[0], gradient

    def hessian(self, x: Array) -> BlockMatrix:
        """d2W/dx2 as blocks [N/m]."""
        x, dim = np.ascontiguousarray(x, dtype=float), self._dim
        diagonal = np.zeros((self._n_nodes, dim, dim))
        upper = np.zeros((len(self.pattern.columns) + 1, dim, dim))
        self._hessian(ctypes.addressof(self._cells), x.ctypes.data, diagonal.ctypes.data, upper.ctypes.data)
        return BlockMatrix(UpperBlocks(self.pattern, upper), diagonal)

    def _evaluate(self, x: Array, gradient: Array | None) -> tuple[float, float]:
        x, least = np.ascontiguousarray(x, dtype=float), ctypes.c_double()
        energy = self._energy_gradient(
            ctypes.addressof(self._cells),
            x.ctypes.data,
            None if gradient is None else gradient.ctypes.data,
            ctypes.addressof(least),
        )
        return float(energy), least.value


def _in_groups(values: Any, filler: Any = None) -> Any:
    """Values of cells (n_cells, ...) as (groups, number, lanes). The last group is padded with the first cell's
    values, or with the filler."""
    numbers = values.reshape(len(values), -1)
    missing = -len(values) % _LANES
    more = (
        np.repeat(numbers[:1], missing, axis=0)
        if filler is None
        else np.full((missing, numbers.shape[1]), filler)
    )
    filled = np.concatenate([numbers, more])
    return np.ascontiguousarray(filled.reshape(-1, _LANES, numbers.shape[1]).transpose(0, 2, 1))
