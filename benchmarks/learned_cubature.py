"""Cubature of a corrected body: weights from the gradients of the basis, and from training states, at equal counts.

    softprint train examples/accordion_small.toml
    python -m benchmarks.learned_cubature examples/accordion_small.toml

Errors of forces (RMS over states, in units of the handles) and of energy (mean) against all cells, in held-out states
of the corrected body.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from softprint.runtime.body.cubature import choose_cubature
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.learned.internal.correction import InternalCorrection
from softprint.runtime.learned.internal.file import load_internal
from softprint.runtime.learned.internal.model import ModesModel
from softprint.runtime.mechanics.compliance.null_space_compliance import NullSpaceCompliance
from softprint.runtime.mechanics.static_condensation import compute_static_condensation
from softprint.runtime.scenes.corrected_body import internal_path
from softprint.runtime.truth.truth_file import load_truth
from softprint.surrogate.internal.cubature import force_system, learned_cubature
from softprint.surrogate.internal.data import read_internal_data

STATES = 100  # at most, to fit to and to measure in


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="run directory (default: runs/NAME)")
    parser.add_argument("--model", default="ours", help="the internal correction (default: %(default)s)")
    parser.add_argument("--counts", type=int, nargs="+", default=[100, 200, 400, 600, 900])
    options = parser.parse_args()
    context = Context(experiment_path=options.experiment, out=options.out, quiet=True)
    body = body_of_run(context)
    model = load_internal(internal_path(context.out_dir, options.model), body).model
    if isinstance(model, ModesModel):
        parser.error(
            f"{options.model} has modes in equilibrium: its training prints the errors of its cubature"
        )
    internal = InternalCorrection(model, body)
    gravity = context.experiment.dynamics.gravity
    condensation = (
        compute_static_condensation(body, gravity, NullSpaceCompliance(body))
        if internal.on_condensation
        else None
    )
    rng = np.random.default_rng(context.seed)
    with load_truth(context.out_dir / "truth.h5", body) as truth:
        data, rows = read_internal_data(truth, body, condensation, context.seed), truth.states["rows"]
        fitted, judge = (
            force_system(body, internal, condensation, rows[rng.permutation(of)[:STATES]])
            for of in (data.train, data.held_out)
        )
    print(f"{body.name}: {len(fitted.cells)} cells can deform; {options.model}")
    print("| cells | from the basis: forces | energy | cells | from states: forces | energy |")
    print("| --- | --- | --- | --- | --- | --- |")
    for count in options.counts:
        usual = choose_cubature(body.mesh, body.basis, body.handles, body.material, count)
        learned = learned_cubature(body, fitted, count)
        columns = []
        for cells, weights in (usual, learned):
            force, energy = judge.errors(cells, weights)
            columns.append(f"{len(cells)} | {force:.1%} | {energy:.1%}")
        print(f"| {' | '.join(columns)} |")


if __name__ == "__main__":
    run_script(main)
