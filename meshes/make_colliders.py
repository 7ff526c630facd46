"""Make the colliders of the examples, `pointy.stl` (3D), `star.txt` and `comb.txt` (2D). Run from the repository root.

    python meshes/make_colliders.py [FOLDER]

`pointy` is a blunt caltrop after the thesis's pointy collider: seven cones with tips of 8 mm radius in
uneven directions and of uneven length, smoothly joined, so that no symmetry hides an error in a rotation.
`star` is a star of five unequal points; the 5 mm by which its reader is to round its corners blunts it to
about 30 mm. `comb` is a bar with six teeth below: a large area of contact with small protrusions.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pyvista as pv
import trimesh

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders import Cone
from softprint.runtime.colliders.combine import SmoothUnion
from softprint.runtime.colliders.surface_mesh.repair import closed_surface

# Direction and reach [m] of each spike of the caltrop.
SPIKES = (
    ((0.05, 0.02, -1.00), 0.0310),
    ((0.95, 0.10, -0.25), 0.0290),
    ((-0.40, 0.90, -0.20), 0.0300),
    ((-0.55, -0.80, -0.28), 0.0285),
    ((0.50, 0.62, 0.62), 0.0280),
    ((-0.85, 0.05, 0.55), 0.0300),
    ((0.35, -0.75, 0.58), 0.0290),
)
TIP_RADIUS, ROOT_RADIUS, BLEND = 0.008, 0.012, 0.008
STAR_REACH = (0.0390, 0.0370, 0.0400, 0.0375, 0.0385)
STAR_VALLEY = 0.0180
TEETH, TOOTH, GAP = 6, 0.004, 0.0056  # widths [m] of a tooth of the comb, and between two
TOOTH_LENGTH, BAR = 0.008, 0.010
TRIANGLES = 4500  # of 50 bytes each in a binary STL


def caltrop() -> SmoothUnion:
    spikes = []
    for direction, reach in SPIKES:
        tip = np.array(direction) / np.linalg.norm(direction) * (reach - TIP_RADIUS)
        spikes.append(Cone(np.zeros(3), tip, ROOT_RADIUS, TIP_RADIUS))
    return SmoothUnion(spikes, BLEND, name="pointy")


def caltrop_surface(cells: int = 110) -> tuple[Array, IntArray]:
    """The zero level set, decimated to TRIANGLES: vertices [m] and triangles."""
    shape = caltrop()
    lower, upper = shape.lower - 0.002, shape.upper + 0.002
    spacing = (upper - lower) / cells
    image = pv.ImageData(dimensions=[cells + 1] * 3, spacing=tuple(spacing), origin=tuple(lower))
    image.point_data["sdf"] = shape.sdf(np.asarray(image.points))
    contour = image.contour([0.0], scalars="sdf", method="flying_edges").triangulate().clean()
    surface = contour.decimate(1.0 - TRIANGLES / contour.n_cells)
    triangles = surface.faces.reshape(-1, 4)[:, 1:].astype(np.int64)
    return closed_surface(np.asarray(surface.points, dtype=float), triangles, "pointy")


def star() -> Array:
    """Corners (10, 2) [m], anticlockwise, a point and a valley in turn."""
    angles = np.pi / 2 + np.arange(10) * np.pi / 5
    radius = np.column_stack([STAR_REACH, np.full(5, STAR_VALLEY)]).ravel()
    return np.asarray(radius[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]))


def comb() -> Array:
    """Corners (24, 2) [m], anticlockwise from the lower left one. The teeth point down; the origin is in the middle of
    the comb, halfway up its teeth."""
    half = 0.5 * (TEETH * TOOTH + (TEETH - 1) * GAP)
    tip, root = -0.5 * TOOTH_LENGTH, 0.5 * TOOTH_LENGTH
    below = []
    for tooth in range(TEETH):
        left = -half + tooth * (TOOTH + GAP)
        right = left + TOOTH
        below += [(left, root), (left, tip), (right, tip), (right, root)]
    return np.array([*below[1:-1], (half, root + BAR), (-half, root + BAR)])


def main(folder: Path) -> None:
    vertices, triangles = caltrop_surface()
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    mesh.export(folder / "pointy.stl")
    np.savetxt(folder / "star.txt", star(), fmt="%.6f", header="corners of a five-pointed star [m]")
    np.savetxt(folder / "comb.txt", comb(), fmt="%.6f", header="corners of a comb with six teeth [m]")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
