"""`softprint bench`: how long a step takes, for all models side by side."""

from __future__ import annotations

import argparse
import json
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from runtime.cli.context import Context
from runtime.cli.verb import Verb

if TYPE_CHECKING:
    from runtime.body import ReducedBody
    from runtime.experiment import Experiment, SceneSpec
    from runtime.scenes.speed import Speed

REPORT = "bench.json"


def configure(parser: argparse.ArgumentParser) -> None:
    """Scene, models, Newton iterations, steps, threads."""
    parser.add_argument(
        "--scene", metavar="NAME", help='a scene with contact (default: the first with role = "test")'
    )
    parser.add_argument(
        "--model",
        action="append",
        metavar="NAME",
        help="may be given again (default: bare, every trained correction, and full where DOLFINx is and no "
        "collider moves freely)",
    )
    parser.add_argument(
        "--iterations",
        type=int,
        metavar="N",
        help="at most so many Newton iterations a step, converged or not (default: those of the experiment)",
    )
    parser.add_argument(
        "--steps",
        type=all_or_count,
        default="all",
        metavar="N",
        help="time only the first N steps with contact of each model (default: all)",
    )
    parser.add_argument(
        "--cores",
        type=int,
        choices=(1, 2),
        default=1,
        help="2: a process of its own draws the surface of a step beside the next one, of reduced models (default: 1)",
    )


def all_or_count(text: str) -> int | None:
    """How many steps are asked for; None for `all` of them."""
    if text == "all":
        return None
    try:
        count = int(text)
    except ValueError:
        count = 0
    if count < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is neither 'all' nor a number of at least 1")
    return count


def run(args: argparse.Namespace, context: Context) -> int:
    """Print a table, and keep it as bench.json in the run directory."""
    from runtime.cli.run_body import body_of_run
    from runtime.errors import SoftprintError
    from runtime.io.files import provenance
    from runtime.scenes.scene import find_scene
    from runtime.scenes.speed import machine, speed_table, speeds_as_json, with_newton

    if args.iterations is not None and args.iterations < 1:
        raise SoftprintError("--iterations must be at least 1")
    tests = context.experiment.scenes_of_role("test")
    if args.scene is None and not tests:
        raise SoftprintError(f'{context.experiment.path}: no scene has role = "test"; name one with --scene')
    scene = find_scene(context.experiment, args.scene or tests[0].name)
    experiment = with_newton(context.experiment, args.iterations)
    body = body_of_run(context)
    speeds = _measured(args, context, experiment, body, scene)
    sizes = {
        "cells": body.mesh.n_cells,
        "nodes": body.n_nodes,
        "rows": body.n_rows,
        "cubature_cells": len(body.cubature.cells),
        "surface_samples": len(body.surface.nodes),
    }
    here = machine()
    context.say(
        f"{scene.name}, at most {experiment.dynamics.max_iterations} Newton iterations a step to a residual of "
        f"{experiment.dynamics.tolerance:g}, h = {experiment.dynamics.time_step:.4g} s; surfaces are drawn "
        + ("beside the next step" if args.cores == 2 else "after their step")
    )
    context.say(", ".join(f"{count} {name.replace('_', ' ')}" for name, count in sizes.items()))
    context.say(
        f"{here['processor']}, {here['cores']} cores, BLAS threads {here['threads'] or 'not limited'}"
    )
    for line in speed_table(speeds):
        context.say(line)
    _keep(
        context,
        {
            "scene": scene.name,
            "iterations": experiment.dynamics.max_iterations,
            "tolerance": experiment.dynamics.tolerance,
            "cores_used": args.cores,
            "time_step": experiment.dynamics.time_step,
            "sizes": sizes,
            "machine": here,
            "software": provenance(),
            "speeds": speeds_as_json(speeds),
        },
    )
    return 0


def _measured(
    args: argparse.Namespace, context: Context, experiment: Experiment, body: ReducedBody, scene: SceneSpec
) -> list[Speed]:
    """Every model that is asked for, one after the other."""
    from runtime.errors import SoftprintError
    from runtime.scenes.playing import BARE, build_model, trained_models
    from runtime.scenes.scene import scene_steps
    from runtime.scenes.speed import measure

    led = not any(collider.free for collider in scene.colliders)  # full space plays no others
    full = ["full"] if led and find_spec("dolfinx") is not None else []
    speeds = []
    for name in args.model or [BARE, *trained_models(context.out_dir), *full]:
        model = build_model(experiment, body, scene, context.out_dir, name)
        speed = measure(name, model, scene_steps(experiment, scene), args.steps, args.cores == 2)
        if speed is None:
            raise SoftprintError(
                f"scene {scene.name!r} has no contact with the model {name!r}: nothing to measure"
            )
        speeds.append(speed)
    return speeds


def _keep(context: Context, report: dict[str, Any]) -> None:
    from runtime.io.files import atomic_path

    path = context.out_dir / REPORT
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(report, indent=2))
    context.say(f"kept in {path}")


VERB = Verb(
    name="bench",
    order=60,
    summary="Time a step with every model, side by side.",
    example="softprint bench examples/jelly3d_small.toml --model bare --model ours",
    run=run,
    needs=("h5py",),
    configure=configure,
)
