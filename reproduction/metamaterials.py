"""Two metamaterials stretched and bent: figure 4.8 of the thesis as numbers.

    softprint generate examples/accordion_small.toml
    softprint train examples/accordion_small.toml
    python -m reproduction.metamaterials examples/accordion_small.toml

Models: full space, the bare subspace, condensation alone, and the internal corrections of the run directory. Tables in
Markdown:

    statics      at each stretch of the bar, settled: effective Poisson's ratio -e_y / e_x of the middle half of the bar
                 (the affine motion nearest to that of its nodes); ripple: how much farther out the surface is in the
                 middle of stiff stripes than in that of soft ones [mm], of bodies of two materials; energy: elastic,
                 over that of full space; error: distance of nodes from full space, RMS, over that of the bare subspace;
                 at its state: the same with the handles where those of full space are
    motion       the test scene: error as above over all nodes and frames; iterations of a step; steps that did not
                 converge; steps in a second, by the processor's time
    jacobians    the same motion with the three Jacobians of figure 4.4

and, for the Auxetic, the Poisson's ratio of one of its cells, in the linear limit (`reproduction/reentrant_cell.py`).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from meshes.accordion import STRIPE, STRIPES
from softprint.fem_truth.dynamics.full_space_simulator import FullSpaceSimulator
from softprint.runtime.arrays import Array
from softprint.runtime.body import ReducedBody
from softprint.runtime.body.cubature import Cubature, elastic_cells
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders import KeyframedPath
from softprint.runtime.dynamics import KinematicHandle, NewtonSettings, Simulator
from softprint.runtime.dynamics.kinematic import place_kinematic
from softprint.runtime.elasticity.displacement_field import InternalField
from softprint.runtime.elasticity.elastic_energy import elastic_energy
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import Experiment
from softprint.runtime.learned.internal.correction import JACOBIANS, InternalCorrection
from softprint.runtime.learned.internal.file import load_internal
from softprint.runtime.learned.internal.model import ModesModel
from softprint.runtime.learned.internal_correction import internal_correction
from softprint.runtime.mechanics.body_mechanics import BodyMechanics
from softprint.runtime.mechanics.compliance.null_space_compliance import NullSpaceCompliance
from softprint.runtime.mechanics.static_condensation import compute_static_condensation
from softprint.runtime.scenes.corrected_body import internal_path
from softprint.runtime.scenes.playing import internal_models
from softprint.runtime.scenes.scene import scene_parts, scene_steps

TABLES = ("statics", "motion", "jacobians")
STEPS = 4  # from rest to the largest stretch
# Full space is settled to the round-off of its energy.
SETTLED = NewtonSettings(max_iterations=100, tolerance=5e-5)


class Kinematics(NamedTuple):
    """What a reduced model adds to its subspace. body: with the cubature of the model."""

    body: ReducedBody
    mechanics: BodyMechanics | None
    internal: InternalField | None

    def positions(self, rows: Array) -> Array:
        """(n_nodes, dim) [m] at handle rows (n_rows, dim)."""
        x = self.body.reduced_positions(rows)
        condensation = None if self.mechanics is None else self.mechanics.condensation
        if condensation is not None:
            x += condensation.corotated(rows).displacement(rows)
        return x if self.internal is None else x + self.internal.bind().displacement(rows)


@dataclass(frozen=True, eq=False)
class Run:
    """One model of one scene: positions (n_frames, n_nodes, dim), iterations of its steps, how many did not converge,
    and seconds of the processor."""

    positions: Array
    iterations: Array
    failed: int
    seconds: float


def kinematics(context: Context, body: ReducedBody, all_cells: bool) -> dict[str, Kinematics]:
    """The reduced models by name; all_cells: without a cubature."""
    cells = elastic_cells(body.mesh, body.handles)
    whole = replace(body, cubature=Cubature(cells, body.mesh.cell_volumes[cells], 0.0, 0.0))
    condensed = BodyMechanics(None, compute_static_condensation(body, None, NullSpaceCompliance(body)))
    found = {"bare": Kinematics(body, None, None), "condensation": Kinematics(body, condensed, None)}
    names = internal_models(context.out_dir)
    if not names:
        raise SoftprintError(f"{context.out_dir} has no internal correction: run `softprint train` first")
    for name in names:
        trained = load_internal(internal_path(context.out_dir, name), body)
        trained = trained._replace(cubature=None) if all_cells else trained
        internal = internal_correction(trained, whole if all_cells else body)
        mechanics = condensed if internal.on_condensation else None
        found[name] = Kinematics(trained.on(body), mechanics, internal)
    if not all_cells:
        return found
    return {name: own._replace(body=whole) for name, own in found.items()}


def poisson_ratio(body: ReducedBody, x: Array) -> float:
    """-e_y / e_x of the affine motion nearest to that of the nodes in the middle half of the bar."""
    rest = body.mesh.points
    low, high = rest[:, 0].min(), rest[:, 0].max()
    middle = np.abs(rest[:, 0] - 0.5 * (low + high)) < 0.25 * (high - low)
    places = np.column_stack([rest[middle], np.ones(middle.sum())])
    F = np.linalg.lstsq(places, x[middle], rcond=None)[0][:2].T
    return float(-(F[1, 1] - 1.0) / (F[0, 0] - 1.0))


def ripple(body: ReducedBody, x: Array) -> float:
    """[m] mean distance of the surface from the axis in the middle of inner stiff stripes of the Accordion, less that
    of soft ones."""
    rest = body.mesh.points
    number = rest[:, 0] / STRIPE - 0.5
    surface = np.isclose(np.abs(rest[:, 1]), np.abs(rest[:, 1]).max(), rtol=1e-6)
    middle = surface & (np.abs(number - np.round(number)) < 1e-3)
    inner = middle & (number > 2.5) & (number < STRIPES - 3.5)
    stiff = np.round(number) % 2 == 0
    return float(np.abs(x[inner & stiff, 1]).mean() - np.abs(x[inner & ~stiff, 1]).mean())


def stretched(
    experiment: Experiment, body: ReducedBody, models: Mapping[str, Kinematics], largest: float
) -> list[dict[str, Array]]:
    """Positions by model, "full" among them, at every stretch from rest to the largest [m], settled one after the
    other."""
    ends = body.handles.frames[0].name, body.handles.frames[1].name
    parts = scene_parts(experiment, experiment.scenes[0])
    found: list[dict[str, Array]] = []
    states: dict[str, Any] = {}
    for step in range(1, STEPS + 1):
        pulled = KeyframedPath([0.0], [[largest * step / STEPS, 0.0]])
        held: dict[str, Any] = {
            "contact": parts.contact,
            "kinematic": (KinematicHandle(ends[0]), KinematicHandle(ends[1], pulled)),
        }
        simulators: dict[str, Any] = {
            name: Simulator(own.body, mechanics=own.mechanics, internal=own.internal, **held)
            for name, own in models.items()
        }
        simulators["full"] = FullSpaceSimulator(body, **held)
        here = {}
        for name, simulator in simulators.items():
            result = _settled(simulator, states.get(name), held["kinematic"])
            if not result.converged:
                print(f"{name}, step {step}: not settled: {result.status.sentence} ({result.residual:.1e})")
            states[name] = result.state
            here[name] = simulator.positions(result.state)
        found.append(here)
    return found


def _settled(simulator: Any, before: Any, kinematic: Sequence[KinematicHandle]) -> Any:
    """Static equilibrium, started from that of the step before with the ends where they are now."""
    if isinstance(simulator, FullSpaceSimulator):
        return simulator.settle(before, SETTLED)
    rest = simulator.rest_state()
    if before is None:
        return simulator.settle(rest)
    body = simulator.body
    rows = place_kinematic(before.rows, body.rest_rows, body.handles, kinematic, 0.0)
    return simulator.settle(replace(rest, rows=rows))


def statics(
    body: ReducedBody,
    models: Mapping[str, Kinematics],
    found: Sequence[Mapping[str, Array]],
    largest: float,
) -> list[str]:
    """The lines of the first table."""
    two = np.ptp(np.asarray(body.material.young)) > 0.0
    lines = [
        "| stretch [mm] | model | Poisson's ratio | "
        + ("ripple [mm] | " if two else "")
        + "energy | error | at its state |",
        "| --- | --- | --- | " + ("--- | " if two else "") + "--- | --- | --- |",
    ]
    for step, here in enumerate(found, start=1):
        full = here["full"]
        missed = np.linalg.norm(here["bare"] - full)
        energy, rows = elastic_energy(body.mesh, body.material, full), body.project(full)
        start = np.linalg.norm(models["bare"].positions(rows) - full)
        for name in ("full", *(name for name in here if name != "full")):
            x = here[name]
            cells = [f"{1e3 * largest * step / len(found):.1f}", name, f"{poisson_ratio(body, x):.3f}"]
            cells += [f"{1e3 * ripple(body, x):.3f}"] if two else []
            cells.append(f"{elastic_energy(body.mesh, body.material, x) / energy:.3f}")
            cells.append(f"{np.linalg.norm(x - full) / missed:.1%}")
            held = full if name == "full" else models[name].positions(rows)
            cells.append(f"{np.linalg.norm(held - full) / start:.1%}")
            lines.append(f"| {' | '.join(cells)} |")
    return lines


def played(simulator: Any, n_steps: int) -> Run:
    """A scene from its static equilibrium on."""
    result = simulator.settle()
    positions, iterations, failed, seconds = [simulator.positions(result.state)], [], 0, 0.0
    for _ in range(n_steps):
        started = time.process_time()
        result = simulator.step(result.state)
        seconds += time.process_time() - started
        positions.append(simulator.positions(result.state))
        iterations.append(result.iterations)
        failed += not result.converged
    return Run(np.array(positions), np.array(iterations), failed, seconds)


def motion_simulator(experiment: Experiment, make: Callable[..., Any], body: ReducedBody, **more: Any) -> Any:
    """A simulator of the test scene."""
    parts = scene_parts(experiment, experiment.scenes_of_role("test")[0])
    return make(
        body,
        parts.colliders,
        contact=parts.contact,
        gravity=parts.gravity,
        springs=parts.springs,
        kinematic=parts.kinematic,
        settings=parts.settings,
        **more,
    )


def motions(runs: Mapping[str, Run]) -> list[str]:
    """The lines of the second and third tables."""
    full = runs["full"].positions
    missed = np.linalg.norm(runs["bare"].positions - full)
    lines = ["| model | error | iterations | not converged | steps/s |", "| --- | --- | --- | --- | --- |"]
    for name, run in runs.items():
        error = np.linalg.norm(run.positions - full) / missed
        rate = len(run.iterations) / run.seconds
        lines.append(f"| {name} | {error:.1%} | {run.iterations.mean():.1f} | {run.failed} | {rate:.1f} |")
    return lines


def picture(path: Path, body: ReducedBody, here: Mapping[str, Array]) -> None:
    """Every model beside the outline of full space, in dots: one above the other where the bar is long."""
    import matplotlib.pyplot as plt

    young = np.broadcast_to(np.asarray(body.material.young), body.mesh.n_cells)
    outline = here["full"][body.mesh.surface_nodes]
    across, up = np.ptp(outline, axis=0)
    shape = (len(here), 1) if across > 3.0 * up else (1, len(here))
    figure, axes = plt.subplots(*shape, figsize=(4.0 * shape[1], 4.0), layout="constrained")
    for axis, (name, x) in zip(axes, sorted(here.items(), key=lambda own: own[0] != "full"), strict=True):
        axis.tripcolor(
            *x.T, body.mesh.cells, facecolors=young, cmap="coolwarm", vmin=0.0, vmax=1.5 * young.max()
        )
        axis.plot(*outline.T, "k.", markersize=0.8)
        axis.set_title(name, fontsize=9)
        axis.set_aspect("equal")
        axis.axis("off")
    figure.savefig(path, dpi=160)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="run directory (default: runs/NAME)")
    parser.add_argument(
        "--tables", nargs="+", choices=TABLES, default=TABLES, help="which tables (default: all)"
    )
    parser.add_argument("--steps", type=int, help="of the motion (default: the whole scene)")
    parser.add_argument(
        "--all-cells", action="store_true", help="integrate all models over all cells, without a cubature"
    )
    parser.add_argument("--picture", type=Path, metavar="FILE.png", help="of the largest stretch")
    options = parser.parse_args()
    context = Context(experiment_path=options.experiment, out=options.out, quiet=True)
    experiment, body = context.experiment, body_of_run(context)
    try:
        models = kinematics(context, body, options.all_cells)
    except SoftprintError as error:
        parser.error(str(error))
    if "statics" in options.tables:
        # As far as the scenes that states are recorded in.
        led = [entry for entry in experiment.scenes[0].kinematic if not isinstance(entry, int | str)]
        largest = max(frame.position[0] for entry in led for frame in entry.keyframes)
        found = stretched(experiment, body, models, largest)
        print("\n" + "\n".join(statics(body, models, found, largest)), flush=True)
        if options.picture:
            picture(options.picture, body, found[-1])
    count = options.steps or scene_steps(experiment, experiment.scenes_of_role("test")[0])

    def moved(own: Kinematics) -> Run:
        more = {"mechanics": own.mechanics, "internal": own.internal}
        return played(motion_simulator(experiment, Simulator, own.body, **more), count)

    if {"motion", "jacobians"} & set(options.tables):
        full = played(motion_simulator(experiment, FullSpaceSimulator, body), count)
        runs = {"full": full, "bare": moved(models["bare"])}
    if "motion" in options.tables:
        others = {name: moved(own) for name, own in models.items() if name != "bare"}
        print("\n" + "\n".join(motions(runs | others)), flush=True)
    if "jacobians" in options.tables:
        for name in internal_models(context.out_dir):
            model = load_internal(internal_path(context.out_dir, name), body).model
            if isinstance(model, ModesModel):
                continue
            for jacobian in JACOBIANS:
                own = models[name]._replace(internal=InternalCorrection(model, body, jacobian))
                runs[f"{name}, {jacobian}"] = moved(own)
        print("\n" + "\n".join(motions(runs)))


if __name__ == "__main__":
    run_script(main)
