"""`softprint touch`: contact pressure, traction and strain at points of a body while a scene is played."""

from __future__ import annotations

import argparse

from softprint.runtime.cli.collider_options import add_collider_options, with_replaced_colliders
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verb import Verb

FOLDER = "touch"


def configure(parser: argparse.ArgumentParser) -> None:
    """Scene, model and points."""
    parser.add_argument(
        "--scene", metavar="NAME", help='a scene of the experiment (default: the first with role = "test")'
    )
    parser.add_argument(
        "--model",
        default="bare",
        metavar="NAME",
        help="bare, full (needs DOLFINx) or the name of a trained correction (default: bare)",
    )
    parser.add_argument(
        "--point",
        type=_point,
        action="append",
        metavar="NAME=X,Y,Z",
        help="a point of the surface by its position on the body at rest [m], two numbers in 2D; repeatable "
        "(default: the highest point of the body)",
    )
    parser.add_argument(
        "--surface",
        action="store_true",
        help="also write the measurements at all surface samples in every frame, as HDF5 (default: off)",
    )
    add_collider_options(parser)


def _point(text: str) -> tuple[str, list[float]]:
    name, equals, numbers = text.partition("=")
    if not (name and equals):
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form NAME=X,Y,Z, such as tip=0,0,0.06")
    try:
        return name, [float(number) for number in numbers.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{numbers!r} is not a list of numbers separated by commas, such as 0,0,0.06"
        ) from None


def run(args: argparse.Namespace, context: Context) -> int:
    """Play the scene; write touch/SCENE_MODEL.csv and .png in the run directory, and .h5 with --surface."""
    import numpy as np

    from softprint.runtime.cli.run_body import body_of_run
    from softprint.runtime.errors import SoftprintError
    from softprint.runtime.scenes.playing import build_model, play
    from softprint.runtime.scenes.scene import find_scene, scene_steps
    from softprint.runtime.touch import Touch, TouchSensor, point_places, surface_places
    from softprint.runtime.touch.series import draw_series, write_arrays, write_table

    experiment = context.experiment
    names = [args.scene] if args.scene else [scene.name for scene in experiment.scenes_of_role("test")]
    if not names:
        raise SoftprintError(f'{experiment.path}: no scene has role = "test"; name one with --scene')
    experiment, scene = with_replaced_colliders(args, experiment, find_scene(experiment, names[0]))
    point_names = [name for name, _ in args.point or []]
    if len(set(point_names)) < len(point_names):
        raise SoftprintError(f"two points have the same name; the names are {', '.join(point_names)}")
    body = body_of_run(context)
    points = dict(args.point or [("top", body.mesh.points[np.argmax(body.mesh.points[:, -1])])])
    places = [point_places(body, points), *([surface_places(body)] if args.surface else [])]
    with context.stage(f"preparing {scene.name} ({args.model})"):
        model = build_model(experiment, body, scene, context.out_dir, args.model)
        sensors = [TouchSensor(model, body, sensed) for sensed in places]
    measured: list[list[Touch]] = [[] for _ in sensors]
    n_steps, left = scene_steps(experiment, scene), 0
    with context.progress(n_steps, "steps", f"{scene.name} ({args.model})") as bar:
        for frame, result in enumerate(play(model, n_steps)):
            for sensor, series in zip(sensors, measured, strict=True):
                series.append(sensor.feel(result))
            left += not result.converged
            bar.update(min(frame, 1))
    path = context.out_dir / FOLDER / f"{scene.name}_{args.model}.csv"
    write_table(path, places[0], measured[0])
    draw_series(path.with_suffix(".png"), f"{scene.name} ({args.model})", places[0], measured[0])
    context.say(
        f"{path}: {len(points)} point(s), {n_steps + 1} frames; {path.with_suffix('.png').name} shows them"
    )
    if args.surface:
        write_arrays(
            path.with_suffix(".h5"),
            places[1],
            measured[1],
            scene=scene.name,
            model=args.model,
            body_hash=body.content_hash,
            experiment=experiment.text,
        )
        context.say(f"{path.with_suffix('.h5')}: {len(places[1])} surface samples in each frame")
    if left:
        context.say(f"{left} of {n_steps} steps did not converge")
    return 0


VERB = Verb(
    name="touch",
    order=47,
    summary="Contact pressure, traction and strain at points of the body, as time series.",
    example="softprint touch examples/jelly3d_small.toml --model ours --point shoulder=0.03,0,0.05",
    run=run,
    needs=("h5py",),
    configure=configure,
)
