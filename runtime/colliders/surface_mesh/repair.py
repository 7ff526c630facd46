"""From a triangle soup to a closed, outward-facing, manifold surface, or an error that says why not.

A signed distance needs a reliable sign, so ambiguous surfaces are refused and every repair is logged.
Self-intersections are not tested.
"""

from __future__ import annotations

import logging

import igl
import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.errors import SoftprintError

log = logging.getLogger(__name__)

# Vertices closer than this share of the bounding box's diagonal are merged: STL repeats each vertex in float32.
MERGE_DISTANCE = 1e-6
# Triangles thinner than this (height over diagonal) have no usable normal.
DEGENERATE_HEIGHT = 1e-9
# A surface whose vertices are nearer than this to a plane (RMS, over diagonal) is flat.
FLAT = 1e-7
# A hole is closed if its rim is shorter than this share of the diagonal; the shape of larger ones is unknown.
SMALL_HOLE = 0.25
# The remedy named in errors.
OR_REBUILD = "or have the surface rebuilt by `softprint collider FILE --out MENDED.stl`"
# Meshes with more separate surfaces are refused: finding which lies inside which would take too long.
MOST_PIECES = 1000


@np.errstate(over="ignore", invalid="ignore")  # absurd coordinates are refused below
def closed_surface(vertices: Array, triangles: IntArray, source: str) -> tuple[Array, IntArray]:
    """Vertices (v, 3) and triangles (t, 3) of the repaired surface, normals outward.

    `source` names the mesh in messages. Raises SoftprintError for non-finite or empty input, non-manifold
    edges, surfaces that cannot be oriented, and holes that are not small.
    """
    if not np.isfinite(vertices).all():
        bad = int((~np.isfinite(vertices)).any(axis=1).sum())
        raise SoftprintError(f"{source}: {bad} vertices are not finite numbers; export the mesh again")
    if len(triangles) == 0:
        raise SoftprintError(
            f"{source}: the mesh has no triangles; a closed triangle surface is needed"
        )
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    vertices, triangles = merge(vertices, triangles, diagonal, source)
    refuse_flat(vertices, source)
    triangles = drop_degenerate(vertices, triangles, diagonal, source)
    _refuse_non_manifold(triangles, source)
    triangles = _orient(triangles, source)
    vertices, triangles = _fill_small_holes(vertices, triangles, diagonal, source)
    return vertices, _face_outward(vertices, triangles, source)


def merge(vertices: Array, triangles: IntArray, diagonal: float, source: str) -> tuple[Array, IntArray]:
    """Merge coincident vertices; SoftprintError if all coincide."""
    if diagonal == 0:
        raise SoftprintError(f"{source}: all vertices lie at one point")
    cells = np.round((vertices - vertices.min(axis=0)) / (MERGE_DISTANCE * diagonal)).astype(np.int64)
    across = round(1.0 / MERGE_DISTANCE) + 2  # cells along an axis; one packed index sorts faster
    _, first, inverse = np.unique(
        cells @ np.array([across**2, across, 1]), return_index=True, return_inverse=True
    )
    merged = len(vertices) - len(first)
    if merged:
        log.debug("%s: merged %d duplicate vertices", source, merged)
    return vertices[first], inverse.reshape(-1)[triangles]


def drop_degenerate(vertices: Array, triangles: IntArray, diagonal: float, source: str) -> IntArray:
    """Triangles without degenerate and repeated ones; SoftprintError if none is left."""
    corners = vertices[triangles]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    keep = area > DEGENERATE_HEIGHT * diagonal * sides.max(axis=1)
    if not keep.all():
        log.warning("%s: dropped %d degenerate triangle(s)", source, int((~keep).sum()))
    kept: IntArray = triangles[keep]
    _, first = np.unique(corner_codes(kept), return_index=True)
    if len(first) < len(kept):
        log.warning("%s: dropped %d repeated triangle(s)", source, len(kept) - len(first))
    if len(first) == 0:
        raise SoftprintError(
            f"{source}: every triangle is degenerate; a closed triangle surface is needed"
        )
    unrepeated: IntArray = kept[np.sort(first)]
    return unrepeated


def corner_codes(triangles: IntArray) -> IntArray:
    """(t,) one number for each unordered set of three corners."""
    a, b, c = np.sort(triangles, axis=1).T
    count = int(triangles.max(initial=0)) + 1
    pair: IntArray = np.unique(a * count + b, return_inverse=True)[1]
    return pair.reshape(-1) * count + c


def edge_counts(triangles: IntArray) -> tuple[IntArray, IntArray]:
    """The edges (e, 2), and how many triangles each has (e,)."""
    edges = np.sort(_directed_edges(triangles), axis=1)
    vertices = int(triangles.max()) + 1
    unique, counts = np.unique(edges @ np.array([vertices, 1]), return_counts=True)
    return np.column_stack(np.divmod(unique, vertices)), counts


def at_shared_edges(triangles: IntArray) -> BoolArray:
    """(t,) which triangles have an edge that more than two triangles share."""
    edges, counts = edge_counts(triangles)
    codes = edges[counts > 2] @ np.array([int(triangles.max()) + 1, 1])
    own = np.sort(_directed_edges(triangles), axis=1) @ np.array([int(triangles.max()) + 1, 1])
    return np.isin(own, codes).reshape(-1, 3).any(axis=1)


def refuse_flat(vertices: Array, source: str) -> None:
    """Raises SoftprintError for a drawing, which has no inside. Vertices on a line are left to `drop_degenerate`."""
    scaled = vertices / max(float(np.abs(vertices).max()), float(np.finfo(float).tiny))
    least = FLAT * float(np.linalg.norm(np.ptp(scaled, axis=0))) * np.sqrt(len(scaled))
    # With three rows more, two points have three singular values, too.
    offsets = np.vstack([scaled - scaled.mean(axis=0), np.zeros((3, 3))])
    _, width, thickness = np.linalg.svd(offsets, compute_uv=False)
    if thickness <= least < width:
        raise SoftprintError(
            f"{source}: the drawing is flat, all its vertices lie in a plane; a solid has a thickness: give it a "
            "thickness in a modeller"
        )


def _refuse_non_manifold(triangles: IntArray, source: str) -> None:
    bad = int((edge_counts(triangles)[1] > 2).sum())
    if bad:
        raise SoftprintError(
            f"{source}: {bad} edge(s) belong to more than two triangles (non-manifold); "
            f"make each solid a simple closed surface, for instance by a boolean union in a modeller, {OR_REBUILD}"
        )


def _directed_edges(triangles: IntArray) -> IntArray:
    return triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)


def repeated_directions(triangles: IntArray) -> int:
    """Number of directed edges that occur more than once: zero if neighbours are consistently oriented."""
    codes = _directed_edges(triangles) @ np.array([int(triangles.max()) + 1, 1])
    return len(codes) - len(np.unique(codes))


def _orient(triangles: IntArray, source: str) -> IntArray:
    """Orient neighbours consistently; SoftprintError for one-sided surfaces (a Moebius strip)."""
    oriented = np.asarray(igl.bfs_orient(triangles)[0], dtype=np.int64)
    flipped = int((oriented != triangles).any(axis=1).sum())
    if flipped not in (0, len(triangles)):
        log.warning("%s: flipped triangles so that neighbours face the same way", source)
    if repeated_directions(oriented):
        raise SoftprintError(f"{source}: the surface has only one side and cannot bound a solid")
    return oriented


def _open_edges(triangles: IntArray) -> IntArray:
    """Directed edges (e, 2) without an opposite edge of a neighbour."""
    directed = _directed_edges(triangles)
    count = int(triangles.max()) + 1
    there, back = directed @ np.array([count, 1]), directed @ np.array([1, count])
    open_edges: IntArray = directed[~np.isin(there, back)]
    return open_edges


def _fill_small_holes(
    vertices: Array, triangles: IntArray, diagonal: float, source: str
) -> tuple[Array, IntArray]:
    """Close each small hole by a fan of triangles around the centre of its rim."""
    edges = _open_edges(triangles)
    if len(edges) == 0:
        return vertices, triangles
    following = dict(edges.tolist())
    problem = SoftprintError(
        f"{source}: the surface is open: {len(edges)} edge(s) have a triangle on one side only, and a hole "
        f"is too large to close by guessing (its rim is longer than {SMALL_HOLE:.0%} of the bounding box's "
        f"diagonal, or meets another); close it in a modeller, {OR_REBUILD}"
    )
    if len(following) < len(edges):  # two holes share a vertex, so rims are not unique
        raise problem
    while following:
        start, rim = next(iter(following)), []
        while start in following:
            rim.append(start)
            start = following.pop(start)
        points = vertices[rim]
        if (
            start != rim[0]
            or np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1).sum() > SMALL_HOLE * diagonal
        ):
            raise problem
        fan = [(b, a, len(vertices)) for a, b in zip(rim, np.roll(rim, -1).tolist(), strict=True)]
        vertices = np.vstack([vertices, points.mean(axis=0)])
        triangles = np.vstack([triangles, fan])
        log.warning("%s: closed a hole of %d edges", source, len(rim))
    return vertices, triangles


def _face_outward(vertices: Array, triangles: IntArray, source: str) -> IntArray:
    """Orient every separate surface outward, and cavities (nested an odd number deep) inward."""
    component = np.asarray(igl.facet_components(triangles)[1]).reshape(-1)
    count = int(component.max()) + 1
    if count > MOST_PIECES:
        raise SoftprintError(
            f"{source}: the surface is in {count} separate pieces, and at most {MOST_PIECES} are taken; "
            f"join them in a modeller, {OR_REBUILD}"
        )
    pieces = [triangles[component == c] for c in range(count)]
    inward = [np.linalg.det(vertices[piece]).sum() < 0 for piece in pieces]  # six times the volume
    pieces = [piece[:, ::-1] if flipped else piece for piece, flipped in zip(pieces, inward)]
    corners = [vertices[piece].reshape(-1, 3) for piece in pieces]
    lower, upper = (np.array([bound(points, axis=0) for points in corners]) for bound in (np.min, np.max))
    result = triangles.copy()
    cavities = 0
    for c, piece in enumerate(pieces):
        probe = corners[c][:1]
        around = np.flatnonzero(((lower <= probe) & (probe <= upper)).all(axis=1))
        depth = sum(
            np.atleast_1d(igl.winding_number(vertices, pieces[other], probe))[0] > 0.5
            for other in around
            if other != c
        )
        result[component == c] = piece[:, ::-1] if depth % 2 else piece
        cavities += depth % 2
        if inward[c] and depth % 2 == 0:
            log.warning("%s: flipped an inward-facing surface outward", source)
    if cavities:
        log.info("%s: %d cavity surface(s) kept as holes", source, cavities)
    return result
