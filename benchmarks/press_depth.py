"""Force against depth, pressed until the body gives up: a punch, a ball, a cone, a plate and a bead.

    python -m benchmarks.press_depth examples/jelly3d_small.toml [--out RUN] [--shapes ball ...] [--place X Y]
                                     [--models bare mechanics ours] [--set KEY=VALUE]

Each shape is led straight down into the top, near the middle of a jelly or at a place, slowly, in full space, with the
bare subspace, with linear mechanics, and with corrections of the run for any collider. Printed is the force on it at
some depths below the highest point of the undeformed body, for reduced models relative to full space, with the status
of the step where it is not CONVERGED. Needs `softprint mechanics` or `softprint train`.
"""

from __future__ import annotations

import argparse
import logging
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from softprint.fem_truth.dynamics.full_space_simulator import FullSpaceSimulator
from softprint.runtime.body import load_body
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders import Box, Collider, Cone, Cylinder, KeyframedPath, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics import DynamicsSettings, KinematicHandle, PlacedCollider, Simulator
from softprint.runtime.experiment import Experiment, load_experiment
from softprint.runtime.learned.correction import Correction
from softprint.runtime.learned.correction_file import load_correction
from softprint.runtime.mechanics.mechanics_file import load_mechanics, mechanics_path

CONTACT_NODES = 3000
SPEED = 0.02  # m/s
CLEAR = 0.001  # m, above the body at first
PRINTED = 2.5e-3  # m, between two lines
MODELS = ("bare", "mechanics")

SHAPES: Mapping[str, Callable[[], Collider]] = {
    "punch": lambda: Cylinder(0.01, 0.03, 0.002, "punch"),
    "ball": lambda: Sphere(0.02, 3, "ball"),
    "cone": lambda: Cone([0.0, 0.0, 0.02], [0.0, 0.0, -0.02], 0.015, 0.002, "cone"),
    "plate": lambda: Box([0.002, 0.015, 0.03], 0.001, "plate"),
    "bead": lambda: Sphere(0.006, 3, "bead"),
}


class Presses:
    """Presses into the body of a run, at a place (x, y) [m]."""

    def __init__(
        self,
        experiment: Experiment,
        run: Path,
        deepest: float,
        place: Sequence[float],
        models: Sequence[str],
    ) -> None:
        self.experiment, self.deepest, self.place, self.models = experiment, deepest, place, models
        self.run = run
        self.body = load_body(run / "body.h5")
        self.mechanics = load_mechanics(mechanics_path(run, CONTACT_NODES), self.body)
        self.top = float(self.body.mesh.points[:, 2].max())

    def press(self, shape: Collider, model: str) -> tuple[list[float], list[float], list[str]]:
        """Depths [m], forces [N] and statuses of all steps, to the first that does not converge in full space."""
        high, way = self.top - float(shape.lower[2]), self.deepest + CLEAR
        places = [[*self.place, high + CLEAR], [*self.place, high - self.deepest]]
        simulator = self._simulator(shape, KeyframedPath([0.0, way / SPEED], places), model)
        state = simulator.rest_state()
        depths, forces, statuses = [], [], []
        for _ in range(int(way / SPEED / self.experiment.dynamics.time_step)):
            result = simulator.step(state)
            state = result.state
            depths.append(high - float(state.poses[shape.name].translation[2]))
            forces.append(float(result.contacts[shape.name].force[2]))
            statuses.append(result.status.name)
            if model == "full" and not result.converged:
                break
        return depths, forces, statuses

    def _simulator(self, shape: Collider, path: KeyframedPath, model: str) -> Any:
        own = self.experiment.dynamics
        common: dict[str, Any] = {
            "contact": PenaltyContact.of(self.experiment.contact),
            "gravity": own.gravity,
            "kinematic": [KinematicHandle(frame.name) for frame in self.body.handles.frames],
            "settings": DynamicsSettings(own.time_step),
        }
        if model == "full":
            return FullSpaceSimulator(self.body, [PlacedCollider(shape.name, shape, path)], **common)
        correction: Correction | None = None
        if model not in MODELS:
            file = self.run / "corrections" / f"{model}.safetensors"
            correction = load_correction(file, self.body, shape, self.mechanics)
        mechanics = None if model == "bare" else self.mechanics
        placed = [PlacedCollider(shape.name, shape, path, correction)]
        return Simulator(self.body, placed, mechanics=mechanics, **common)

    def table(self, name: str, every: float) -> Sequence[str]:
        """Lines for one shape, at depths that far apart [m]."""
        shape = SHAPES[name]()
        found = {model: self.press(shape, model) for model in ("full", *self.models)}
        depths, forces, statuses = found["full"]
        lines = []
        for depth in np.arange(every, depths[-1] + 1e-9, every):
            at = int(np.argmin(np.abs(np.array(depths) - depth)))
            if not forces[at]:  # beside the highest point it touches later
                continue
            cells = [name, f"{1e3 * depths[at]:.1f}", f"{forces[at]:.2f}{_status(statuses[at])}"]
            for model in self.models:
                _, own, said = found[model]
                cells.append(f"{own[at] / forces[at] - 1.0:+.0%}{_status(said[at])}")
            lines.append("| " + " | ".join(cells) + " |")
        return lines


def _status(name: str) -> str:
    return "" if name == "CONVERGED" else f" {name}"


def main(words: Sequence[str] | None = None) -> None:
    """Prints a table in Markdown."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="the run directory; default: runs/NAME")
    parser.add_argument("--shapes", nargs="+", default=list(SHAPES), choices=list(SHAPES), metavar="NAME")
    parser.add_argument("--deepest", type=float, default=0.03, help="m, below the undeformed top")
    parser.add_argument("--printed", type=float, default=PRINTED, help="m, between two lines")
    parser.add_argument("--place", nargs=2, type=float, default=(0.002, 0.003), metavar=("X", "Y"), help="m")
    parser.add_argument("--models", nargs="+", default=MODELS, metavar="NAME")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="of the experiment")
    options = parser.parse_args(words)
    logging.getLogger("softprint").setLevel(logging.ERROR)  # the table has every status
    run = options.out or Path("runs") / options.experiment.stem
    experiment = load_experiment(options.experiment, options.set)
    presses = Presses(experiment, run, options.deepest, options.place, options.models)
    print(f"| shape | depth, mm | full space, N | {' | '.join(options.models)} |")
    print("| --- " * (3 + len(options.models)) + "|", flush=True)
    for name in options.shapes:
        print("\n".join(presses.table(name, options.printed)), flush=True)


if __name__ == "__main__":
    run_script(main)
