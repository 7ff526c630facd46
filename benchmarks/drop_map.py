"""Balls thrown at a body: which bounce, come to rest, or are too much for it; does any pass unseen?

    python -m benchmarks.drop_map examples/jelly3d_small.toml [--plot drop_map.png]
    python -m benchmarks.drop_map examples/jelly3d_small.toml --bounces

Balls of 5 to 40 mm diameter and 1 to 1000 g hit the middle of the top with 0.1 to 20 m/s, with time steps of 1/1000,
1/120 and 1/30 s, in the reduced model alone and with linear mechanics. A run is followed for 0.25 s after the ball
meets the body. It ends as

    bounced    the ball rose above where it started to touch
    stayed     it did not, and is not below the top by more than its diameter: at rest, or still in its dent
    PIERCED    a step said so, before anything else
    beside     it rolled or was thrown off the top
    passed     it went through, and no step said so

With --bounces, a few of the throws, in full space too, in steps of 1/120 s: the height above where it began to touch to
which the ball rises from the speed with which it leaves the body, the deepest point of its way, the steps that said
PIERCED, and the mean processor time of a step.

Needs `softprint body EXPERIMENT`; mechanics are computed where `softprint train` has not left them.
"""

from __future__ import annotations

import argparse
import logging
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from tqdm import tqdm

from softprint.fem_truth.dynamics.full_space_simulator import FullSpaceSimulator
from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.runtime.body import ReducedBody, load_body
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders import RigidPose, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics import (
    DynamicsSettings,
    KinematicHandle,
    NewtonSettings,
    PlacedCollider,
    Simulator,
)
from softprint.runtime.experiment import Experiment, load_experiment
from softprint.runtime.mechanics.body_mechanics import BodyMechanics, compute_mechanics
from softprint.runtime.mechanics.mechanics_file import load_mechanics, mechanics_path
from softprint.runtime.rigid import free_collider

Throw = tuple[float, float, float]  # diameter [m], mass [kg], speed [m/s]

DIAMETERS = (0.005, 0.01, 0.02, 0.04)  # m
MASSES = (0.001, 0.01, 0.1, 1.0)  # kg
SPEEDS = (0.1, 0.5, 2.0, 5.0, 20.0)  # m/s
RATES = (1000, 120, 30)  # 1/s
FOLLOWED = 0.25  # s
BOUNCES: tuple[Throw, ...] = (
    (0.04, 0.01, 0.5),
    (0.04, 0.1, 0.5),
    (0.04, 0.1, 2.0),
    (0.04, 0.01, 5.0),
    (0.02, 0.01, 0.5),
    (0.02, 0.01, 2.0),
    (0.02, 0.1, 2.0),
    (0.01, 0.001, 5.0),
    (0.01, 0.01, 2.0),
    (0.005, 0.001, 5.0),
    (0.04, 0.1, 5.0),
    (0.02, 0.1, 5.0),
)
BOUNCE_RATE = 120
CONTACT_NODES = 3000
ENDS = {
    "bounced": "#4c9f70",
    "stayed": "#b9d9c3",
    "PIERCED": "#e3a857",
    "beside": "#cccccc",
    "passed": "#b3261e",
}


def loaded(path: Path, out: Path | None) -> tuple[Experiment, ReducedBody, BodyMechanics]:
    """An experiment, its body from the run directory, and mechanics, computed where none are stored."""
    run = out or Path("runs") / path.stem
    experiment, body = load_experiment(path), load_body(run / "body.h5")
    stored = mechanics_path(run, CONTACT_NODES)
    if stored.is_file():
        return experiment, body, load_mechanics(stored, body)
    return experiment, body, compute_mechanics(body, CONTACT_NODES, True)


def thrown(experiment: Experiment, body: ReducedBody, throw: Throw, rate: int) -> dict[str, Any]:
    """The arguments of a simulator, reduced or full, of one throw."""
    diameter, mass, speed = throw
    ball, top = Sphere(0.5 * diameter, 3, "ball"), body.mesh.points[:, 2].max()
    start = RigidPose(np.eye(3), np.array([1e-3, 2e-3, top + 0.5 * diameter + 1e-3]))
    free = free_collider(ball, start, mass=mass, velocity=[0.0, 0.0, -speed])
    return {
        "body": body,
        "colliders": [PlacedCollider("ball", ball, free=free)],
        "contact": PenaltyContact.of(experiment.contact),
        "gravity": experiment.dynamics.gravity,
        "kinematic": [KinematicHandle(frame.name) for frame in body.handles.frames],
        "settings": DynamicsSettings(1.0 / rate, NewtonSettings(max_iterations=60)),
    }


def end_of(
    experiment: Experiment, body: ReducedBody, mechanics: BodyMechanics | None, throw: Throw, rate: int
) -> str:
    """How one run ends."""
    top, reach = body.mesh.points[:, 2].max(), body.mesh.points[:, :2].max(axis=0)
    diameter, touch = throw[0], top + 0.5 * throw[0]
    simulator = Simulator(**thrown(experiment, body, throw, rate), mechanics=mechanics)
    state = simulator.rest_state()
    for _ in range(int(np.ceil(FOLLOWED * rate))):
        result = simulator.step(state)
        state = result.state
        *aside, height = state.poses["ball"].translation
        if result.piercing is not None:
            return "PIERCED"
        if height > touch + 1e-3 and state.motions["ball"].velocity[2] > 0.0:
            return "bounced"
        if (np.abs(aside) > reach).any():
            return "beside"
        if height < 0.0 and not result.contacts["ball"].points:
            return "passed"
    return "stayed" if height > touch - 2.0 * diameter - 0.5 * top else "passed"


@dataclass(frozen=True)
class Bounce:
    """height: that the ball rises to [m], None if it has not left the body again after `FOLLOWED`; deepest: how far it
    went below where it began to touch [m]; pierced, failed: steps that said PIERCED, or that did not converge for
    another reason; seconds: mean of a step in contact, NaN where no point of the body touched the ball."""

    height: float | None
    deepest: float
    pierced: int
    failed: int
    seconds: float

    @property
    def cell(self) -> str:
        """Of a table."""
        rises = "stays" if self.height is None else f"{round(1e3 * self.height)} mm"
        pierced = f", {self.pierced} PIERCED" if self.pierced else ""
        failed = f", {self.failed} failed" if self.failed else ""
        seconds = "" if np.isnan(self.seconds) else f", {1e3 * self.seconds:.0f} ms"
        return f"{rises} ({1e3 * self.deepest:.0f} mm deep{seconds}{pierced}{failed})"


def bounce_of(simulator: Simulator | FullSpaceSimulator, touch: float) -> Bounce:
    """Follows a ball, whose centre is at the height touch [m] where it begins to touch."""
    model: Any = simulator  # the state of one goes to the next step of the same
    state, deepest, pierced, failed, seconds = model.rest_state(), 0.0, 0, 0, list[float]()
    gravity = 9.81
    while state.time < FOLLOWED:
        began = time.process_time()
        result = model.step(state)
        took, state = time.process_time() - began, result.state
        height, rise = state.poses["ball"].translation[2] - touch, state.motions["ball"].velocity[2]
        deepest = max(deepest, -height)
        pierced += result.piercing is not None
        failed += result.piercing is None and not result.converged
        if result.contacts["ball"].points:
            seconds.append(took)
        elif seconds and rise > 0.0:
            energy = height + rise**2 / (2.0 * gravity)
            return Bounce(float(energy), float(deepest), pierced, failed, float(np.mean(seconds)))
    spent = float(np.mean(seconds)) if seconds else np.nan
    return Bounce(None, float(deepest), pierced, failed, spent)


def print_bounces(experiment: Experiment, body: ReducedBody, mechanics: BodyMechanics) -> None:
    """A table in Markdown of some throws in the reduced models and in full space."""
    elasticity = FullSpaceElasticity(body)
    print("| ball | full space | bare | mechanics |\n| --- | --- | --- | --- |")
    for throw in BOUNCES:
        scene = thrown(experiment, body, throw, BOUNCE_RATE)
        touch = float(body.mesh.points[:, 2].max() + 0.5 * throw[0])
        simulators = (
            FullSpaceSimulator(**scene, elasticity=elasticity),
            Simulator(**scene),
            Simulator(**scene, mechanics=mechanics),
        )
        cells = [bounce_of(simulator, touch).cell for simulator in simulators]
        ball = f"{1e3 * throw[0]:g} mm, {1e3 * throw[1]:g} g, {throw[2]:g} m/s"
        print(f"| {ball} | " + " | ".join(cells) + " |", flush=True)


def draw(ends: dict[tuple[str, int], list[str]], path: Path) -> None:
    """A map for every model and step: speeds along, diameters and masses upward."""
    models = sorted({model for model, _ in ends})
    figure = Figure(figsize=(3.2 * len(RATES), 3.4 * len(models)), layout="constrained")
    axes = np.atleast_2d(figure.subplots(len(models), len(RATES)))
    names, rows = list(ENDS), list(product(DIAMETERS, MASSES))
    for (line, model), (column, rate) in product(enumerate(models), enumerate(RATES)):
        axis = axes[line, column]
        numbers = [names.index(end) for end in ends[model, rate]]
        axis.imshow(
            np.reshape(numbers, (len(rows), len(SPEEDS))),
            cmap=ListedColormap(list(ENDS.values())),
            vmin=-0.5,
            vmax=len(names) - 0.5,
            aspect="auto",
            origin="lower",
        )
        axis.set_title(f"{model}, steps of 1/{rate} s", fontsize=9)
        axis.set_xticks(range(len(SPEEDS)), [f"{speed:g}" for speed in SPEEDS], fontsize=7)
        labels = [f"{1e3 * diameter:g} mm, {1e3 * mass:g} g" for diameter, mass in rows]
        axis.set_yticks(range(len(rows)), labels if column == 0 else [], fontsize=7)
        axis.set_xlabel("speed [m/s]", fontsize=8)
    for name, colour in ENDS.items():
        axes[0, 0].plot([], [], "s", color=colour, label=name)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=len(ENDS))
    figure.savefig(path, dpi=110)


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints a table in Markdown."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="the run directory; default: runs/NAME")
    parser.add_argument("--plot", type=Path, metavar="MAP.png")
    parser.add_argument("--bounces", action="store_true", help="a few throws, in full space too")
    options = parser.parse_args(arguments)
    logging.getLogger("softprint").setLevel(logging.ERROR)
    experiment, body, mechanics = loaded(options.experiment, options.out)
    if options.bounces:
        print_bounces(experiment, body, mechanics)
        return
    models = {"bare": None, "mechanics": mechanics}
    throws = list(product(DIAMETERS, MASSES, SPEEDS))
    ends: dict[tuple[str, int], list[str]] = {}
    with tqdm(total=len(models) * len(RATES) * len(throws), unit="throw") as progress:
        for (model, own), rate in product(models.items(), RATES):
            ends[model, rate] = []
            for throw in throws:
                ends[model, rate].append(end_of(experiment, body, own, throw, rate))
                progress.update()
    print("| model | step | " + " | ".join(ENDS) + " |\n" + "| --- " * (2 + len(ENDS)) + "|")
    for (model, rate), found in ends.items():
        counts = Counter(found)
        print(f"| {model} | 1/{rate} s | " + " | ".join(str(counts[end]) for end in ENDS) + " |")
    if options.plot is not None:
        draw(ends, options.plot)


if __name__ == "__main__":
    run_script(main)
