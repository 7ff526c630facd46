"""Contact at nodes and on facets, in reference solutions: how deep the collider gets into the body, and what it costs.

    python -m benchmarks.contact_points examples/finger.toml [--out RUN] [--contacts 25] [--refinements 0 2 4]
                                        [--stiffness 1 10 100]

Solves some contacts of a truth file again: at their states and poses, shallow to deep, for every refinement (0: contact
at nodes; n: at n points along an edge of a facet) and every multiple of the contact stiffness. Penetration is what the
contact law sees; intrusion is the depth of the collider's surface inside the deformed body, found without the contact
law (`runtime/contact/intrusion.py`). A contact that is not solved at a depth is left there, and counts as failed once.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.statics.constrained import ConstrainedProblem, Solution
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body import ReducedBody, load_body
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders.build import build_collider
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.surface_points import surface_points
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.intrusion import intrusion
from softprint.runtime.experiment import Experiment
from softprint.runtime.truth.truth_file import TruthData, load_truth


@dataclass
class Tally:
    """The solved samples of one law."""

    solutions: list[Solution] = field(default_factory=list)
    intrusions: list[float] = field(default_factory=list)
    failed: int = 0

    def line(self) -> str:
        """The columns of the table."""
        n = len(self.solutions)
        depth = 1e3 * np.array([solution.max_depth for solution in self.solutions])
        inside = 1e3 * np.array(self.intrusions)
        mean = [
            np.mean([getattr(solution, name) for solution in self.solutions])
            for name in ("newton_iterations", "cg_iterations", "seconds")
        ]
        return (
            f"{n:8d} {self.failed:7d} {mean[0]:7.1f} {mean[1]:6.0f} {mean[2]:9.3f} {np.median(depth):9.3f} "
            f"{depth.max():6.2f} {np.median(inside):10.3f} {np.quantile(inside, 0.95):6.2f} {inside.max():6.2f}"
        )


HEADER = "points  stiffness   solved  failed  Newton     CG  core-sec.   penetr.    max  intrusion    95%    max   (mm)"


class Presses:
    """Contacts of a truth file, to be solved again."""

    def __init__(
        self, experiment: Experiment, body: ReducedBody, truth: TruthData, contacts: IntArray
    ) -> None:
        self.experiment, self.body, self.truth, self.contacts = experiment, body, truth, contacts
        self._elasticity = FullSpaceElasticity(body)
        self._colliders: dict[str, tuple[Collider, Array]] = {}
        self._contact_of = truth.samples["contact"]

    def solve(self, law: PenaltyContact) -> Tally:
        """All contacts with one law."""
        gravity = np.array(self.experiment.dynamics.gravity)
        problem, tally = ConstrainedProblem(self._elasticity, gravity, law, self.body), Tally()
        for contact in self.contacts:
            self._solve(int(contact), problem, tally)
        return tally

    def _solve(self, contact: int, problem: ConstrainedProblem, tally: Tally) -> None:
        truth, mesh = self.truth, self.body.mesh
        collider, surface = self._collider(truth.header.colliders[int(truth.contacts["collider"][contact])])
        state = int(truth.contacts["state"][contact])
        rows = truth.states["rows"][state]
        internal = self.body.reduced_positions(rows) + truth.internal(state)
        press = problem.press(rows, collider, internal)
        for sample in np.flatnonzero(self._contact_of == contact):
            pose = truth.pose(int(sample))
            solution = press.solve(pose)
            if not solution.converged:
                tally.failed += 1
                return
            tally.solutions.append(solution)
            tally.intrusions.append(intrusion(pose.apply(surface), mesh, solution.x).depth)

    def _collider(self, name: str) -> tuple[Collider, Array]:
        if name not in self._colliders:
            collider = build_collider(self.experiment.collider(name), self.experiment.base_dir)
            self._colliders[name] = collider, surface_points(collider)
        return self._colliders[name]


def main(words: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="run directory with body and truth (default: runs/NAME)")
    parser.add_argument("--contacts", type=int, default=25, help="how many, drawn at random (default: 25)")
    parser.add_argument("--refinements", type=int, nargs="+", default=[0, 2, 4], metavar="N")
    parser.add_argument("--stiffness", type=float, nargs="+", default=[1.0, 10.0, 100.0], metavar="FACTOR")
    options = parser.parse_args(words)
    context = Context(experiment_path=options.experiment, overrides=(), out=options.out, quiet=True)
    experiment, out = context.experiment, context.out_dir
    body = load_body(out / "body.h5")
    with load_truth(out / "truth.h5", body) as truth:
        count = len(truth.contacts)
        drawn = np.random.default_rng(0).choice(count, min(options.contacts, count), replace=False)
        presses = Presses(experiment, body, truth, drawn)
        spacing = 1e3 * np.sqrt(body.mesh.surface_areas.mean())
        print(
            f"{body.name}: {body.mesh.n_cells} cells, {len(drawn)} contacts, stiffness "
            f"{experiment.contact.stiffness:g} N/m^4, surface nodes {spacing:.2f} mm apart"
        )
        print(HEADER)
        for refinement in options.refinements:
            for factor in options.stiffness:
                law = PenaltyContact(factor * experiment.contact.stiffness, refinement)
                print(f"{refinement or 'nodes':>6} {factor:10g} {presses.solve(law).line()}", flush=True)


if __name__ == "__main__":
    run_script(main)
