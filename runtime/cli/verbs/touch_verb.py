"""`softprint touch`: contact pressure, traction and strain at points of a body while a scene is played, and what a
camera behind it sees."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from softprint.runtime.cli.collider_options import add_collider_options, with_replaced_colliders
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verb import Verb

if TYPE_CHECKING:
    from softprint.runtime.body import ReducedBody
    from softprint.runtime.experiment import Experiment, SceneSpec
    from softprint.runtime.touch import TactileCamera, TactileImage

FOLDER = "touch"


def configure(parser: argparse.ArgumentParser) -> None:
    """Scene, model and points."""
    parser.add_argument(
        "--scene", metavar="NAME", help='a scene of the experiment (default: the first with role = "test")'
    )
    parser.add_argument(
        "--model",
        action="append",
        metavar="NAME",
        help="bare, full (needs DOLFINx) or the name of a trained correction; repeatable, for pictures side by side "
        "(default: bare)",
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
    parser.add_argument(
        "--markers",
        type=_counts,
        metavar="COLUMNSxROWS",
        help="what a camera behind the body sees: the displacement of so many markers on one side of it, such as 12x9, "
        "as HDF5 with a picture (default: off, or 12x9 with --depth-image; in 2D one number)",
    )
    parser.add_argument(
        "--depth-image",
        type=_counts,
        metavar="COLUMNSxROWS",
        help="likewise the depth of the surface in so many pixels, such as 64x48 (default: off, or 64x48 with "
        "--markers)",
    )
    parser.add_argument(
        "--side", metavar="AXIS", help="the side that the camera sees, such as --side=-z (default: up)"
    )
    parser.add_argument(
        "--field",
        type=_lengths,
        metavar="WIDTHxHEIGHT",
        help="the size of its field of view [m], such as 0.02x0.015 (default: on nine tenths of the side)",
    )
    add_collider_options(parser)


def _counts(text: str) -> list[int]:
    try:
        return [int(number) for number in text.lower().split("x")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form 12x9, columns and rows") from None


def _lengths(text: str) -> list[float]:
    try:
        return [float(number) for number in text.lower().split("x")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form 0.02x0.015, in metres") from None


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
    """Play the scene; write touch/SCENE_MODEL.csv and .png in the run directory, and .h5 with --surface; with a camera,
    SCENE_MODEL_camera.h5, and SCENE_MODELS_camera.png."""
    from softprint.runtime.cli.run_body import body_of_run
    from softprint.runtime.errors import SoftprintError
    from softprint.runtime.scenes.playing import check_model
    from softprint.runtime.scenes.scene import find_scene
    from softprint.runtime.touch.camera_series import draw_images

    experiment = context.experiment
    names = [args.scene] if args.scene else [scene.name for scene in experiment.scenes_of_role("test")]
    if not names:
        raise SoftprintError(f'{experiment.path}: no scene has role = "test"; name one with --scene')
    experiment, scene = with_replaced_colliders(args, experiment, find_scene(experiment, names[0]))
    point_names = [name for name, _ in args.point or []]
    if len(set(point_names)) < len(point_names):
        raise SoftprintError(f"two points have the same name; the names are {', '.join(point_names)}")
    if not (args.markers or args.depth_image) and (args.side or args.field):
        raise SoftprintError("--side and --field are of the camera: add --markers or --depth-image")
    body = body_of_run(context)
    models = list(dict.fromkeys(args.model or ["bare"]))
    for model in models:
        check_model(context.out_dir, model)
    seen = {model: _play(args, context, experiment, scene, body, model) for model in models}
    cameras = [camera for camera, _ in seen.values() if camera is not None]
    if cameras:
        path = context.out_dir / FOLDER / f"{scene.name}_{'_'.join(models)}_camera.png"
        draw_images(path, scene.name, cameras[0], {model: images for model, (_, images) in seen.items()})
        context.say(f"{path}: the frame of the largest force")
    return 0


def _play(
    args: argparse.Namespace,
    context: Context,
    experiment: Experiment,
    scene: SceneSpec,
    body: ReducedBody,
    name: str,
) -> tuple[TactileCamera | None, list[TactileImage]]:
    """Play the scene with one model and write its files, all but the picture of the camera."""
    import numpy as np

    from softprint.runtime.linalg.one_thread import one_thread_by_default
    from softprint.runtime.scenes.playing import build_model, play
    from softprint.runtime.scenes.scene import scene_steps
    from softprint.runtime.touch import TactileCamera, Touch, TouchSensor, point_places, surface_places
    from softprint.runtime.touch.camera_series import write_images
    from softprint.runtime.touch.series import draw_series, write_arrays, write_table

    points = dict(args.point or [("top", body.mesh.points[np.argmax(body.mesh.points[:, -1])])])
    places = [point_places(body, points), *([surface_places(body)] if args.surface else [])]
    one_thread_by_default()
    with context.stage(f"preparing {scene.name} ({name})"):
        model = build_model(experiment, body, scene, context.out_dir, name)
        sensors = [TouchSensor(model, body, sensed) for sensed in places]
        camera = None
        if args.markers or args.depth_image:
            flat = body.dim == 2
            markers, image = (
                args.markers or ([12] if flat else [12, 9]),
                args.depth_image or ([64] if flat else [64, 48]),
            )
            camera = TactileCamera(
                model, body, side=args.side, markers=markers, image=image, field=args.field
            )
    measured: list[list[Touch]] = [[] for _ in sensors]
    images: list[TactileImage] = []
    n_steps, left = scene_steps(experiment, scene), 0
    with context.progress(n_steps, "steps", f"{scene.name} ({name})") as bar:
        for frame, result in enumerate(play(model, n_steps)):
            for sensor, series in zip(sensors, measured, strict=True):
                series.append(sensor.feel(result))
            images += [] if camera is None else [camera.see(result)]
            left += not result.converged
            bar.update(min(frame, 1))
    path = context.out_dir / FOLDER / f"{scene.name}_{name}.csv"
    write_table(path, places[0], measured[0])
    draw_series(path.with_suffix(".png"), f"{scene.name} ({name})", places[0], measured[0])
    context.say(
        f"{path}: {len(points)} point(s), {n_steps + 1} frames; {path.with_suffix('.png').name} shows them"
    )
    texts = {
        "scene": scene.name,
        "model": name,
        "body_hash": body.content_hash,
        "experiment": experiment.text,
    }
    if args.surface:
        write_arrays(path.with_suffix(".h5"), places[1], measured[1], **texts)
        context.say(f"{path.with_suffix('.h5')}: {len(places[1])} surface samples in each frame")
    if camera is not None:
        file = path.with_name(f"{path.stem}_camera.h5")
        write_images(file, camera, images, **texts)
        context.say(f"{file}: {len(camera.places)} markers and the depth image in each frame")
    if left:
        context.say(f"{left} of {n_steps} steps did not converge")
    return camera, images


VERB = Verb(
    name="touch",
    order=47,
    summary="Contact pressure, traction and strain at points of the body, and what a camera behind it sees.",
    example="softprint touch examples/jelly3d_small.toml --model ours --point shoulder=0.03,0,0.05",
    run=run,
    needs=("h5py",),
    configure=configure,
)
