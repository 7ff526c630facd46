"""The only module that depends on the installed DOLFINx version: 0.5 (Debian 12) or 0.9 (Debian 13).

All other code gets meshes, spaces, compiled forms and assembled arrays from these functions.
"""

from __future__ import annotations

import ctypes
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import dolfinx
import dolfinx.fem
import dolfinx.fem.petsc
import numpy as np
import ufl
from dolfinx.mesh import create_mesh
from mpi4py import MPI
from petsc4py import PETSc

from softprint.fem_truth.elasticity.form_cache import form_cache
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.mesh import Mesh

# Untyped, because each release has names that the other lacks.
dfx: Any = dolfinx
fem: Any = dolfinx.fem
fem_petsc: Any = dolfinx.fem.petsc

NEW_NAMES = not hasattr(fem, "VectorFunctionSpace")  # removed in 0.8; 0.9 has basix.ufl and `functionspace`
JIT_OPTIONS = {"cffi_extra_compile_args": ["-O3", "-march=native", "-g0"]}
_CELL_NAMES = {2: "triangle", 3: "tetrahedron"}


def make_mesh(mesh: Mesh) -> Any:
    """A serial DOLFINx mesh of the same cells; DOLFINx renumbers cells and nodes, see `orderings`."""
    cell, cells = _CELL_NAMES[mesh.dim], np.asarray(mesh.cells, dtype=np.int64)
    points = np.ascontiguousarray(mesh.points, dtype=float)
    if NEW_NAMES:
        from basix.ufl import element

        domain = ufl.Mesh(element("Lagrange", cell, 1, shape=(mesh.dim,)))
        return create_mesh(MPI.COMM_SELF, cells, points, domain)
    domain = ufl.Mesh(ufl.VectorElement("Lagrange", ufl.Cell(cell, geometric_dimension=mesh.dim), 1))
    return create_mesh(MPI.COMM_SELF, cells, points, domain)


def vector_space(domain: Any, dim: int, degree: int = 1) -> Any:
    """Space of continuous displacements, piecewise polynomials of this degree."""
    if NEW_NAMES:
        return fem.functionspace(domain, ("Lagrange", degree, (dim,)))
    return _compiled_space(domain, ufl.VectorElement("Lagrange", domain.ufl_cell(), degree))


def cell_space(domain: Any) -> Any:
    """Space of functions that are constant in each cell."""
    if NEW_NAMES:
        return fem.functionspace(domain, ("DG", 0))
    return _compiled_space(domain, ufl.FiniteElement("DG", domain.ufl_cell(), 0))


def _compiled_space(domain: Any, element: Any) -> Any:
    """The space; DOLFINx 0.5 compiles its element too."""
    with form_cache() as folder:
        return fem.FunctionSpace(domain, element, jit_params={"cache_dir": str(folder)})


def orderings(domain: Any, space: Any, cell_values: Any, mesh: Mesh) -> tuple[IntArray, IntArray]:
    """Maps from DOLFINx's numbering to that of `mesh`.

    Returns node_of_dof (n_nodes,): the node of `mesh` at each block of unknowns of the P1 `space`; and
    cell_of_dof (n_cells,): the cell of `mesh` at each unknown of the cell space `cell_values`.
    """
    original_cell = np.asarray(domain.topology.original_cell_index)
    cell_dofs = _dof_table(cell_values, mesh.n_cells)[:, 0]
    cell_of_dof = np.empty(mesh.n_cells, dtype=np.int64)
    cell_of_dof[cell_dofs] = original_cell

    geometry_nodes = _geometry_table(domain, mesh.n_cells)
    node_dofs = _dof_table(space, mesh.n_cells)
    original_node = np.asarray(domain.geometry.input_global_indices)
    node_of_dof = np.empty(mesh.n_nodes, dtype=np.int64)
    # Both tables list a P1 simplex's corners in the order of the reference cell, so they match entry by
    # entry.
    node_of_dof[node_dofs.ravel()] = original_node[geometry_nodes.ravel()]
    return node_of_dof, cell_of_dof


def _dof_table(space: Any, n_cells: int) -> IntArray:
    table = space.dofmap.list
    return np.asarray(table if NEW_NAMES else table.array).reshape(n_cells, -1)


def _geometry_table(domain: Any, n_cells: int) -> IntArray:
    table = domain.geometry.dofmap
    return np.asarray(table if NEW_NAMES else table.array).reshape(n_cells, -1)


def compile_form(form: ufl.Form) -> Any:
    """Compile a UFL form to native code, or load it from the cache.

    A compilation takes a second or two; other processes that need a form meanwhile wait.
    """
    with form_cache() as folder:
        options = {**JIT_OPTIONS, "cache_dir": str(folder)}
        return fem.form(form, jit_options=options) if NEW_NAMES else fem.form(form, jit_params=options)


@contextmanager
def quiet_compiler() -> Iterator[None]:
    """Keep distutils from logging every call of the C compiler, and from configuring the root logger for it."""
    root = logging.getLogger()
    level, handlers, disabled = root.level, root.handlers[:], root.manager.disable
    logging.disable(logging.INFO)
    try:
        yield
    finally:
        logging.disable(disabled)
        root.setLevel(level)
        root.handlers[:] = handlers


def assemble_scalar(form: Any) -> float:
    return float(fem.assemble_scalar(form))


class VectorAssembler:
    """Assembles one compiled linear form repeatedly into the same array of unknowns."""

    def __init__(self, form: Any) -> None:
        self._form = form
        self._vector = fem_petsc.create_vector(form)

    def __call__(self) -> Array:
        """The assembled vector (n_unknowns,): a view that the next call overwrites."""
        with self._vector.localForm() as local:
            local.set(0.0)
        fem_petsc.assemble_vector(self._vector, self._form)
        return np.asarray(self._vector.array_r)


class BlockMatrixAssembler:
    """Assembles one compiled bilinear form into a PETSc BAIJ matrix and gives access to its blocks without a copy.

    row_starts (n+1,), columns (n_blocks,): the block pattern, in the order of the blocks.
    """

    def __init__(self, form: Any) -> None:
        self._form = form
        self.matrix = fem_petsc.create_matrix(form, "baij")
        self.assemble()
        # PETSc owns the two arrays: keep copies.
        starts, columns = self.matrix.getRowIJ(compressed=True)
        self.row_starts, self.columns = starts.copy(), columns.copy()
        self.block_size = int(self.matrix.getBlockSize())

    def assemble(self) -> None:
        self.matrix.zeroEntries()
        fem_petsc.assemble_matrix(self.matrix, self._form)
        self.matrix.assemble()

    def blocks(self) -> Array:
        """(n_blocks, b, b) assembled blocks, a view that the next assembly overwrites. BAIJ stores each block
        column by column, hence the transpose.

        petsc4py has no accessor for the values of a BAIJ matrix, so PETSc's C function is called.
        """
        values = ctypes.POINTER(ctypes.c_double)()
        error = _petsc_library().MatSeqBAIJGetArray(ctypes.c_void_p(self.matrix.handle), ctypes.byref(values))
        if error:
            raise RuntimeError(
                f"PETSc could not give the blocks of its matrix (MatSeqBAIJGetArray: error {error})"
            )
        size = self.block_size
        flat = np.ctypeslib.as_array(values, shape=(len(self.columns), size, size))
        return flat.transpose(0, 2, 1)


def _petsc_library() -> ctypes.CDLL:
    if np.dtype(PETSc.ScalarType) != np.float64:
        raise RuntimeError("Softprint needs a PETSc with real double precision scalars")
    return ctypes.CDLL(PETSc.__file__)  # the extension module links libpetsc, whose symbols it resolves


def versions() -> dict[str, str]:
    """Versions of the finite element stack, for provenance."""
    petsc = ".".join(str(part) for part in PETSc.Sys.getVersion())
    return {"dolfinx": dfx.__version__, "petsc": petsc, "ufl": ufl.__version__}
