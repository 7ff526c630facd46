"""Draw all shapes of the library with their names, `docs/collider_library.png`. Needs PyVista and matplotlib.

python meshes/library_sheet.py [PICTURE.png]
"""

from __future__ import annotations

import os
import sys
from io import BytesIO
from pathlib import Path

os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")

import matplotlib as mpl
import numpy as np
import pyvista as pv
from PIL import Image

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.library import library_surface
from softprint.runtime.shapes import SHAPES, SPLIT

mpl.use("Agg")
from matplotlib import pyplot as plt

COLUMNS, PITCH, PIXELS = 11, 2.75, 58  # shapes in a row; units from one to the next; pixels for each unit
SPAN = 1.92  # of a shape on the page [units]
TITLE = 1.1  # room above each side [units]
COLOURS = {"train": "#6f8fb3", "test": "#c98a5b"}
SIDES = {"train": "for training", "test": "for testing"}
VIEW = np.array([0.55, -1.0, 0.75])  # from a shape towards the camera


CUT = np.array([0.8, -0.6, 0.0])  # towards what is taken off shapes with voids


def turned_to_the_camera() -> Array:
    """(3, 3) rows: right, up and towards the camera, as seen along VIEW."""
    towards = VIEW / np.linalg.norm(VIEW)
    right = np.cross([0, 0, 1], towards)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(towards, right), towards])


def places() -> tuple[dict[str, tuple[str, str, float, float]], dict[str, float], float]:
    """name -> (side, family, right, down), side -> where its title stands, and the height of the whole."""
    found, titles, down = {}, {}, 0.0
    for side, families in SPLIT.items():
        titles[side] = down + 0.5 * TITLE
        down += TITLE
        listed = [(shape.name, family) for family, shapes in families.items() for shape in shapes]
        for number, (name, family) in enumerate(listed):
            row, column = divmod(number, COLUMNS)
            found[name] = (side, family, (column + 0.5) * PITCH, down + (row + 0.42) * PITCH)
        down += PITCH * -(-len(listed) // COLUMNS)
    return found, titles, down


def main(picture: Path) -> None:
    found, titles, height = places()
    width = COLUMNS * PITCH
    plotter = pv.Plotter(
        off_screen=True, window_size=[round(width * PIXELS), round(height * PIXELS)], lighting="none"
    )
    plotter.set_background("white")
    for position, intensity in (((-1, 2, 2), 0.75), ((2, 0.5, 1.5), 0.35), ((0, -1, 0.6), 0.2)):
        light = pv.Light(position=position, intensity=intensity, light_type="scene light")
        light.positional = False
        plotter.add_light(light)
    turn = turned_to_the_camera()
    for name, (side, _family, right, down) in found.items():
        vertices, triangles = library_surface(name)
        seen = vertices @ turn.T
        middle, span = 0.5 * (seen.min(axis=0) + seen.max(axis=0)), np.ptp(seen[:, :2], axis=0).max()
        faces = np.column_stack([np.full(len(triangles), 3), triangles]).ravel()
        place = np.array([right, -down, 0.0])
        solid = pv.PolyData((seen - middle) * (SPAN / span) + place, faces)
        if SHAPES[name].voids:  # cut open, to show them
            solid = solid.clip_closed_surface(-turn @ CUT, origin=place)
        plotter.add_mesh(solid, color=COLOURS[side], ambient=0.3, diffuse=0.8, specular=0.15)
    plotter.enable_parallel_projection()
    plotter.camera.focal_point = (0.5 * width, -0.5 * height, 0.0)
    plotter.camera.position = (0.5 * width, -0.5 * height, 50.0)
    plotter.camera.up = (0, 1, 0)
    plotter.camera.parallel_scale = 0.5 * height
    plotter.enable_ssao(radius=0.5, bias=0.02)
    plotter.enable_anti_aliasing("ssaa")
    image = plotter.screenshot(return_img=True)
    plotter.close()

    figure = plt.figure(figsize=(image.shape[1] / 100, image.shape[0] / 100), dpi=100)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.imshow(image, extent=(0, width, height, 0))
    axes.set_axis_off()
    for side, down in titles.items():
        count = sum(of == side for of, *_ in found.values())
        axes.text(0.3, down, f"{count} {SIDES[side]}", size=17, weight="bold", va="center", color="#1b1b1f")
    for name, (_side, family, right, down) in found.items():
        below = down + 0.46 * PITCH
        axes.text(right, below, name, size=10.5, ha="center", va="bottom", color="#1b1b1f")
        axes.text(right, below + 0.02, family, size=8.5, ha="center", va="top", color="#77777d")
    drawn = BytesIO()
    figure.savefig(drawn)
    # A palette of 256 colours, all of them shades of two: a third of the bytes, and no difference to see.
    Image.open(drawn).convert("RGB").quantize(256, dither=Image.Dither.NONE).save(picture, optimize=True)


if __name__ == "__main__":
    default = Path(__file__).parent.parent / "docs" / "collider_library.png"
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else default)
