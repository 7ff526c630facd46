"""2D polygons with filleted corners, as smooth signed distances."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from softprint.runtime.arrays import Array, BoolArray
from softprint.runtime.colliders.sampled.grid import GridCollider
from softprint.runtime.compiled import compiled
from softprint.runtime.errors import SoftprintError

# Arcs are drawn with chords of this angle: the sagitta is then 0.04 % of the fillet's radius.
ARC_STEP = np.deg2rad(3.0)
# Crossings are tested between all pairs of sides: with this many corners it takes seconds.
MOST_CORNERS = 5000


def polygon_collider(
    vertices: ArrayLike, rounding: float = 0.0, resolution: int = 96, name: str = "polygon"
) -> GridCollider:
    """The solid within a simple polygon (v, 2) [m], with every corner rounded, including reentrant ones.

    rounding: radius of the fillets [m]. Vertices may be in either orientation and may repeat the first at the end.
    Raises SoftprintError for fewer than three vertices, a polygon that crosses itself, or a rounding that
    does not fit its sides.
    """
    corners = simple_polygon(np.array(vertices, dtype=float), f"collider '{name}'")
    outline = _fillet(corners, rounding, name) if rounding > 0 else corners
    segments = np.column_stack([np.arange(len(outline)), np.roll(np.arange(len(outline)), -1)])
    return GridCollider(lambda points: polygon_distance(points, outline), outline, segments, resolution, name)


def load_polygon(path: Path | str) -> Array:
    """Vertices (v, 2) from a text file of two columns; lines that start with # are comments."""
    path = Path(path)
    if not path.is_file():
        raise SoftprintError(f"{path}: there is no such polygon file")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # empty files are refused below
            vertices = np.loadtxt(path, ndmin=2)
    except ValueError as error:
        raise SoftprintError(f"{path}: a polygon is a text file with two numbers a line: {error}") from error
    if vertices.ndim != 2 or vertices.shape[1:] != (2,):
        raise SoftprintError(
            f"{path}: a polygon is a text file with two numbers a line; got shape {vertices.shape}"
        )
    return vertices


def _polygon_distance(points: Array, outline: Array) -> Array:
    following = np.roll(outline, -1, axis=0)
    edge, from_a = following - outline, points[:, None] - outline
    t = np.clip((from_a * edge).sum(axis=-1) / (edge * edge).sum(axis=-1), 0.0, 1.0)
    squared = np.square(from_a - t[..., None] * edge).sum(axis=-1).min(axis=1)
    side = edge[:, 0] * from_a[..., 1] - edge[:, 1] * from_a[..., 0]
    spans = (points[:, None, 1] >= outline[:, 1]) != (points[:, None, 1] >= following[:, 1])
    crossings = (spans & ((side > 0) == (edge[:, 1] > 0))).sum(axis=1)
    return np.where(crossings % 2 == 1, -1.0, 1.0) * np.sqrt(squared)


@compiled(reference=_polygon_distance)
def polygon_distance(points: Array, outline: Array) -> Array:
    """Exact signed distance (n,) of points (n, 2) to a closed outline (v, 2); sign by crossing parity."""
    result = np.empty(len(points))
    for i in range(len(points)):
        nearest, inside = np.inf, False
        for j in range(len(outline)):
            k = j + 1 if j + 1 < len(outline) else 0
            edge_x, edge_y = outline[k, 0] - outline[j, 0], outline[k, 1] - outline[j, 1]
            x, y = points[i, 0] - outline[j, 0], points[i, 1] - outline[j, 1]
            t = min(max((x * edge_x + y * edge_y) / (edge_x * edge_x + edge_y * edge_y), 0.0), 1.0)
            off_x, off_y = x - t * edge_x, y - t * edge_y
            nearest = min(nearest, off_x * off_x + off_y * off_y)
            if (points[i, 1] >= outline[j, 1]) != (points[i, 1] >= outline[k, 1]):
                inside ^= (edge_x * y - edge_y * x > 0.0) == (edge_y > 0.0)
        result[i] = -np.sqrt(nearest) if inside else np.sqrt(nearest)
    return result


def simple_polygon(vertices: Array, source: str) -> Array:
    """Anticlockwise corners (n, 2) without repeats; SoftprintError, which begins with the source, if the polygon is not
    simple."""
    if vertices.ndim != 2 or vertices.shape[1] != 2 or not np.isfinite(vertices).all():
        raise SoftprintError(f"{source}: polygon vertices are pairs of finite numbers")
    keep = (vertices != np.roll(vertices, 1, axis=0)).any(axis=1)
    corners: Array = vertices[keep]
    if len(corners) < 3:
        raise SoftprintError(f"{source}: a polygon needs at least three different vertices")
    if len(corners) > MOST_CORNERS:
        raise SoftprintError(
            f"{source}: the polygon has {len(corners)} vertices, but at most {MOST_CORNERS} are allowed; "
            "use fewer"
        )
    after = np.roll(corners, -1, axis=0)
    for i in range(len(corners)):
        others = np.arange(i + 2, len(corners) - (i == 0))
        meets = _segments_meet(corners[i], after[i], corners[others], after[others])
        if meets.any():
            raise SoftprintError(
                f"{source}: sides {i} and {others[meets][0]} of the polygon cross each other"
            )
    area = 0.5 * np.sum(corners[:, 0] * after[:, 1] - corners[:, 1] * after[:, 0])
    return corners if area > 0 else np.flip(corners, axis=0)


def _segments_meet(a: Array, b: Array, c: Array, d: Array) -> BoolArray:
    """(n,) whether the segment from a to b (2,) meets those from c to d (n, 2)."""

    def side(p: Array, q: Array, r: Array) -> Array:
        along, off = q - p, r - p
        return np.asarray(along[..., 0] * off[..., 1] - along[..., 1] * off[..., 0])

    # Segments on one line pass the test of sides wherever they are on it, but their boxes do not meet.
    near = (
        np.maximum(np.minimum(c, d), np.minimum(a, b)) <= np.minimum(np.maximum(c, d), np.maximum(a, b))
    ).all(-1)
    return near & (side(a, b, c) * side(a, b, d) <= 0) & (side(c, d, a) * side(c, d, b) <= 0)


def _fillet(corners: Array, radius: float, name: str) -> Array:
    """The outline with every corner replaced by an arc of `radius` tangent to its two sides."""
    to_before = np.roll(corners, 1, axis=0) - corners
    to_after = np.roll(corners, -1, axis=0) - corners
    length = np.linalg.norm(to_after, axis=1)
    u, v = to_before / np.linalg.norm(to_before, axis=1, keepdims=True), to_after / length[:, None]
    half_angle = 0.5 * np.arccos(np.clip((u * v).sum(axis=1), -1.0, 1.0))
    cut = radius / np.tan(half_angle)  # from the corner to the point where the arc begins
    if (cut + np.roll(cut, -1) > length * (1 + 1e-12)).any():
        side = int(np.argmax(cut + np.roll(cut, -1) - length))
        largest = radius * float((length / (cut + np.roll(cut, -1))).min())
        raise SoftprintError(
            f"collider '{name}': a rounding of {radius} m does not fit side {side} of the polygon; "
            f"at most {largest:.4g} m does"
        )
    outline = []
    for i, corner in enumerate(corners):
        angle = np.pi - 2 * half_angle[i]
        if angle < 1e-9:  # the two sides are one straight line
            outline.append(corner[None])
            continue
        bisector = (u[i] + v[i]) / np.linalg.norm(u[i] + v[i])
        centre = corner + bisector * radius / np.sin(half_angle[i])
        first = corner + cut[i] * u[i] - centre
        direction = np.sign(u[i, 1] * v[i, 0] - u[i, 0] * v[i, 1])
        steps = direction * np.linspace(0.0, angle, int(np.ceil(angle / ARC_STEP)) + 1)
        perpendicular = np.column_stack([-first[1] * np.sin(steps), first[0] * np.sin(steps)])
        outline.append(centre + np.cos(steps)[:, None] * first + perpendicular)
    return np.vstack(outline)
