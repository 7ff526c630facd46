"""Elastic forces on the handles and displacements of internal corrections, in states that no model has seen.

    softprint generate examples/hand_alone_small.toml
    softprint train examples/hand_alone_small.toml
    python -m reproduction.internal_forces examples/hand_alone_small.toml [--out RUN] [--states 16] [--all-cells]

States are taken at equal intervals from the test scene, played with static condensation, and full space is solved in
each, held at that state. With --all-cells, models are integrated over all cells, without a cubature. In Markdown, for
the bare subspace, condensation and every internal correction of the run directory:

    displacement    sqrt(sum |x - x_full|^2 / sum |U q - x_full|^2) over states and nodes, by volume
    forces          sqrt(sum |h - h_full|^2 / sum |h_full|^2): h is the derivative of elastic energy and of the weight
                    of the correction by the coordinates of the handles, each in its unit (`dof_scale`); beside it the
                    median and 95th percentile over states of |h - h_full| / |h_full|
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from reproduction.metamaterials import Kinematics
from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.statics.constrained import ConstrainedProblem
from softprint.runtime.arrays import Array
from softprint.runtime.body import ReducedBody
from softprint.runtime.body.cubature import Cubature, dof_scale, elastic_cells
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics.corrected_points import CorrectedPoints
from softprint.runtime.dynamics.terms.condensed_elastic import CondensedElasticEnergy
from softprint.runtime.dynamics.terms.elastic import ElasticEnergy
from softprint.runtime.dynamics.terms.weight import Weight
from softprint.runtime.dynamics.timings import Timings
from softprint.runtime.elasticity.elastic_energy import elastic_gradient
from softprint.runtime.experiment.experiment import CONDENSED
from softprint.runtime.learned.internal.file import load_internal, with_cubature
from softprint.runtime.learned.internal_correction import internal_correction
from softprint.runtime.scenes.corrected_body import CorrectedBody, body_below, internal_path
from softprint.runtime.scenes.playing import internal_models, simulate


def handle_force(own: CorrectedBody, rows: Array, gravity: Array) -> Array:
    """dE/drows (n_rows, dim) [N] of elastic energy and of the weight of what is added to U rows."""
    body, condensation = own.body, None if own.mechanics is None else own.mechanics.condensation
    points = CorrectedPoints(body, [], internal=own.internal, surface=False)
    term = (
        ElasticEnergy(body, points)
        if condensation is None
        else CondensedElasticEnergy(body, points, condensation)
    )
    field = points.linearise(rows, {}, Timings().correction)
    found = term.in_frame(rows).evaluate(rows, points.scatter(field)).linearise(field)[0]
    linear = Weight(body, gravity, None).form(rows)[0]
    found = found + linear - Weight(body, gravity, condensation).form(rows)[0]
    if own.internal is not None and gravity.any():
        found = found + own.internal.weight(body.node_mass, gravity).at(rows).gradient
    return found


def exact(body: ReducedBody, states: Array, gravity: Array) -> Array:
    """Positions (s, n_nodes, dim) [m] of full space at handle rows (s, n_rows, dim)."""
    problem = ConstrainedProblem(FullSpaceElasticity(body), gravity, PenaltyContact(1e9), body)
    found = []
    for rows in states:
        solved = problem.internal_equilibrium(rows)
        if not solved.converged:
            raise SystemExit(f"full space: {solved.status.name}")
        found.append(solved.x)
    return np.array(found)


def _on_all_cells(own: CorrectedBody, out: Path, name: str, gravity: Array) -> CorrectedBody:
    """The same model without a cubature."""
    cells = elastic_cells(own.body.mesh, own.body.handles)
    body = with_cubature(own.body, Cubature(cells, own.body.mesh.cell_volumes[cells], 0.0, 0.0))
    if own.internal is None:
        return own._replace(body=body)
    trained = load_internal(internal_path(out, name), body)._replace(cubature=None)
    return own._replace(body=body, internal=internal_correction(trained, body, gravity))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="run directory (default: runs/NAME)")
    parser.add_argument("--states", type=int, default=16, help="of the test scene (default: %(default)s)")
    parser.add_argument("--all-cells", action="store_true", help="without a cubature")
    options = parser.parse_args()
    context = Context(experiment_path=options.experiment, out=options.out, quiet=True)
    experiment, body, out = context.experiment, body_of_run(context), context.out_dir
    gravity, scene = np.array(experiment.dynamics.gravity), experiment.scenes_of_role("test")[0]
    frames = [frame.state.rows for frame in simulate(experiment, body, scene.name, out, CONDENSED)]
    states = np.array(frames)[np.linspace(0, len(frames) - 1, options.states + 1).round().astype(int)[1:]]
    full = exact(body, states, gravity)
    coordinates = [body.handles.tangent(rows) * dof_scale(body.mesh, body.handles) for rows in states]

    def along(forces: list[Array]) -> Array:
        return np.array([T.T @ force.ravel() for T, force in zip(coordinates, forces, strict=True)])

    true = along([body.basis.T @ elastic_gradient(body.mesh, body.material, x) for x in full])
    volumes = body.mesh.node_volumes[:, None]
    bare = np.array([body.reduced_positions(rows) for rows in states])
    print("| model | displacement | forces | median | 95 % |")
    print("| --- | --- | --- | --- | --- |")
    names = (CONDENSED, *internal_models(out))
    models = {"bare": CorrectedBody(body)} | {name: body_below(body, out, name, gravity) for name in names}
    if options.all_cells:
        models = {name: _on_all_cells(own, out, name, gravity) for name, own in models.items()}
    for name, own in models.items():
        kinematics = Kinematics(*own)
        x = np.array([kinematics.positions(rows) for rows in states])
        missed = np.linalg.norm((x - full) * np.sqrt(volumes)) / np.linalg.norm(
            (bare - full) * np.sqrt(volumes)
        )
        h = along([handle_force(own, rows, gravity) for rows in states])
        each = np.linalg.norm(h - true, axis=1) / np.linalg.norm(true, axis=1)
        rms = np.linalg.norm(h - true) / np.linalg.norm(true)
        print(
            f"| {name} | {missed:.1%} | {rms:.1%} | {np.median(each):.1%} | {np.quantile(each, 0.95):.1%} |",
            flush=True,
        )


if __name__ == "__main__":
    run_script(main)
