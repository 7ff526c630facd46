"""What does leaving out the inertia of corrections cost in a fast impact?

    python -m benchmarks.correction_inertia examples/jelly3d_small.toml [--out RUN]

Corrections follow the handles and the collider at once, without inertia of their own (thesis eq. 5.5 has it). First
the slowest motions outside of the subspace: the lowest frequencies f of the body with its handles held. A step of
backward Euler of length h brings such a motion, when its load changes, all the way but for 1 / (1 + (2 pi f h)^2),
which is what corrections without inertia leave out. Then balls thrown at the top of the body, in full space, where
everything has inertia, and with linear mechanics, its states held by the projection onto the subspace, and by the same
weighted by mass: the largest force on the ball, and how high it bounces, for steps of several lengths. All models take
the same steps, so that what differs more with shorter ones is the inertia.

Needs `softprint body EXPERIMENT`; mechanics are computed, but for those that `softprint train` has left.
"""

from __future__ import annotations

import argparse
import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse.linalg import LinearOperator, eigsh

from benchmarks.drop_map import CONTACT_NODES, FOLLOWED, Throw, loaded, thrown
from softprint.fem_truth.dynamics.full_space_simulator import FullSpaceSimulator
from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.runtime.arrays import Array
from softprint.runtime.body import ReducedBody
from softprint.runtime.cli.script import run_script
from softprint.runtime.dynamics import Simulator
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mechanics.compliance.null_space_compliance import NullSpaceCompliance

N_FREQUENCIES = 5
RATES = (60, 120, 480, 2000)  # 1/s
THROWS: tuple[Throw, ...] = ((0.04, 0.03, 0.5), (0.04, 0.03, 1.5), (0.04, 0.03, 3.0), (0.02, 0.01, 1.5))
GRAVITY = 9.81  # m/s^2
HOLDS = ("projection", "mass")


def frequencies(body: ReducedBody) -> Array:
    """The lowest frequencies [1/s] of motions outside of the subspace, ascending: those of K u = w^2 M u in its null
    space. With G = K^-1 there, 1/w^2 are the largest eigenvalues of M^(1/2) G M^(1/2)."""
    compliance, shape = NullSpaceCompliance(body), body.mesh.points.shape
    root = np.repeat(np.sqrt(body.node_mass), body.dim)

    def applied(vector: Array) -> Array:
        forces = (root * vector.ravel()).reshape(*shape, 1)
        return root * compliance.solve(forces).ravel()

    operator = LinearOperator((root.size, root.size), matvec=applied, dtype=np.float64)
    largest = eigsh(operator, k=N_FREQUENCIES, which="LA", return_eigenvectors=False)
    return np.sort(1.0 / (2.0 * np.pi * np.sqrt(largest)))


class Impact(NamedTuple):
    """peak: the largest force on the ball [N]; height: to which it rises above where it began to touch [m], NaN for a
    ball that stays; bad: steps that are pierced or not converged."""

    peak: float
    height: float
    bad: int

    @property
    def cell(self) -> str:
        """Of a table."""
        rises = "stays" if np.isnan(self.height) else f"{1e3 * self.height:.1f} mm"
        return f"{self.peak:.2f} N, {rises}" + (f" ({self.bad} bad steps)" if self.bad else "")


def impact_of(simulator: Simulator | FullSpaceSimulator, touch: float) -> Impact:
    """Follows a ball, whose centre is at the height touch [m] where it begins to touch."""
    model: Any = simulator  # the state of one goes to the next step of the same
    state, peak, bad = model.rest_state(), 0.0, 0
    while state.time < FOLLOWED:
        result = model.step(state)
        state = result.state
        height, rise = state.poses["ball"].translation[2] - touch, state.motions["ball"].velocity[2]
        contact = result.contacts["ball"]
        peak, bad = (
            max(peak, float(np.linalg.norm(contact.force))),
            bad + (result.piercing is not None or not result.converged),
        )
        if peak and not contact.points and rise > 0.0:
            return Impact(peak, float(height + rise**2 / (2.0 * GRAVITY)), bad)
    return Impact(peak, np.nan, bad)


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints two tables in Markdown."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="the run directory; default: runs/NAME")
    options = parser.parse_args(arguments)
    logging.getLogger("softprint").setLevel(logging.ERROR)
    experiment, body, mechanics = loaded(options.experiment, options.out)
    f = frequencies(body)
    print("frequencies outside of the subspace: " + ", ".join(f"{own:.0f}" for own in f) + " 1/s\n")
    print("| step | left out of a change of load by corrections without inertia |\n| --- | --- |")
    for rate in RATES:
        print(f"| 1/{rate} s | {1.0 / (1.0 + (2.0 * np.pi * f[0] / rate) ** 2):.1%} |")
    elasticity, reduced = FullSpaceElasticity(body), []
    for hold in HOLDS:
        held = replace(body, hold=hold)
        own = mechanics if hold == body.hold else compute_mechanics(held, CONTACT_NODES, True)
        reduced.append((held, own))
    heads = ["ball", "step", "full space", *(f"mechanics, {hold}" for hold in HOLDS)]
    print(f"\n| {' | '.join(heads)} |\n|{' --- |' * len(heads)}")
    for throw in THROWS:
        touch = float(body.mesh.points[:, 2].max() + 0.5 * throw[0])
        ball = f"{1e3 * throw[0]:g} mm, {1e3 * throw[1]:g} g, {throw[2]:g} m/s"
        for rate in RATES:
            scene = thrown(experiment, body, throw, rate)
            found = [impact_of(FullSpaceSimulator(**scene, elasticity=elasticity), touch)]
            for held, own in reduced:
                found.append(impact_of(Simulator(**{**scene, "body": held}, mechanics=own), touch))
            cells = [ball, f"1/{rate} s", *(impact.cell for impact in found)]
            print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    run_script(main)
