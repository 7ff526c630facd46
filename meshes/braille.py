"""Make a plate with a word in braille, a collider. Run from the repository root; needs PyVista.

    python meshes/braille.py touch --scale 2 --out meshes/braille_touch.stl

Letters are those of uncontracted (grade 1) braille. Dots are spherical caps with the nominal sizes of the braille of
the Library of Congress (specification 800): 0.48 mm high, 1.44 mm across at their base, 2.34 mm from dot to dot and
6.2 mm from cell to cell, all times the scale. The word runs along x, its upper dots lie towards +y, and the plate's
face is z = 0, with the dots above.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pyvista as pv
import trimesh
from field_grid import Grid

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders.surface_mesh.repair import closed_surface
from softprint.runtime.errors import SoftprintError
from softprint.runtime.shapes.solid import Field, ball, blended, box, common, moved, union

HEIGHT, ACROSS, DOT_PITCH, CELL_PITCH = 0.48e-3, 1.44e-3, 2.34e-3, 6.2e-3  # [m]
MARGIN, THICKNESS, ROUNDING = 3.5e-3, 2.0e-3, 0.5e-3  # of the plate [m]
FILLET = 0.04e-3  # where a dot meets the plate [m]
SPACING = 0.12e-3  # of the grid that the surface is taken from [m]
TRIANGLES = 16000  # of 50 bytes each in a binary STL

# Dots of a letter: 1, 2, 3 down the left side of its cell, 4, 5, 6 down the right.
FIRST_TEN = dict(zip("abcdefghij", ("1", "12", "14", "145", "15", "124", "1245", "125", "24", "245")))
LETTERS = (
    FIRST_TEN
    | {letter: FIRST_TEN[above] + "3" for letter, above in zip("klmnopqrst", "abcdefghij")}
    | {letter: FIRST_TEN[above] + "36" for letter, above in zip("uvxyz", "abcde")}
    | {"w": "2456"}
)


def dots(word: str) -> Array:
    """(d, 2) middles of the dots of a word, about its own middle [m]."""
    unknown = sorted(set(word) - set(LETTERS))
    if unknown or not word:
        raise SoftprintError(f"{word!r}: a word of the letters a to z is wanted")
    places = [
        (cell * CELL_PITCH + (int(dot) > 3) * DOT_PITCH, -((int(dot) - 1) % 3) * DOT_PITCH)
        for cell, letter in enumerate(word)
        for dot in sorted(LETTERS[letter])
    ]
    return np.array(places) - 0.5 * np.array([(len(word) - 1) * CELL_PITCH + DOT_PITCH, -2.0 * DOT_PITCH])


def plate(word: str) -> tuple[Field, Array]:
    """The field of the plate [m], and the half extents of the slab (3,) [m]."""
    half = np.array(
        [
            0.5 * ((len(word) - 1) * CELL_PITCH + DOT_PITCH) + MARGIN,
            DOT_PITCH + MARGIN,
            0.5 * THICKNESS,
        ]
    )
    radius = (0.25 * ACROSS**2 + HEIGHT**2) / (2.0 * HEIGHT)  # of the sphere that such a cap is cut from
    caps = union(*(ball(radius, (x, y, HEIGHT - radius)) for x, y in dots(word)))
    slab = moved(box(half, ROUNDING), (0.0, 0.0, -half[2]))
    above = common(caps, lambda p: -p[:, 2] - half[2])  # no cap reaches through the slab
    return blended(FILLET, slab, above), half


def plate_surface(word: str, scale: float) -> tuple[Array, IntArray]:
    """The zero level set, decimated to TRIANGLES: vertices [m] and triangles."""
    field, half = plate(word)
    lower = np.array([-half[0], -half[1], -2.0 * half[2]]) - 3.0 * SPACING
    upper = np.array([half[0], half[1], HEIGHT]) + 3.0 * SPACING
    fine = pv.PolyData.from_regular_faces(*Grid(field, lower, upper, SPACING).zero_level())
    surface = fine.decimate(1.0 - TRIANGLES / fine.n_cells)
    triangles = surface.faces.reshape(-1, 4)[:, 1:].astype(np.int64)
    return closed_surface(scale * np.asarray(surface.points, dtype=float), triangles, f"braille {word!r}")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("word", help="of the letters a to z")
    parser.add_argument("--scale", type=float, default=1.0, help="of all sizes, for a finger as much larger")
    parser.add_argument("--out", type=Path, required=True, help="STL file to write")
    arguments = parser.parse_args()
    vertices, triangles = plate_surface(arguments.word, arguments.scale)
    trimesh.Trimesh(vertices, triangles, process=False).export(arguments.out)
    extent = 1e3 * np.ptp(vertices, axis=0)
    print(
        f"{arguments.out}: {len(triangles)} triangles, {' x '.join(f'{length:.1f}' for length in extent)} mm"
    )


if __name__ == "__main__":
    run_script(main)
