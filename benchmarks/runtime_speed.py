"""How fast is a step at thesis scale? Bare subspace, learned correction and full space, side by side in one
run.

    python -m benchmarks.runtime_speed [examples/jelly3d.toml] [--iterations N]

Every model steps to the tolerance of the experiment, or, with `--iterations`, N Newton iterations at most.
Needs no training: where the run directory has no trained correction of an experiment's `[[training.models]]`,
one of the same architecture with random weights and the size of real displacements stands in, which costs
exactly as much. Figures to reach at 60,000 tetrahedra on 2 cores: 100 frames/s or more with the correction in
contact, at least 6 times faster than full space, at most 4 times the cost of the bare subspace.
"""

from __future__ import annotations

import argparse
from importlib.util import find_spec
from pathlib import Path

import torch

from runtime.body import ReducedBody
from runtime.cli.context import Context
from runtime.cli.run_body import body_of_run
from runtime.colliders.build import build_collider
from runtime.corrections.contact_centric import ContactCentric
from runtime.corrections.correction import Correction
from runtime.corrections.correction_file import load_correction
from runtime.corrections.elastic_contact import ElasticContact
from runtime.corrections.load_model import LoadModel
from runtime.corrections.model import ContactModel
from runtime.corrections.options import load_model_options, model_options
from runtime.corrections.rest_mechanics import compute_rest_mechanics
from runtime.dynamics.model import ReducedModel, bare_model, build_model, correction_path
from runtime.dynamics.scene import scene_parts, scene_simulator, scene_steps
from runtime.dynamics.speed import machine, measure, speed_table, with_iterations
from runtime.experiment import Experiment, ModelSpec

DISPLACEMENT = 2e-4  # m, RMS of a typical contact displacement


def stand_in(spec: ModelSpec, body: ReducedBody, experiment: Experiment) -> Correction:
    """An untrained correction of the architecture of a `[[training.models]]` table."""
    collider = build_collider(experiment.collider(experiment.training.collider), experiment.base_dir)
    torch.manual_seed(0)
    if spec.form == "loads":
        mechanics = compute_rest_mechanics(body, spec.loads, spec.internal, experiment.dynamics.gravity)
        loads = LoadModel(load_model_options(spec, experiment.contact.stiffness), body.dim, body.n_rows)
        return ElasticContact(spec.name, loads, body, collider, mechanics)
    model = ContactModel(model_options(spec), body.dim, body.n_rows)
    model.output_scale.fill_(DISPLACEMENT)
    return ContactCentric(spec.name, model, body, collider)


def main() -> None:
    """Build or load the body, time every model on the first test scene, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path, nargs="?", default=Path("examples/jelly3d.toml"))
    parser.add_argument("--out", type=Path, help="run directory (default: runs/NAME)")
    parser.add_argument(
        "--iterations", type=int, help="at most so many a step, converged or not (default: to convergence)"
    )
    parser.add_argument("--steps", type=int, default=60, help="steps in contact to time (default: 60)")
    parser.add_argument("--no-full", action="store_true", help="leave full space out")
    options = parser.parse_args()

    context = Context(experiment_path=options.experiment, out=options.out)
    body = body_of_run(context)
    experiment = with_iterations(context.experiment, options.iterations)
    scene = experiment.scenes_of_role("test")[0]
    parts = scene_parts(experiment, scene)
    collider = next(
        placed.collider for placed in parts.colliders if placed.name == experiment.training.collider
    )

    models = {"bare": bare_model(experiment, body, scene)}
    for spec in experiment.training.models:
        path = correction_path(context.out_dir, spec.name)
        trained = path.is_file()
        correction = load_correction(path, body, collider) if trained else stand_in(spec, body, experiment)
        name = spec.name if trained else f"{spec.name}*"
        models[name] = ReducedModel(scene_simulator(body, parts, [correction]), parts.held)
    speeds = [
        measure(name, model, scene_steps(experiment, scene), options.steps) for name, model in models.items()
    ]
    if find_spec("dolfinx") is not None and not options.no_full:
        full = build_model(experiment, body, scene, context.out_dir, "full")
        speeds.append(measure("full", full, scene_steps(experiment, scene), options.steps))

    here = machine()
    print(
        f"{body.name}: {body.mesh.n_cells} cells, {body.n_rows * body.dim} subspace columns, "
        f"{len(body.cubature.cells)} cubature cells, {len(body.surface.nodes)} surface samples"
    )
    print(f"{here['processor']}, {here['cores']} cores, threads {here['threads'] or 'not limited'}")
    for line in speed_table([speed for speed in speeds if speed is not None]):
        print(line)
    print("* untrained stand-in of the same architecture")


if __name__ == "__main__":
    main()
