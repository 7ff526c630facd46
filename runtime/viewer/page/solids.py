"""Colliders as triangles to draw, in 3D and in the plane."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders import Collider, RigidPose
from softprint.runtime.colliders.level_set import collider_surface
from softprint.runtime.colliders.sampled.grid import GridCollider

# Cells along the longest side of a collider that is given by a formula.
_CELLS = {2: 90, 3: 44}
# Triangles at most, beyond which the surface of a file is found on a grid instead.
_MOST = 40_000
# Half the side of the square that a plane is drawn as, in sizes of the body.
_PLANE = 1.5


def drawn_solid(collider: Collider, size: float) -> tuple[Array, IntArray]:
    """Vertices (v, 3) [m] in the collider's coordinates and triangles (t, 3); size: of the body, for colliders without
    bounds."""
    if not np.isfinite(collider.upper - collider.lower).all():
        return _plane(collider, _PLANE * size)
    if collider.dim == 2:
        return _flat(collider)
    if isinstance(collider, GridCollider) and len(collider.facets) <= _MOST:
        return collider.vertices, collider.facets
    return collider_surface(collider, _CELLS[3])


def in_space(pose: RigidPose) -> tuple[Array, Array]:
    """Position (3,) and quaternion w, x, y, z (4,) of a pose in 2D or 3D."""
    from scipy.spatial.transform import Rotation

    position, rotation = np.zeros(3), np.eye(3)
    position[: pose.dim] = pose.translation
    rotation[: pose.dim, : pose.dim] = pose.rotation
    return position, np.roll(Rotation.from_matrix(rotation).as_quat(), 1)


def _flat(collider: Collider) -> tuple[Array, IntArray]:
    """The inside of a shape in the plane: the triangles of a grid, cut where the distance crosses zero."""
    extent = collider.upper - collider.lower
    spacing = float(extent.max()) / _CELLS[2]
    counts = np.ceil(extent / spacing).astype(int) + 3
    axes = [low - spacing + spacing * np.arange(n) for low, n in zip(collider.lower, counts, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    values = collider.sdf(grid)
    corner = np.arange(len(grid)).reshape(counts)[:-1, :-1].ravel()
    right, up = corner + counts[1], corner + 1
    halves = np.concatenate(
        [np.column_stack([corner, right, right + 1]), np.column_stack([corner, right + 1, up])]
    )
    inside = values[halves] < 0
    count = inside.sum(axis=1)
    pieces = [grid[halves[count == 3]]]
    for alone in (1, 2):
        cut = halves[count == alone]
        single = np.argmax(inside[count == alone] == (alone == 1), axis=1)
        turned = cut[np.arange(len(cut))[:, None], (single[:, None] + np.arange(3)) % 3]
        a, b, c = (grid[turned[:, k]] for k in range(3))
        va, vb, vc = (values[turned[:, k]][:, None] for k in range(3))
        ab, ac = a + (b - a) * va / (va - vb), a + (c - a) * va / (va - vc)
        if alone == 1:
            pieces.append(np.stack([a, ab, ac], axis=1))
        else:
            pieces += [np.stack([ab, b, c], axis=1), np.stack([ab, c, ac], axis=1)]
    corners = np.concatenate(pieces).reshape(-1, 2)
    vertices = np.pad(corners, ((0, 0), (0, 1)))
    return vertices, np.arange(len(vertices)).reshape(-1, 3)


def _plane(collider: Collider, half: float) -> tuple[Array, IntArray]:
    """A square of a plane about the origin; in 2D a strip along its line."""
    dim = collider.dim
    normal = np.zeros(3)
    normal[:dim] = collider.sdf_derivatives(np.zeros((1, dim))).gradient[0]
    other = np.eye(3)[2] if dim == 2 else np.eye(3)[int(np.argmin(np.abs(normal)))]
    along = np.cross(normal, other)
    along /= np.linalg.norm(along)
    across = -0.1 * normal if dim == 2 else np.cross(normal, along)
    start = 0.0 if dim == 2 else -1.0
    corners = half * np.array(
        [along * i + across * j for i, j in ((-1, start), (1, start), (1, 1.0), (-1, 1.0))]
    )
    return corners, np.array([[0, 1, 2], [0, 2, 3]])
