"""`--collider FILE`, of verbs that play a scene: another shape in the place of one of its colliders."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from runtime.experiment import Experiment, SceneSpec


def add_collider_options(parser: argparse.ArgumentParser) -> None:
    """--collider and --collider-scale."""
    parser.add_argument(
        "--collider",
        action="append",
        metavar="FILE",
        help="another shape for the scene's collider: a mesh (STL, OBJ, PLY), a shape of the library by its name, or "
        "COLLIDER=FILE where the scene has several, and then again for the next; made as large as the one it stands "
        "in for",
    )
    parser.add_argument(
        "--collider-scale",
        type=_positive,
        metavar="S",
        help="metres for each unit of that file, or half the extent of a library shape [m]",
    )


def with_stand_ins(
    args: argparse.Namespace, experiment: Experiment, scene: SceneSpec
) -> tuple[Experiment, SceneSpec]:
    """The scene as it is to be played, and the experiment in which its colliders are found."""
    from runtime.errors import SoftprintError
    from runtime.scenes.stand_in import with_stand_in

    if args.collider_scale is not None and not args.collider:
        raise SoftprintError("--collider-scale belongs to --collider FILE")
    for asked in args.collider or ():
        experiment, scene = with_stand_in(experiment, scene, asked, args.collider_scale)
    return experiment, scene


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number of metres, such as 0.001")
    return value
