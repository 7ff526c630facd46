"""Force against depth, pressed until the body gives up: a punch, a ball, two cones, a plate and a bead.

    python -m benchmarks.press_depth examples/jelly3d_small.toml [--out RUN] [--shapes ball ...] [--place X Y]
                                     [--models bare mechanics ours] [--places 7 --processes 2] [--set KEY=VALUE]
    python -m benchmarks.press_depth examples/jelly3d_small.toml --models --set 'body.mesh="FINER.vtu"'

Each shape is led straight down into the top, near the middle of a jelly or at a place, slowly, in full space, with the
bare subspace, with linear mechanics, and with corrections of the run for any collider. Printed is the force on it at
some depths below the highest point of the undeformed body, for reduced models relative to full space, with the status
of the step where it is not CONVERGED. What is as fine as the mesh meets another force where it is between other nodes:
with several --places, within a distance between surface nodes, the mean force of all is compared, and how much that of
full space differs (standard deviation) is printed beside it. Inverted: the share of the elastic energy of full space
in cells that are inside out, where some are; there full space is no reference. Needs `softprint mechanics` or
`softprint train`; without a model full space alone is pressed, with the body of the experiment.
"""

from __future__ import annotations

import argparse
import logging
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from softprint.fem_truth.dynamics.full_space_simulator import FullSpaceSimulator
from softprint.runtime.arrays import Array
from softprint.runtime.body import load_body
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders import Box, Collider, Cone, Cylinder, KeyframedPath, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics import DynamicsSettings, KinematicHandle, PlacedCollider, Simulator
from softprint.runtime.experiment import Experiment, load_experiment
from softprint.runtime.learned.correction import Correction, mechanics_of
from softprint.runtime.learned.correction_file import load_correction
from softprint.runtime.mechanics.mechanics_file import load_mechanics, mechanics_path
from softprint.runtime.scenes.experiment_body import body_of_experiment

CONTACT_NODES = 3000
SPEED = 0.02  # m/s
CLEAR = 0.001  # m, above the body at first
PRINTED = 2.5e-3  # m, between two lines
MODELS = ("bare", "mechanics")

SHAPES: Mapping[str, Callable[[], Collider]] = {
    "punch": lambda: Cylinder(0.01, 0.03, 0.002, "punch"),
    "ball": lambda: Sphere(0.02, 3, "ball"),
    "cone": lambda: Cone([0.0, 0.0, 0.02], [0.0, 0.0, -0.02], 0.015, 0.002, "cone"),
    "blunt_cone": lambda: Cone([0.0, 0.0, 0.02], [0.0, 0.0, -0.02], 0.015, 0.004, "blunt_cone"),
    "plate": lambda: Box([0.002, 0.015, 0.03], 0.001, "plate"),
    "bead": lambda: Sphere(0.006, 3, "bead"),
}


class Presses:
    """Presses into the body of a run, down to a depth [m]."""

    def __init__(self, experiment: Experiment, run: Path | None, deepest: float) -> None:
        """run: None for full space alone."""
        self.experiment, self.deepest, self.run = experiment, deepest, run
        self.body = body_of_experiment(experiment) if run is None else load_body(run / "body.h5")
        self.mechanics = (
            None if run is None else load_mechanics(mechanics_path(run, CONTACT_NODES), self.body)
        )
        self.top = float(self.body.mesh.points[:, 2].max())

    def press(self, shape: Collider, place: Array, model: str) -> Pressed:
        """All steps, at a place (x, y) [m], to the first that does not converge in full space."""
        high, way = self.top - float(shape.lower[2]), self.deepest + CLEAR
        places = [[*place, high + CLEAR], [*place, high - self.deepest]]
        simulator = self._simulator(shape, KeyframedPath([0.0, way / SPEED], places), model)
        state = simulator.rest_state()
        depths, forces, statuses, inverted = [], [], [], []
        for _ in range(int(way / SPEED / self.experiment.dynamics.time_step)):
            result = simulator.step(state)
            state = result.state
            depths.append(high - float(state.poses[shape.name].translation[2]))
            forces.append(float(result.contacts[shape.name].force[2]))
            statuses.append(result.status.name)
            if model != "full":
                continue
            inverted.append(self._inverted(simulator.deformation_gradients(state)))
            if not result.converged:
                break
        return Pressed(np.array(depths), np.array(forces), statuses, np.array(inverted))

    def _inverted(self, F: Array) -> float:
        """The share of the elastic energy in cells with det F < 0."""
        energy = self.body.material.energy_density(F) * self.body.mesh.cell_volumes
        return float(energy[np.linalg.det(F) < 0.0].sum() / energy.sum())

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
        mechanics = None if model == "bare" else self.mechanics
        if model not in MODELS:
            assert self.run is not None  # there are models
            assert self.mechanics is not None
            file = self.run / "corrections" / f"{model}.safetensors"
            correction = load_correction(file, self.body, shape, self.mechanics)
            mechanics = mechanics_of([correction], mechanics)
        placed = [PlacedCollider(shape.name, shape, path, correction)]
        return Simulator(self.body, placed, mechanics=mechanics, **common)


class Pressed(NamedTuple):
    """The steps of a press: depths [m], forces [N], statuses and, of full space, shares of the energy in inverted
    cells."""

    depths: Array
    forces: Array
    statuses: Sequence[str]
    inverted: Array

    def inverted_at(self, depth: float) -> float:
        """The share at a depth [m]."""
        return float(np.interp(depth, self.depths, self.inverted))

    def at(self, depth: float) -> tuple[float, str]:
        """The force at a depth [m], between those of the steps beside it, and the status of the nearest step."""
        nearest = int(np.argmin(np.abs(self.depths - depth)))
        return float(np.interp(depth, self.depths, self.forces)), self.statuses[nearest]


def around(place: Sequence[float], count: int, within: float) -> list[Array]:
    """So many places (2,) [m], evenly over a disc of a radius [m] about the first, which is its middle."""
    golden = np.pi * (3.0 - np.sqrt(5.0))
    radius = within * np.sqrt(np.arange(count) / max(count - 1, 1))
    turn = golden * np.arange(count)
    return list(np.asarray(place) + radius[:, None] * np.column_stack([np.cos(turn), np.sin(turn)]))


def lines(
    name: str, models: Sequence[str], found: Mapping[str, Sequence[Pressed]], every: float
) -> Sequence[str]:
    """The lines of one shape, at depths that far apart [m]. found: by model, at all places."""
    result = []
    for depth in np.arange(every, max(own.depths[-1] for own in found["full"]) + 1e-9, every):
        there = [n for n, own in enumerate(found["full"]) if own.depths[-1] >= depth - 1e-9]
        full = [found["full"][n].at(depth) for n in there]
        forces = np.array([force for force, _ in full])
        if not forces.all():  # beside the highest point it touches later
            continue
        cells = [name, f"{1e3 * depth:.1f}", f"{forces.mean():.2f}{_statuses(full)}"]
        if len(found["full"]) > 1:
            cells.append(f"{forces.std() / forces.mean():.0%} of {len(there)}")
        inverted = np.mean([found["full"][n].inverted_at(depth) for n in there])
        cells.append(f"{inverted:.0%}" if inverted else "")
        for model in models:
            own = [found[model][n].at(depth) for n in there]
            ratio = np.mean([force for force, _ in own]) / forces.mean()
            cells.append(f"{ratio - 1.0:+.0%}{_statuses(own)}")
        result.append("| " + " | ".join(cells) + " |")
    return result


def _statuses(steps: Sequence[tuple[float, str]]) -> str:
    """Those that are not CONVERGED, and of how many places."""
    others = Counter(status for _, status in steps if status != "CONVERGED")
    of = f" at {{}} of {len(steps)}" if len(steps) > 1 else ""
    return "".join(f" {status}{of.format(n)}" for status, n in others.items())


def _quiet() -> None:
    logging.getLogger("softprint").setLevel(logging.ERROR)  # the table has every status


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
    parser.add_argument("--places", type=int, default=1, help="about that place")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--models", nargs="*", default=MODELS, metavar="NAME")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="of the experiment")
    options = parser.parse_args(words)
    _quiet()
    run = (options.out or Path("runs") / options.experiment.stem) if options.models else None
    experiment = load_experiment(options.experiment, options.set)
    presses = Presses(experiment, run, options.deepest)
    places = around(options.place, options.places, presses.body.mesh.surface_spacing)
    heads = [
        "shape",
        "depth, mm",
        "full space, N",
        *["differs"] * (len(places) > 1),
        "inverted",
        *options.models,
    ]
    print("| " + " | ".join(heads) + " |")
    print("| --- " * len(heads) + "|", flush=True)
    models = ("full", *options.models)
    with ProcessPoolExecutor(options.processes, initializer=_quiet) as pool:
        for name in options.shapes:
            began = {
                model: [pool.submit(presses.press, SHAPES[name](), place, model) for place in places]
                for model in models
            }
            found = {model: [one.result() for one in own] for model, own in began.items()}
            print("\n".join(lines(name, options.models, found, options.printed)), flush=True)


if __name__ == "__main__":
    run_script(main)
