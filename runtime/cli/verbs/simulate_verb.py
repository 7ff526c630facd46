"""`softprint simulate`: play scenes with the bare subspace, with trained corrections, or in full space."""

from __future__ import annotations

import argparse

from softprint.runtime.cli.collider_options import add_collider_options, with_replaced_colliders
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verb import Verb


def configure(parser: argparse.ArgumentParser) -> None:
    """Scenes and models."""
    parser.add_argument(
        "--scene",
        action="append",
        metavar="NAME",
        help='a scene of the experiment; repeatable (default: every scene with role = "test")',
    )
    parser.add_argument(
        "--model",
        action="append",
        metavar="NAME",
        help="bare, condensed, full (needs DOLFINx) or the name of a trained correction, or of two: ours+modes is "
        "contact by ours on the internal correction modes; repeatable (default: bare and every correction in the run "
        "directory; condensed, too, beside internal ones)",
    )
    add_collider_options(parser)


def run(args: argparse.Namespace, context: Context) -> int:
    """Play each scene with each model; writes motions/<scene>_<model>.h5 and .xdmf in the run directory."""
    from softprint.runtime.cli.run_body import body_of_run
    from softprint.runtime.errors import SoftprintError
    from softprint.runtime.linalg.one_thread import one_thread_by_default
    from softprint.runtime.scenes.playing import check_model, usual_models
    from softprint.runtime.scenes.scene import find_scene
    from softprint.runtime.scenes.simulate import simulate_scene

    one_thread_by_default()
    experiment = context.experiment
    names = args.scene or [scene.name for scene in experiment.scenes_of_role("test")]
    if not names:
        raise SoftprintError(f'{experiment.path}: no scene has role = "test"; name one with --scene')
    scenes = [with_replaced_colliders(args, experiment, find_scene(experiment, name)) for name in names]
    body = body_of_run(context)
    models = args.model or usual_models(context.out_dir)
    for model in models:
        check_model(context.out_dir, model)
    for changed, scene in scenes:
        for model in models:
            played = simulate_scene(context, body, scene, model, changed)
            what = "kept" if played.kept else f"{played.steps_per_second:.1f} steps/s"
            context.say(f"{scene.name} with {model}: {played.path} ({what})")
    return 0


VERB = Verb(
    name="simulate",
    order=40,
    summary="Play scenes with the bare subspace, with trained corrections, or in full space.",
    example="softprint simulate examples/jelly3d_small.toml --model bare --model ours",
    run=run,
    needs=("h5py",),
    configure=configure,
)
