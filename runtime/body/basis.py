"""The subspace basis: biharmonic generalised barycentric coordinates (BGBC, Wang et al. 2015)."""

from __future__ import annotations

import igl
import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.handles import Handles
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import Mesh

# Affine maps are reproduced to about 1e-12 of the body's size; the error of a failed factorisation is far larger.
_AFFINE_TOLERANCE = 1e-6


def biharmonic_basis(mesh: Mesh, handles: Handles) -> Array:
    """U (n_nodes, n_rows): reduced positions are U @ rows (thesis eq. 4.1), with exact affine reproduction.

    Minimises the squared linearly precise Laplacian subject to interpolation at point handles and in frame
    regions. Weights may be negative. Raises SoftprintError where the handles do not determine the
    minimiser.
    """
    regions = [[int(node)] for node in handles.points] + [frame.nodes.tolist() for frame in handles.frames]
    handle_nodes = np.concatenate([handles.points, handles.frame_nodes])
    if len(np.unique(handle_nodes)) < len(
        handle_nodes
    ):  # libigl does not check this, and corrupts its memory
        raise SoftprintError("body: two handles share a node: point handles and frames must not overlap")
    basis = np.ascontiguousarray(igl.biharmonic_coordinates(mesh.points, mesh.cells, regions, 2))
    # On failure libigl returns an empty array; for a nearly singular system, weights that do not reproduce the rest
    # shape.
    if basis.shape != (mesh.n_nodes, handles.n_rows) or not np.isfinite(basis).all():
        raise SoftprintError(
            f"body: no biharmonic coordinates for {handles.n_points} points and {len(handles.frames)} "
            f"frames: there must "
            f"be a frame or at least {mesh.dim + 1} points in general position, and well-shaped cells"
        )
    error = np.abs(basis @ handles.rest_rows(mesh.points) - mesh.points).max()
    if error > _AFFINE_TOLERANCE * mesh.size:
        raise SoftprintError(
            f"body: the biharmonic coordinates reproduce the rest shape only to {error:.1e} m: the handles "
            f"are too few or "
            "nearly in a line or plane, or the mesh has nearly flat cells"
        )
    return basis
