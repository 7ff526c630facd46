"""Spread compliance: the displacement of the body, at rest, by forces that are spread in it under its surface.

In equilibrium with forces f on its surface, f_int(u) = f, a body is displaced as linear mechanics has it by others,

    u = G (f + K u - f_int(u)),

with the null-space compliance G (`null_space_compliance.py`): by forces *in* the body as well, where linear mechanics
misses its stress. That is around a dent, as far as it is strained. They are built from forces on balls of material
around contact nodes a,

    G~_Xj = sum_a P_ja sum_Y b_aY G_XY,    b_aY ~ V_Y (1 - |Y - X_a|^2 / r^2)^2 within r,    sum_Y b_aY = 1,

with volumes V_Y of the nodes outside rigid frames, and shares P of the anchors a of the surface compliance, of which G~
is one as well, without a near part. r is half the distance of handles, which is as wide as what the subspace lacks. On
the small Jelly that is 13 mm; with 14 and 20 mm learned corrections are equally good, with 7 and 28 mm worse, and with
forces that are spread along the surface alone, too.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.mechanics.compliance.columns import all_columns
from softprint.runtime.mechanics.compliance.null_space_compliance import NullSpaceCompliance
from softprint.runtime.mechanics.compliance.surface_compliance import SurfaceCompliance, surface_interpolation

# r, in distances of handles (V / n_handles)^(1/dim).
_REACH = 0.5


def compute_spread_compliance(
    body: ReducedBody,
    response: NullSpaceCompliance,
    surface: SurfaceCompliance,
    progress: Callable[[int], None] | None = None,
) -> SurfaceCompliance:
    """G~ for the contact nodes of the surface compliance of a body. progress: called with the number of columns done,
    one for each anchor."""
    balls = ball_weights(body, body.mesh.points[surface.nodes[surface.anchors]], reach(body))
    operator = all_columns(response, balls, progress)
    rest, n_contact = body.mesh.points[surface.nodes], len(surface.nodes)
    nothing = sp.csr_matrix((n_contact * body.dim, body.mesh.points.size), dtype=np.float32)
    share = surface_interpolation(rest, surface.anchors)
    return SurfaceCompliance(surface.nodes, surface.areas, surface.anchors, operator, share, nothing)


def reach(body: ReducedBody) -> float:
    """r [m]."""
    handles = body.handles.n_points + len(body.handles.frames)
    return float(_REACH * (body.mesh.cell_volumes.sum() / handles) ** (1.0 / body.dim))


def ball_weights(body: ReducedBody, centres: Array, radius: float) -> sp.csr_matrix:
    """b (k, n_nodes) of balls around centres (k, dim) [m], with rows that sum to one: there is a node outside rigid
    frames at each centre."""
    rest, volumes = body.mesh.points, body.mesh.node_volumes
    free = np.setdiff1d(np.arange(len(rest)), body.handles.frame_nodes)
    within = cKDTree(rest[free]).query_ball_point(centres, radius)
    row = np.repeat(np.arange(len(centres)), [len(part) for part in within])
    node = free[np.concatenate(within).astype(np.int64)]
    squared = np.square(rest[node] - centres[row]).sum(axis=1) / radius**2
    weight = volumes[node] * (1.0 - squared) ** 2
    total = np.bincount(row, weight, minlength=len(centres))
    return sp.csr_matrix((weight / total[row], (row, node)), shape=(len(centres), len(rest)))
