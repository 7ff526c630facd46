"""`softprint collider`: whether a mesh can be a collider, its defects, and the accuracy of its signed distance."""

from __future__ import annotations

import argparse
from pathlib import Path

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verb import Verb


def configure(parser: argparse.ArgumentParser) -> None:
    """The file, its unit, the grid, and the files to write."""
    parser.add_argument("file", type=Path, metavar="FILE", help="a triangle mesh: STL, OBJ or PLY")
    parser.add_argument(
        "--scale", type=float, default=1.0, help="metres for each unit of the file (default: 1)"
    )
    parser.add_argument(
        "--resolution",
        type=int,
        default=48,
        metavar="N",
        help="grid cells along the longest side (default: 48)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="MENDED.stl",
        help="write the repaired surface, in the file's unit (default: write nothing)",
    )
    parser.add_argument(
        "--png", type=Path, metavar="PICTURE.png", help="draw the repaired surface (default: draw nothing)"
    )
    parser.add_argument("--json", action="store_true", help="as JSON (default: off)")


def run(args: argparse.Namespace, context: Context) -> int:
    """Print the defects, the repairs and the accuracy of the collider; 1 if FILE cannot be used as it is."""
    from softprint.runtime.inspect.examined_surface import examined_surface, write_surface

    with context.stage(f"examining {args.file.name}"):
        summary, examined = examined_surface(args.file, args.scale, args.resolution)
    context.say(summary.as_json() if args.json else summary.as_text())
    if args.out is not None:
        write_surface(args.out, examined)
    if args.png is not None:
        from softprint.runtime.drawing.colours import COLLIDER
        from softprint.runtime.drawing.draw import draw
        from softprint.runtime.drawing.scene import Scene

        draw(
            args.png,
            Scene(args.file.name, examined.vertices, examined.triangles, edges=True, colour=COLLIDER),
        )
    if not examined.refusal or args.out is not None:
        return 0
    if not args.json:
        context.say(
            f"\n{args.file} cannot be a collider as it is; --out MENDED.stl writes the rebuilt surface, which can."
        )
    return 1


VERB = Verb(
    name="collider",
    order=72,
    summary="Check and repair a triangle mesh, and measure its accuracy as a collider.",
    example="softprint collider meshes/pointy.stl --png pointy.png",
    run=run,
    needs=("igl",),
    configure=configure,
    reads_experiment=False,
)
