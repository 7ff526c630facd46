"""Evaluating a descriptor model at run time: how near to the direct way, how steady, how fast? (thesis 6.3, and figures
6.5 and 6.7)

    python -m benchmarks.descriptor_ways EXPERIMENT [--out RUN] [--model thesis6] [--colliders NAME ...]

Needs the truth file and the trained model of the run. For each collider, validation shapes by default, it takes up
contacts of the truth at their deepest and moves the collider on slowly, 20 um and 0.1 degrees a step, for 50 steps of
each of two contacts, the body's state kept. Of the displacement u of all surface samples it prints, for each way,

    off      sqrt(<|u - u_direct|^2> / <|u_direct|^2>)
    flicker  sqrt(<|u_(t+1) - 2 u_t + u_(t-1)|^2> / <|u_direct,(t+1) - u_direct,t|^2>): second differences in time,
             relative to the motion from step to step of the direct way
    CPU time of an evaluation and of the precomputation, and the active points.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import cast

import numpy as np

from benchmarks.descriptor_rivals import (
    CornerDeformations,
    CornerDescriptors,
    GridOfDescriptors,
    OneBias,
    RandomTangents,
)
from runtime.arrays import Array
from runtime.body.body import ReducedBody
from runtime.cli.context import Context
from runtime.cli.run_body import body_of_run
from runtime.colliders.build import build_collider
from runtime.colliders.collider import Collider
from runtime.colliders.pose import RigidPose
from runtime.corrections.correction_file import load_correction
from runtime.corrections.descriptor_contact import BoundDescriptorContact, DescriptorContact
from runtime.corrections.descriptor_model import DescriptorModel
from runtime.descriptors import DirectGeometry, GridGeometry
from runtime.dynamics.model import correction_path
from runtime.errors import SoftprintError
from runtime.experiment.experiment import ANY_COLLIDER
from runtime.shapes import validation_names
from runtime.truth_file import TruthData, load_truth

STEPS, CONTACTS = 50, 2
SHIFT, TURN = 2e-5, np.deg2rad(0.1)
CORNER_CELLS = 50  # of the thesis, for small colliders

Prepared = Callable[[], BoundDescriptorContact]


def paths(truth: TruthData, collider: str, rng: np.random.Generator) -> list[tuple[Array, list[RigidPose]]]:
    """Handle rows and the poses of the collider along each of its paths."""
    number = truth.header.colliders.index(collider)
    own = truth.usable & (truth.contacts["collider"][truth.samples["contact"]] == number)
    deepest = np.flatnonzero(own & (truth.samples["depth_index"] == truth.samples["depth_index"][own].max()))
    found = []
    for sample in deepest[:CONTACTS]:
        rows, start = truth.states["rows"][truth.sample_state[sample]], truth.pose(int(sample))
        pressed = truth.contacts["direction"][truth.samples["contact"][sample]]
        along, axis = rng.standard_normal((2, len(pressed)))
        along -= (along @ pressed) * pressed
        along *= SHIFT / np.linalg.norm(along)
        axis *= TURN / np.linalg.norm(axis)
        poses = [
            RigidPose(
                RigidPose.from_rotation_vector(step * axis, np.zeros(3)).rotation @ start.rotation,
                start.translation + step * along,
            )
            for step in range(STEPS)
        ]
        found.append((rows, poses))
    return found


def ways(model: DescriptorModel, body: ReducedBody, collider: Collider) -> dict[str, Prepared]:
    """How to prepare each way."""
    points, options = body.node_points(body.surface.nodes), model.options

    def direct() -> DescriptorContact:
        geometry = DirectGeometry(collider, options.radius, options.sets)
        return DescriptorContact("direct", model, body, collider, geometry)

    def fields(cells: int) -> BoundDescriptorContact:
        geometry = GridGeometry(collider, options.radius, options.sets, cells // 2, cells)
        return DescriptorContact("fields", model, body, collider, geometry).bind(points)

    def grid() -> GridOfDescriptors:
        return GridOfDescriptors(direct(), collider, CORNER_CELLS)

    return {
        "direct": lambda: direct().bind(points),
        "direct, one bias (thesis)": lambda: OneBias(direct(), points, np.inf),
        "direct, random tangents": lambda: RandomTangents(direct(), points, np.random.default_rng(1)),
        "corner deformations (thesis)": lambda: CornerDeformations(direct(), points, grid()),
        "interpolated descriptors": lambda: CornerDescriptors(direct(), points, grid()),
        "fields on grids (ships)": lambda: DescriptorContact("fields", model, body, collider).bind(points),
        "fields, 48 and 96 cells": lambda: fields(96),
        "fields, 72 and 144 cells": lambda: fields(144),
    }


class Tally:
    """Sums over all paths of one way."""

    def __init__(self) -> None:
        self.off = self.size = self.flicker = self.motion = self.seconds = self.prepared = 0.0
        self.evaluations = self.active = 0

    def add(self, u: Array, direct: Array, seconds: float) -> None:
        """u, direct: (steps, n, dim); seconds: of all steps."""
        self.off += float(np.square(u - direct).sum())
        self.size += float(np.square(direct).sum())
        self.flicker += float(np.square(u[2:] - 2 * u[1:-1] + u[:-2]).mean())
        self.motion += float(np.square(direct[1:] - direct[:-1]).mean())
        self.seconds += seconds
        self.evaluations += len(u)
        self.active += int((direct[0] != 0).any(axis=1).sum())

    def __str__(self) -> str:
        return (
            f"{np.sqrt(self.off / self.size):.2%} | {np.sqrt(self.flicker / self.motion):.3f} | "
            f"{1e3 * self.seconds / self.evaluations:.1f} | {self.prepared:.1f}"
        )


def measure(
    model: DescriptorModel, body: ReducedBody, truth: TruthData, colliders: Sequence[tuple[str, Collider]]
) -> dict[str, Tally]:
    """Every way on every collider."""
    tallies: dict[str, Tally] = {}
    for name, collider in colliders:
        rng = np.random.default_rng(0)
        courses = paths(truth, name, rng)
        direct: list[Array] = []
        for way, prepare in ways(model, body, collider).items():
            tally = tallies.setdefault(way, Tally())
            started = time.process_time()
            bound = prepare()
            tally.prepared += (time.process_time() - started) / len(colliders)
            for course, (rows, poses) in enumerate(courses):
                bound.displacement(rows, poses[0])  # compiled, in the cache
                started = time.process_time()
                u = np.stack([bound.displacement(rows, pose) for pose in poses])
                seconds = time.process_time() - started
                if way == "direct":
                    direct.append(u)
                tally.add(u, direct[course], seconds)
    return tallies


def main() -> None:
    """Load, measure, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="run directory (default: runs/NAME)")
    parser.add_argument("--model", default="thesis6")
    parser.add_argument("--colliders", nargs="+", default=validation_names())
    options = parser.parse_args()
    context = Context(experiment_path=options.experiment, overrides=(), out=options.out, quiet=True)
    experiment, body = context.experiment, body_of_run(context)
    with load_truth(context.out_dir / "truth.h5", body) as truth:
        known = [name for name in options.colliders if _has_samples(truth, name)]
        colliders = [(name, build_collider(experiment.collider(name), experiment.base_dir)) for name in known]
        if not colliders:
            raise SoftprintError(f"{truth.path}: has no usable samples of {', '.join(options.colliders)}")
        loaded = load_correction(correction_path(context.out_dir, options.model), body, colliders[0][1])
        if not isinstance(loaded, DescriptorContact):
            raise SoftprintError(f"{options.model} is not a descriptor model ({ANY_COLLIDER} collider)")
        tallies = measure(cast(DescriptorModel, loaded.model), body, truth, colliders)
    first = next(iter(tallies.values()))
    print(f"{', '.join(known)}; {first.active * STEPS / first.evaluations:.0f} active points on average\n")
    print("| way | off | flicker | ms | precomputed, s |\n| --- | --- | --- | --- | --- |")
    for way, tally in tallies.items():
        print(f"| {way} | {tally} |")


def _has_samples(truth: TruthData, name: str) -> bool:
    if name not in truth.header.colliders:
        return False
    number = truth.header.colliders.index(name)
    return bool((truth.usable & (truth.contacts["collider"][truth.samples["contact"]] == number)).any())


if __name__ == "__main__":
    main()
