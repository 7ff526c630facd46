"""`softprint bench`: how long a step takes, compared over models."""

from __future__ import annotations

import argparse
import json
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verb import Verb

if TYPE_CHECKING:
    from softprint.runtime.body import ReducedBody
    from softprint.runtime.experiment import Experiment, SceneSpec
    from softprint.runtime.scenes.speed import Speed

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
        help="repeatable (default: bare, every trained correction, and full if DOLFINx is installed)",
    )
    parser.add_argument(
        "--iterations",
        type=int,
        metavar="N",
        help="limit of Newton iterations in a step, converged or not (default: that of the experiment)",
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
        help="2: a second process draws the surface of a step during the next one, for reduced models (default: 1)",
    )


def all_or_count(text: str) -> int | None:
    """The number of steps; None for `all`."""
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
    """Print a table, and write it as bench.json to the run directory."""
    from softprint.runtime.cli.run_body import body_of_run
    from softprint.runtime.errors import SoftprintError
    from softprint.runtime.io.files import provenance
    from softprint.runtime.linalg.one_thread import one_thread_by_default
    from softprint.runtime.scenes.scene import find_scene
    from softprint.runtime.scenes.speed import machine, speed_table, speeds_as_json, with_newton

    if args.iterations is not None and args.iterations < 1:
        raise SoftprintError("--iterations must be at least 1")
    tests = context.experiment.scenes_of_role("test")
    if args.scene is None and not tests:
        raise SoftprintError(f'{context.experiment.path}: no scene has role = "test"; name one with --scene')
    scene = find_scene(context.experiment, args.scene or tests[0].name)
    experiment = with_newton(context.experiment, args.iterations)
    body = body_of_run(context)
    one_thread_by_default()
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
        + ("during the next step" if args.cores == 2 else "after their step")
    )
    context.say(", ".join(f"{count} {name.replace('_', ' ')}" for name, count in sizes.items()))
    context.say(f"{here['processor']}, {here['cores']} cores, {here['threads']} thread(s) of linear algebra")
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
    """The requested models, one after the other."""
    from softprint.runtime.errors import SoftprintError
    from softprint.runtime.scenes.playing import build_model, usual_models
    from softprint.runtime.scenes.scene import scene_steps
    from softprint.runtime.scenes.speed import measure

    full = ["full"] if find_spec("dolfinx") is not None else []
    speeds = []
    for name in args.model or [*usual_models(context.out_dir), *full]:
        with context.stage(f"preparing {scene.name} ({name})"):
            model = build_model(experiment, body, scene, context.out_dir, name)
        n_steps = scene_steps(experiment, scene)
        with context.progress(n_steps, "steps", f"{scene.name} ({name})") as bar:
            speed = measure(name, model, n_steps, args.steps, args.cores == 2, bar.update)
        if speed is None:
            raise SoftprintError(
                f"scene {scene.name!r} has no contact with the model {name!r}: nothing to measure"
            )
        speeds.append(speed)
    return speeds


def _keep(context: Context, report: dict[str, Any]) -> None:
    from softprint.runtime.io.files import atomic_path

    path = context.out_dir / REPORT
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(report, indent=2))
    context.say(f"written to {path}")


VERB = Verb(
    name="bench",
    order=60,
    summary="Time a step with every model.",
    example="softprint bench examples/jelly3d_small.toml --model bare --model ours",
    run=run,
    needs=("h5py",),
    configure=configure,
)
