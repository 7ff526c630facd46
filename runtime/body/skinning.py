"""Linear blend skinning as the subspace basis, as articulated hands and bodies have it (SMPL, MANO): a node follows a
weighted mean of the bones, with bounded biharmonic weights (Jacobson et al. 2011)."""

from __future__ import annotations

import igl
import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.handles import Handles
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import Mesh


def skinning_basis(mesh: Mesh, handles: Handles) -> Array:
    """U (n_nodes, n_rows): reduced positions are U @ rows, x = sum_b w_b(X) (X R_b^T + t_b), with exact affine
    reproduction.

    Raises SoftprintError for point handles: blending knows rigid frames only.
    """
    if handles.n_points or not handles.frames:
        raise SoftprintError(
            f"body.handles: linear blend skinning blends rigid frames and has no points; there are "
            f"{handles.n_points} points and {len(handles.frames)} frames: set points = 0, and give frames"
        )
    weights = skinning_weights(mesh, handles)
    affine = np.column_stack([mesh.points, np.ones(mesh.n_nodes)])
    return np.asarray((weights[:, :, None] * affine[:, None, :]).reshape(mesh.n_nodes, handles.n_rows))


def skinning_weights(mesh: Mesh, handles: Handles) -> Array:
    """(n_nodes, n_frames) in [0, 1], rows of sum 1: smooth, and 1 in the frame's own region."""
    frames = handles.frames
    nodes = np.concatenate([frame.nodes for frame in frames])
    owner = np.repeat(np.arange(len(frames)), [len(frame.nodes) for frame in frames])
    if len(np.unique(nodes)) < len(nodes):
        raise SoftprintError("body: two frames share a node: they must not overlap")
    if len(frames) == 1:
        return np.ones((mesh.n_nodes, 1))
    own = np.asarray(igl.bbw(mesh.points, mesh.cells, nodes, np.eye(len(frames))[owner]))
    if own.shape != (mesh.n_nodes, len(frames)) or not np.isfinite(own).all():
        raise SoftprintError(
            f"body: no bounded biharmonic weights for {len(frames)} frames: the mesh needs well-shaped cells"
        )
    # libigl solves for each frame alone, and leaves it to us to normalise.
    own = np.clip(own, 0.0, 1.0)
    own[nodes] = np.eye(len(frames))[owner]
    total = own.sum(axis=1, keepdims=True)
    if total.min() < 0.5:
        raise SoftprintError("body: parts of the mesh are connected to no frame: give each piece one")
    return np.asarray(own / total)
