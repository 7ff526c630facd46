"""Draw `docs/motion_strip.png`: four frames of a motion, cut open, for several models one above the other.

    python tools/motion_strip.py examples/jelly3d_small.toml --scene held_out --model full --model bare --model ours

Needs PyVista, and the motions that `softprint simulate` leaves in the run directory. Every model plays the motion
alone; all pictures of a column are cut through the same point.
"""

from __future__ import annotations

import argparse
import io
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from softprint import build_collider, load_body, load_experiment
from softprint.fem_truth.report.drawing.renderings import make_renderer
from softprint.runtime.cli.script import run_script
from softprint.runtime.scenes.motion_file import Motion, load_motion

NAMES = {"full": "full space", "bare": "reduced\nmodel alone", "ours": "ours", "mechanics": "mechanics"}
TILE = (272, 208)  # pixels, as wide to as high as a rendering is
MARGIN, HEAD, GAP = 104, 24, 2  # pixels: for names, for times, and around a tile
FRAMES = 4
COLOURS = 192  # of the palette: a third of the size of full colour, with no visible loss
INK = "#1b1b1f"


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--scene", default="held_out")
    parser.add_argument("--model", action="append", help="rows of the strip (default: full, bare and ours)")
    parser.add_argument("--run", type=Path, help="the run directory (default: runs/NAME)")
    parser.add_argument("--frames", type=int, nargs=FRAMES, help="default: evenly over the frames in contact")
    parser.add_argument("--out", type=Path, default=Path("docs/motion_strip.png"))
    return parser.parse_args()


def shown_frames(motion: Motion) -> list[int]:
    """Evenly over the frames in contact, without the first and the last touch."""
    touched = np.flatnonzero(motion.in_contact)
    shares = (np.arange(FRAMES) + 0.5) / FRAMES
    return [int(frame) for frame in touched[np.floor(shares * len(touched)).astype(int)]]


def strip(rows: list[tuple[str, list[bytes]]], times: list[float]) -> Image.Image:
    """Pictures row by row, the name of the model to the left, the time above each column."""
    width, height = TILE
    sheet = Image.new("RGB", (MARGIN + FRAMES * (width + GAP), HEAD + len(rows) * (height + GAP)), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(16)
    for column, time in enumerate(times):
        pen.text(
            (MARGIN + (column + 0.5) * (width + GAP), 12), f"{time:.2f} s", fill=INK, font=font, anchor="mm"
        )
    for row, (name, pictures) in enumerate(rows):
        top = HEAD + row * (height + GAP)
        pen.text((6, top + 0.5 * height), name, fill=INK, font=font, anchor="lm")
        for column, data in enumerate(pictures):
            picture = Image.open(io.BytesIO(data)).resize(TILE, Image.Resampling.LANCZOS)
            sheet.paste(picture, (MARGIN + column * (width + GAP), top), picture)
    return sheet


def main() -> None:
    given = arguments()
    experiment = load_experiment(given.experiment)
    run = given.run or Path("runs") / experiment.name
    models = given.model or ["full", "bare", "ours"]
    motions = {name: load_motion(run / "motions" / f"{given.scene}_{name}.h5") for name in models}
    first = motions[models[0]]
    frames = given.frames or shown_frames(first)
    (name,) = first.colliders
    collider = build_collider(experiment.collider(name), experiment.base_dir)
    body = load_body(run / "body.h5")
    renderer = make_renderer(body.mesh, collider, first.colliders[name].poses[frames[0]])

    rows: list[tuple[str, list[bytes]]] = []
    for model, motion in motions.items():
        pictures = []
        for frame in frames:
            pose = motion.colliders[name].poses[frame]
            x = motions[models[-1]].positions(frame)[body.mesh.surface_nodes]
            deepest = x[np.argmin(collider.sdf(pose.apply_inverse(x)))]
            picture = renderer.cut(motion.positions(frame), pose, deepest, "")
            if picture is None:
                raise SystemExit("off-screen OpenGL does not work here: install libegl1 and libgl1-mesa-dri")
            pictures.append(picture.data)
        rows.append((NAMES.get(model, model), pictures))
    sheet = strip(rows, [float(first.times[frame]) for frame in frames])
    sheet.quantize(COLOURS, dither=Image.Dither.NONE).save(given.out, optimize=True)
    print(f"{given.out}: {sheet.width} x {sheet.height}, {given.out.stat().st_size / 1024:.0f} kB")


if __name__ == "__main__":
    run_script(main)
