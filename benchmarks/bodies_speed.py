"""The speed columns of a table of bodies: frames a second of the bare subspace, the thesis's networks, ours and
full space, in contact.

    python -m benchmarks.bodies_speed examples/{jelly3d,ball,finger,hand}.toml [--cores 2] [--tolerance T] [--no-full]
    python -m benchmarks.bodies_speed examples/{jelly2d_circle,worm,duck}.toml --full-steps 20

Every body is pressed in its first test scene, springs, friction and all. Where the run directory has a trained
correction of form force, that is timed; where not, an untrained one of the same architecture, marked *, costs as much.
It is kept in the run directory as speed_stand_in_NODES_VERSION.safetensors, and the mechanics as in training. The
thesis's network is the last of form thesis4, thesis5 or thesis6 in the experiment, always an untrained one whose output
is zero: it costs what a trained one does, and contact is that of the bare subspace. A body whose run is elsewhere is
given as EXPERIMENT=DIRECTORY. On two cores the surface of a step is drawn beside the
next step, by ours and by the bare subspace; full space, and all linear algebra, go on as OPENBLAS_NUM_THREADS says.
Figures to reach on 2 cores at 30,000 to 80,000 tetrahedra: 60 frames/s with the correction in contact, and at most 4
times the cost of the bare subspace.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import torch

from softprint.runtime.body import ReducedBody
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.run_mechanics import RunMechanics
from softprint.runtime.cli.script import run_script
from softprint.runtime.cli.verbs.bench_verb import all_or_count
from softprint.runtime.colliders.build import build_collider
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import ModelSpec
from softprint.runtime.experiment.experiment import ANY_COLLIDER
from softprint.runtime.learned.correction_file import VERSION, save_correction
from softprint.runtime.learned.force.entry import options as force_options
from softprint.runtime.learned.force.model import ForceModel
from softprint.runtime.learned.form import find_form
from softprint.runtime.learned.thesis4.model import ObjectCentricModel, unit_shape
from softprint.runtime.scenes.playing import (
    SceneModel,
    bare_model,
    build_model,
    correction_path,
    model_of_file,
)
from softprint.runtime.scenes.scene import scene_steps
from softprint.runtime.scenes.speed import Speed, machine, measure, with_newton

# Of the table: heading and width of what is counted.
_COLUMNS = (("tets", 8), ("points", 8), ("frames", 8), ("dofs", 6))
_MODELS = ("bare", "thesis", "ours", "full")
# About as bodies of the examples have it: without one, contact is that of mechanics.
_ENERGY = LearnedEnergy(0.3)


def stand_in(context: Context, spec: ModelSpec, body: ReducedBody, contact_nodes: int, path: Path) -> None:
    """Write an untrained correction for any collider, with an energy that hardens, which costs what a trained one
    does."""
    torch.manual_seed(0)
    own = replace(force_options(spec, body, PenaltyContact.of(context.experiment.contact)), energy=_ENERGY.values)
    model = ForceModel(own, body.dim, body.n_rows)
    header, _ = RunMechanics(context, body).get(contact_nodes)
    told = {"untrained": "a stand-in for measurements of speed"}
    save_correction(path, spec.name, model, body, ANY_COLLIDER, "", 0.0, told, header.content_hash)


def correction_file(context: Context, body: ReducedBody, contact_nodes: int | None) -> tuple[Path, bool]:
    """That of ours in the run directory, and whether it is a trained one. contact_nodes: of a stand-in, at most."""
    experiment, out = context.experiment, context.out_dir
    specs = [spec for spec in experiment.training.models if find_form(spec.form).needs_mechanics]
    if not specs:
        raise SoftprintError(f"{experiment.path}: no model of form force among [[training.models]]")
    trained = correction_path(out, specs[-1].name)
    if contact_nodes is None and trained.is_file():
        return trained, True
    count = contact_nodes or specs[-1].contact_nodes
    path = out / f"speed_stand_in_{count}_{VERSION}.safetensors"
    if not path.is_file():
        stand_in(context, specs[-1], body, count, path)
    return path, False


def thesis_file(context: Context, body: ReducedBody, collider: str) -> Path | None:
    """The last of the thesis's networks in the experiment, untrained, for one collider; None where it has none."""
    experiment = context.experiment
    specs = [spec for spec in experiment.training.models if spec.form.startswith("thesis")]
    if not specs:
        return None
    spec, path = specs[-1], context.out_dir / f"speed_stand_in_{specs[-1].name}_{VERSION}.safetensors"
    if not path.is_file():
        form = find_form(spec.form)
        own = form.options(spec, body, PenaltyContact.of(experiment.contact))
        model = form.model(own.to_json(), body.dim, body.n_rows)
        with torch.no_grad():
            for last in list(model.parameters())[-2:]:
                last.zero_()
            if isinstance(model, ObjectCentricModel):
                shape = build_collider(experiment.collider(collider), experiment.base_dir)
                model.shape.copy_(torch.as_tensor(unit_shape(shape)))
                model.sizes.fill_(shape.size)
        told = {"untrained": "a stand-in for measurements of speed"}
        save_correction(path, spec.name, model, body, collider, "", 0.0, told)
    return path


def measured(context: Context, options: argparse.Namespace) -> str:
    """One body's line of the table."""
    body = body_of_run(context)
    path, trained = correction_file(context, body, options.contact_nodes)
    experiment = with_newton(context.experiment, options.iterations, options.tolerance)
    scene = experiment.scenes_of_role("test")[0]
    models: dict[str, SceneModel] = {"bare": bare_model(experiment, body, scene)}
    thesis = thesis_file(context, body, scene.colliders[0].name)
    if thesis is not None:
        models["thesis"] = model_of_file(experiment, body, scene, thesis)
    models["ours"] = model_of_file(experiment, body, scene, path)
    if find_spec("dolfinx") is not None and not options.no_full:
        models["full"] = build_model(experiment, body, scene, context.out_dir, "full")
    n = scene_steps(experiment, scene)
    steps = dict.fromkeys(models, options.steps)
    if options.full_steps is not None:
        steps["full"] = options.full_steps
    speeds = {
        name: measure(name, model, n, steps[name], options.cores == 2) for name, model in models.items()
    }
    handles = body.handles
    counts = (body.mesh.n_cells, handles.n_points, len(handles.frames), handles.n_dofs)
    name = experiment.name if trained else f"{experiment.name}*"
    return table_line(name, counts, speeds)


def table_head() -> str:
    """What the columns are."""
    heads = [f"{head:>{width}}" for head, width in _COLUMNS]
    heads += [
        f"{name + ' ms':>9}{'95 %':>8}{'median':>8}{'CPU ms':>8}{'1/s':>8}{'Newton':>8}{'conv.':>7}"
        for name in _MODELS
    ]
    return f"{'body':<16}{''.join(heads)}{'of bare':>9}{'full is':>9}"


def table_line(name: str, counts: Sequence[int], speeds: Mapping[str, Speed | None]) -> str:
    """Of the steps in contact: mean, 95th percentile and median of the time, mean CPU time, frames a second by the
    mean, Newton iterations, share that converged."""
    cells = [f"{count:>{width}}" for count, (_, width) in zip(counts, _COLUMNS, strict=True)]
    for model in _MODELS:
        speed = speeds.get(model)
        cells.append(
            f"{'-':>9}{'-':>8}{'-':>8}{'-':>8}{'-':>8}{'-':>8}{'-':>7}"
            if speed is None
            else f"{1e3 * speed.mean:>9.2f}{1e3 * speed.p95:>8.2f}{1e3 * speed.median:>8.2f}"
            f"{1e3 * speed.cpu:>8.2f}{speed.frames_per_second:>8.1f}"
            f"{speed.iterations:>8.1f}{speed.converged:>7.0%}"
        )
    bare, own, full = (speeds.get(model) for model in ("bare", "ours", "full"))
    cells.append(f"{own.mean / bare.mean:>8.2f}x" if own and bare else f"{'-':>9}")
    cells.append(f"{full.mean / own.mean:>8.1f}x" if full and own else f"{'-':>9}")
    return f"{name:<16}{''.join(cells)}"


def main() -> None:
    """Time every body, print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiments", nargs="+", help="experiment files, or EXPERIMENT=RUN_DIRECTORY")
    parser.add_argument(
        "--steps", type=all_or_count, default="all", help="time only so many steps in contact (default: all)"
    )
    parser.add_argument(
        "--full-steps", type=all_or_count, help="the same for full space (default: as --steps)"
    )
    parser.add_argument("--iterations", type=int, help="of Newton a step at most (default: to convergence)")
    parser.add_argument("--tolerance", type=float, help="of a step's residual (default: the experiment's)")
    parser.add_argument(
        "--contact-nodes", type=int, help="of an untrained stand-in (default: the experiment's)"
    )
    parser.add_argument("--no-full", action="store_true", help="leave full space out")
    parser.add_argument("--cores", type=int, choices=(1, 2), default=1, help="(default: 1)")
    options = parser.parse_args()
    here = machine()
    print(
        f"{here['processor']}, {here['cores']} cores, {options.cores} used, "
        f"BLAS {here['threads'] or 'not limited'}, tolerance {options.tolerance or 'as each experiment says'}"
    )
    print(table_head())
    for given in options.experiments:
        file, _, out = given.partition("=")
        context = Context(experiment_path=Path(file), out=Path(out) if out else None)
        print(measured(context, options), flush=True)
    print(
        "ms: mean of steps in contact, the surface's positions included, then their 95th percentile and their median; "
        "* untrained, of the same architecture"
    )


if __name__ == "__main__":
    run_script(main)
