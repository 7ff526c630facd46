"""`softprint new`: from a mesh or an outline of one's own to a body and a complete experiment file."""

from __future__ import annotations

import argparse
import logging
import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verb import Verb

if TYPE_CHECKING:
    from softprint.runtime.arrays import Array
    from softprint.runtime.mesh import Mesh

CELLS = 15_000
_UNITS = ("m", "cm", "mm", "in")


def configure(parser: argparse.ArgumentParser) -> None:
    """The file, how it becomes a body, what holds it, and the files to write."""
    parser.add_argument(
        "mesh",
        type=Path,
        metavar="MESH",
        help="a surface (STL, OBJ, PLY, GLB, OFF), tetrahedra or triangles (what meshio reads), or an "
        "outline in the plane "
        "(SVG, DXF, or a text file with two numbers a line)",
    )
    parser.add_argument(
        "--out", type=Path, metavar="NAME.toml", help="the experiment file (default: MESH's name, here)"
    )
    parser.add_argument(
        "--cells",
        type=int,
        default=CELLS,
        metavar="N",
        help=f"cells wanted, of surfaces and outlines (default: {CELLS})",
    )
    length = parser.add_mutually_exclusive_group()
    length.add_argument("--units", choices=_UNITS, help="the unit of the file (default: m)")
    length.add_argument(
        "--scale", type=_positive, metavar="S", help="metres for each unit of the file (default: 1)"
    )
    length.add_argument("--size", type=_positive, metavar="M", help="make the longest side so many metres")
    parser.add_argument(
        "--up",
        choices=("x", "y", "z", "-x", "-y", "-z"),
        default="",
        metavar="AXIS",
        help="the axis of the file that points up, such as y, or --up=-z (default: z; y for GLB and outlines)",
    )
    parser.add_argument(
        "--hold",
        default="bottom",
        metavar="WHERE",
        help="what holds the body: bottom, top, left, right, front, back, a box X,Y,Z:X,Y,Z [m], or pick, to choose a "
        "box in a window (default: bottom)",
    )
    parser.add_argument(
        "--young",
        type=_positive,
        metavar="PA",
        help="Young's modulus [Pa] (default: chosen by size and weight)",
    )
    parser.add_argument(
        "--seed", type=int, default=7, metavar="N", help="of the scenes and of the experiment (default: 7)"
    )
    parser.add_argument("--force", action="store_true", help="overwrite files that exist (default: off)")


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number")
    return value


def run(args: argparse.Namespace, context: Context) -> int:
    """Write NAME.vtu and NAME.toml, and say what was done."""
    from softprint.runtime.authoring.body_source import Placing
    from softprint.runtime.authoring.experiment_text import distances
    from softprint.runtime.authoring.new_experiment import Wanted, new_experiment
    from softprint.runtime.colliders.kinds.from_file import UNITS
    from softprint.runtime.errors import SoftprintError

    if not 0 <= args.seed < 2**32:
        raise SoftprintError(f"--seed {args.seed}: must be from 0 to {2**32 - 1}")
    scale = UNITS[args.units] if args.units else args.scale
    wanted = Wanted(
        mesh=args.mesh,
        out=args.out or Path(f"{args.mesh.stem}.toml"),
        cells=args.cells,
        placing=Placing(scale, args.size, args.up),
        hold=_picked(context) if args.hold == "pick" else _hold(args.hold),
        young=args.young,
        seed=args.seed,
        force=args.force,
    )
    # What it reads and reorients on the way is not news; what was done to the file is said below.
    with _warnings_only("softprint.runtime.mesh"):
        made = new_experiment(wanted, context.stage)
    for sentence in made.body.said:
        context.say(sentence)
    if made.body.apart is not None:
        context.say(distances(made.body.apart))
    mesh, settings = made.body.mesh, made.settings
    extent = " x ".join(f"{length:.4g}" for length in mesh.points.max(axis=0) - mesh.points.min(axis=0))
    context.say(
        f"{extent} m, held at {args.hold}; Young's modulus {settings.young:g} Pa; colliders of "
        f"{2e3 * settings.collider:.3g} mm, up to {1e3 * settings.max_depth:.2g} mm deep"
    )
    context.say(f"{made.mesh} and {made.experiment} written. Next: softprint run {_quoted(made.experiment)}")
    return 0


def _quoted(path: Path) -> str:
    """As a shell takes it, and no option."""
    return shlex.quote(f"./{path}" if str(path).startswith("-") else str(path))


@contextmanager
def _warnings_only(name: str) -> Iterator[None]:
    """Without what a logger says for information."""
    log = logging.getLogger(name)
    before = log.level
    log.setLevel(logging.WARNING)
    try:
        yield
    finally:
        log.setLevel(before)


def _picked(context: Context) -> Callable[[Mesh], Array]:
    """Opens a window that begins with the bottom of the body."""
    from softprint.runtime.authoring.choose_settings import hold_box
    from softprint.runtime.viewer.hold_picker import pick_hold

    return lambda mesh: pick_hold(mesh, hold_box(mesh, "bottom"), 0, True, context.say)


def _hold(text: str) -> str | Array:
    """The name of a side, or a box (2, dim) [m]."""
    import numpy as np

    from softprint.runtime.authoring.choose_settings import SIDES
    from softprint.runtime.errors import SoftprintError

    if ":" not in text:
        if text not in SIDES:  # before the body is filled, which may take minutes
            raise SoftprintError(f"--hold {text}: must be one of {', '.join(SIDES)}, a box, or pick")
        return text
    try:
        box = np.array([[float(number) for number in corner.split(",")] for corner in text.split(":")])
    except ValueError:
        box = np.zeros((0, 0))
    if box.shape not in ((2, 2), (2, 3)) or not np.isfinite(box).all():
        raise SoftprintError(f"--hold {text}: a box is two corners in metres, such as -1,-1,-1:1,1,0.01")
    return box


VERB = Verb(
    name="new",
    order=5,
    summary="A body and a complete experiment file from a mesh or an outline of your own.",
    example="softprint new meshes/pointy.stl --cells 3000",
    run=run,
    needs=("igl", "trimesh", "meshio", "pytetwild", "gmsh"),
    configure=configure,
    reads_experiment=False,
)
