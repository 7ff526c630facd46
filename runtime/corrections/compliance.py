"""How the body gives way, at rest, to forces on its surface that the subspace cannot feel.

The contact displacement of the truth is an equilibrium in the null space of U (thesis 5.3.3). Linearised at
rest, it is

    u = G f,    G = A - A Q (Q^T A Q)^-1 Q^T A,    A = K^-1,

K being the elastic stiffness of the nodes outside rigid frames, Q a basis of the columns of U there, and f
the nodal forces. G is symmetric, U^T G = 0, and it belongs to the body alone: it is computed once. At a
deformed state it is carried along by the local deformation F,

    u_X = F_X sum_j G_Xj F_j^T f_j,

which keeps it symmetric (forces do the work that displacements receive) and turns with the body.

Columns are kept for *loads*: at most so many points of the surface, each standing for the area nearest to it,
over which its force is spread.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from runtime.arrays import Array, IntArray
from runtime.body.body import ReducedBody
from runtime.body.farthest_points import farthest_points
from runtime.errors import SoftprintError

# Columns solved at a time, to bound memory.
_COLUMNS = 240
# Keeps K invertible for a body without rigid frames, relative to its mean diagonal; rigid motions are then
# taken out by the constraint. Far below the accuracy of the float32 in which G is kept.
_SHIFT = 1e-9


@dataclass(frozen=True, eq=False)
class Compliance:
    """G of a body. nodes: (n_loads,) load nodes; areas: (n_loads,) [m^(dim-1)]; operator: (n_loads, dim,
    n_nodes, dim) float32 [m/N], displacement of every node per unit force on a load, in rest coordinates."""

    nodes: IntArray
    areas: Array
    operator: NDArray[np.float32]


def compute_compliance(
    body: ReducedBody, at_most: int, progress: Callable[[int], None] | None = None
) -> Compliance:
    """G for at most so many loads, chosen by farthest point. progress: called with the number of loads
    done."""
    nodes, areas, spread = _loads(body, at_most)
    free = np.setdiff1d(np.arange(body.n_nodes), body.handles.frame_nodes)
    dim, n_loads = body.dim, len(nodes)
    unknowns = (free[:, None] * dim + np.arange(dim)).ravel()
    stiffness = rest_stiffness(body)[unknowns][:, unknowns]
    shift = _SHIFT * stiffness.diagonal().mean()
    factor = splu(
        (stiffness + shift * sp.identity(len(unknowns))).tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    left, singular, _ = np.linalg.svd(body.basis[free], full_matrices=False)
    constraint = np.kron(left[:, singular > 1e-10 * singular[0]], np.eye(dim))
    deflected = factor.solve(constraint)
    lagrange = np.linalg.inv(constraint.T @ deflected)
    forces = sp.kron(spread[:, free], sp.identity(dim), format="csr")
    operator = np.zeros((n_loads, dim, body.n_nodes, dim), dtype=np.float32)
    step = max(1, _COLUMNS // dim)
    for start in range(0, n_loads, step):
        chosen = slice(start, min(start + step, n_loads))
        response = factor.solve(forces[chosen.start * dim : chosen.stop * dim].T.toarray())
        response -= deflected @ (lagrange @ (constraint.T @ response))
        columns = response.T.reshape(-1, dim, len(free), dim)
        operator[chosen, :, free, :] = columns
        if progress is not None:
            progress(len(columns))
    return Compliance(nodes, areas, operator)


def rest_stiffness(body: ReducedBody) -> sp.csr_matrix:
    """(n_nodes dim, n_nodes dim) K = d2W_elastic/dx2 at rest [N/m]."""
    mesh, dim = body.mesh, body.dim
    rest = np.broadcast_to(np.eye(dim), (mesh.n_cells, dim, dim)).copy()
    tangent = body.material.tangent(rest)
    gradients = mesh.cell_gradients
    cells = np.einsum(
        "c,caj,cijkl,cbl->caibk", mesh.cell_volumes, gradients, tangent, gradients, optimize=True
    )
    size = (dim + 1) * dim
    dofs = (mesh.cells[:, :, None] * dim + np.arange(dim)).reshape(-1, size)
    entries = (np.repeat(dofs, size, axis=1).ravel(), np.tile(dofs, (1, size)).ravel())
    shape = (mesh.n_nodes * dim, mesh.n_nodes * dim)
    return sp.coo_matrix((cells.ravel(), entries), shape=shape).tocsr()


def _loads(body: ReducedBody, at_most: int) -> tuple[IntArray, Array, sp.csr_matrix]:
    """Load nodes, their areas, and how each spreads its force: (n_loads, n_nodes), rows that sum to one."""
    mesh = body.mesh
    outside = ~np.isin(mesh.surface_nodes, body.handles.frame_nodes)
    candidates, areas = mesh.surface_nodes[outside], mesh.surface_areas[outside]
    if not len(candidates):
        raise SoftprintError(
            f"body {body.name!r}: all of its surface lies in rigid frames, where nothing gives way"
        )
    nodes = candidates
    if len(candidates) > at_most:
        nodes = candidates[np.sort(farthest_points(mesh.points[candidates], at_most))]
    _, nearest = cKDTree(mesh.points[nodes]).query(mesh.points[candidates])
    total = np.bincount(nearest, areas, minlength=len(nodes)).astype(np.float64)
    spread = sp.csr_matrix((areas / total[nearest], (nearest, candidates)), shape=(len(nodes), mesh.n_nodes))
    return nodes, total, spread
