"""`--collider FILE` of verbs that play a scene: replaces one of its colliders by another shape."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from softprint.runtime.experiment import Experiment, SceneSpec


def add_collider_options(parser: argparse.ArgumentParser) -> None:
    """--collider and --collider-scale."""
    parser.add_argument(
        "--collider",
        action="append",
        metavar="FILE",
        help="another shape for the scene's collider: a mesh (STL, OBJ, PLY), a shape of the library by its name, or "
        "COLLIDER=FILE if the scene has several (repeatable); by default it gets the size of the one it "
        "replaces",
    )
    parser.add_argument(
        "--collider-scale",
        type=_positive,
        metavar="S",
        help="metres for each unit of that file, or half the extent of a library shape [m]",
    )


def with_replaced_colliders(
    args: argparse.Namespace, experiment: Experiment, scene: SceneSpec
) -> tuple[Experiment, SceneSpec]:
    """The scene with its replaced colliders, and the experiment that defines them."""
    from softprint.runtime.errors import SoftprintError
    from softprint.runtime.scenes.replaced_collider import with_replaced_collider

    if args.collider_scale is not None and not args.collider:
        raise SoftprintError("--collider-scale belongs to --collider FILE")
    unnamed = [option for option in args.collider or () if "=" not in option]
    if len(unnamed) > 1:
        raise SoftprintError(
            f"--collider {unnamed[1]}: is the second without the name of the collider that it replaces; say "
            "COLLIDER=FILE"
        )
    for option in args.collider or ():
        experiment, scene = with_replaced_collider(experiment, scene, option, args.collider_scale)
    return experiment, scene


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number of metres, such as 0.001")
    return value
