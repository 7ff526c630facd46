"""Evaluating a descriptor model at run time: how near to the direct way, how steady, at what cost? (thesis 6.3, and
figures 6.5 and 6.7)

    python -m reproduction.descriptor_ways EXPERIMENT [--out RUN] [--model thesis6] [--colliders NAME ...] [--steps 50]

Needs the truth file and the trained model of the run. For each collider, validation shapes by default, it takes up
contacts of the truth at their deepest and moves the collider on slowly, 20 um and 0.1 degrees a step, in each of two
contacts, the body's state kept. Of the displacement u of all surface samples it prints, for each way,

    off      sqrt(<|u - u_direct|^2> / <|u_direct|^2>), u_direct computed at the point itself in frames of the same
             tangents: what interpolation does
    flicker  sqrt(<|u_(t+1) - 2 u_t + u_(t-1)|^2> / <|u_direct,(t+1) - u_direct,t|^2>): second differences in time,
             relative to the motion from step to step of the direct way
    turned   the flicker at points in cells of the descriptor grid whose frames turn by more than 30 degrees from one
             corner to another
    MFLOP    of the network, for an active point
    ms       CPU time of an evaluation, and s of the precomputation.

All of it, and how one node moves in each way, goes to RUN/descriptor_ways.json, for `thesis6_figures.py`.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from reproduction.descriptor_rivals import (
    CornerDeformations,
    CornerDescriptors,
    GridOfDescriptors,
    OneBias,
    RandomTangents,
)
from softprint.runtime.arrays import Array, BoolArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders.build import build_collider
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.experiment import ANY_COLLIDER
from softprint.runtime.io.files import atomic_path
from softprint.runtime.learned.correction_file import load_correction
from softprint.runtime.learned.thesis6.correction import BoundDescriptorCorrection, DescriptorCorrection
from softprint.runtime.learned.thesis6.descriptors import DirectGeometry, GridGeometry
from softprint.runtime.learned.thesis6.model import DescriptorModel
from softprint.runtime.scenes.playing import correction_path
from softprint.runtime.shapes import validation_names
from softprint.runtime.truth.truth_file import TruthData, load_truth

CONTACTS = 2
SHIFT, TURN = 2e-5, np.deg2rad(0.1)
CORNER_CELLS = 50  # of the thesis, for small colliders
TURNED = np.deg2rad(30.0)
DIRECT, ONE_BIAS, RANDOM = (
    "direct, two biases blended",
    "direct, one bias (thesis)",
    "direct, random tangents",
)

Path3 = tuple[Array, list[RigidPose]]


def paths(truth: TruthData, collider: str, steps: int, contacts: int = CONTACTS) -> list[Path3]:
    """Handle rows and the poses of the collider along each of its paths."""
    rng = np.random.default_rng(0)
    number = truth.header.colliders.index(collider)
    own = truth.usable & (truth.contacts["collider"][truth.samples["contact"]] == number)
    deepest = np.flatnonzero(own & (truth.samples["depth_index"] == truth.samples["depth_index"][own].max()))
    found = []
    for sample in deepest[:contacts]:
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
            for step in range(steps)
        ]
        found.append((rows, poses))
    return found


@dataclass(frozen=True)
class Way:
    """prepare: what evaluates; beside: the way whose frames it has."""

    prepare: Callable[[], BoundDescriptorCorrection]
    beside: str = ONE_BIAS


def ways(
    model: DescriptorModel, body: ReducedBody, collider: Collider, grid: GridOfDescriptors
) -> dict[str, Way]:
    """All ways, those first that others are held against."""
    points, options = body.node_points(body.surface.nodes), model.options

    def fields(cells: int | None) -> BoundDescriptorCorrection:
        size = () if cells is None else (cells // 2, cells)
        geometry = GridGeometry(collider, options.radius, options.sets, *size)
        return DescriptorCorrection("fields", model, body, collider, geometry).bind(points)

    def direct() -> DescriptorCorrection:
        return direct_contact(model, body, collider)

    return {
        DIRECT: Way(lambda: direct().bind(points), DIRECT),
        ONE_BIAS: Way(lambda: OneBias(direct(), points, np.inf)),
        RANDOM: Way(lambda: RandomTangents(direct(), points, np.random.default_rng(1))),
        "eight corners (thesis)": Way(lambda: CornerDeformations(direct(), points, grid)),
        "descriptors interpolated": Way(lambda: CornerDescriptors(direct(), points, grid, mended=False)),
        "the same, frames mended": Way(lambda: CornerDescriptors(direct(), points, grid, mended=True)),
        "fields on grids (ships)": Way(lambda: fields(None), DIRECT),
        "fields, 48 and 96 cells": Way(lambda: fields(96), DIRECT),
    }


def direct_contact(model: DescriptorModel, body: ReducedBody, collider: Collider) -> DescriptorCorrection:
    """A descriptor correction that asks the collider itself."""
    geometry = DirectGeometry(collider, model.options.radius, model.options.sets)
    return DescriptorCorrection("direct", model, body, collider, geometry)


@dataclass
class Tally:
    """Sums over all paths of one way; all and turned points apart, the latter second."""

    off: float = 0.0
    size: float = 0.0
    flicker: Array = field(default_factory=lambda: np.zeros(2))
    motion: Array = field(default_factory=lambda: np.zeros(2))
    seconds: float = 0.0
    prepared: float = 0.0
    evaluations: int = 0
    rows: int = 0
    active: int = 0
    trace: list[float] = field(default_factory=list)

    def add(self, u: Array, beside: Array, direct: Array, turned: BoolArray) -> None:
        """u, beside, direct: (steps, n, dim) by this way, by that of the same frames, and directly."""
        self.off += float(np.square(u - beside).sum())
        self.size += float(np.square(beside).sum())
        for k, points in enumerate((np.ones_like(turned), turned)):
            second = u[2:, points] - 2 * u[1:-1, points] + u[:-2, points]
            self.flicker[k] += float(np.square(second).sum()) / (len(u) - 2)
            self.motion[k] += float(np.square(np.diff(direct[:, points], axis=0)).sum()) / (len(u) - 1)
        self.active += len(u) * int((direct[0] != 0).any(axis=1).sum())
        if not self.trace:  # of the node that moves farthest, from where it begins, in mm
            node = int(np.argmax(np.linalg.norm(np.diff(direct, axis=0), axis=2).sum(axis=0)))
            self.trace = (1e3 * np.linalg.norm(u[:, node] - direct[0, node], axis=1)).tolist()

    def row(self, weights: int, colliders: int) -> dict[str, float]:
        """The line of the table."""
        flicker = np.sqrt(self.flicker / np.where(self.motion > 0, self.motion, np.nan))
        return {
            "off": float(np.sqrt(self.off / self.size)),
            "flicker": float(flicker[0]),
            "turned": float(flicker[1]),
            "MFLOP": 2e-6 * weights * self.rows / self.active,
            "ms": 1e3 * self.seconds / self.evaluations,
            "precomputed, s": self.prepared / colliders,
        }


def measure(
    model: DescriptorModel,
    body: ReducedBody,
    truth: TruthData,
    colliders: Sequence[tuple[str, Collider]],
    steps: int,
) -> dict[str, Tally]:
    """Every way on every collider."""
    tallies: dict[str, Tally] = {}
    counted = [0]
    model.register_forward_pre_hook(lambda _, inputs: counted.__setitem__(0, counted[0] + len(inputs[0])))
    for shape, collider in colliders:
        courses = paths(truth, shape, steps)
        contact = direct_contact(model, body, collider)
        for_grid, grid = _timed(partial(GridOfDescriptors, contact, collider, CORNER_CELLS))
        turned = [_turned(contact, body, grid, *course) for course in courses]
        found: dict[str, list[Array]] = {}
        for name, way in ways(model, body, collider, grid).items():
            tally = tallies.setdefault(name, Tally())
            took, bound = _timed(way.prepare)
            tally.prepared += took + (for_grid if isinstance(bound, CornerDeformations) else 0.0)
            bound.displacement(courses[0][0], courses[0][1][0])  # compiled, in the cache
            for course, (rows, poses) in enumerate(courses):
                counted[0] = 0
                took, u = _timed(partial(_along, bound, rows, poses))
                tally.seconds, tally.evaluations = tally.seconds + took, tally.evaluations + len(u)
                tally.rows += counted[0]
                found.setdefault(name, []).append(u)
                tally.add(u, found[way.beside][course], found[DIRECT][course], turned[course])
    return tallies


def _along(bound: BoundDescriptorCorrection, rows: Array, poses: list[RigidPose]) -> Array:
    """u (steps, n, dim) along a path."""
    return np.stack([bound.displacement(rows, pose) for pose in poses])


def _turned(
    contact: DescriptorCorrection,
    body: ReducedBody,
    grid: GridOfDescriptors,
    rows: Array,
    poses: list[RigidPose],
) -> BoolArray:
    """(n,) surface samples that are in a cell of turned frames at some time."""
    basis = body.node_points(body.surface.nodes).basis
    turned = np.zeros(len(basis), dtype=bool)
    for pose in poses[::5]:
        z = pose.apply_inverse(basis @ rows)
        near = np.flatnonzero(contact.geometry.distance(z) < contact.support)
        turned[near[grid.turning(z[near]) > TURNED]] = True
    return turned


def _timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """CPU seconds, and what came of it."""
    started = time.process_time()
    result = work()
    return time.process_time() - started, result


def main() -> None:
    """Load, measure, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="run directory (default: runs/NAME)")
    parser.add_argument("--model", default="thesis6")
    parser.add_argument("--colliders", nargs="+", default=validation_names())
    parser.add_argument("--steps", type=int, default=50, help="of each path")
    options = parser.parse_args()
    context = Context(experiment_path=options.experiment, overrides=(), out=options.out, quiet=True)
    experiment, body = context.experiment, body_of_run(context)
    with load_truth(context.out_dir / "truth.h5", body) as truth:
        known = [name for name in options.colliders if _has_samples(truth, name)]
        colliders = [(name, build_collider(experiment.collider(name), experiment.base_dir)) for name in known]
        if not colliders:
            raise SoftprintError(f"{truth.path}: has no usable samples of {', '.join(options.colliders)}")
        loaded = load_correction(correction_path(context.out_dir, options.model), body, colliders[0][1])
        if not isinstance(loaded, DescriptorCorrection):
            raise SoftprintError(f"{options.model} is not a descriptor model ({ANY_COLLIDER} collider)")
        model = loaded.model
        tallies = measure(model, body, truth, colliders, options.steps)
    weights = sum(p.numel() for name, p in model.named_parameters() if name.endswith("weight"))
    rows = {name: tally.row(weights, len(colliders)) for name, tally in tallies.items()}
    first = tallies[DIRECT]
    print(f"{', '.join(known)}; {first.active / first.evaluations:.0f} active points on average\n")
    print("\n".join(lines(rows)))
    kept = [{"way": name, **rows[name], "trace": tallies[name].trace} for name in rows]
    with atomic_path(context.out_dir / "descriptor_ways.json") as temporary:
        temporary.write_text(json.dumps(kept, indent=1))


def lines(rows: dict[str, dict[str, float]]) -> Iterator[str]:
    """A table in Markdown."""
    columns = list(next(iter(rows.values())))
    yield f"| way | {' | '.join(columns)} |"
    yield f"| --- {'| --- ' * len(columns)}|"
    for name, row in rows.items():
        cells = [f"{row['off']:.2%}", f"{row['flicker']:.3f}", f"{row['turned']:.3f}", f"{row['MFLOP']:.2f}"]
        cells += [f"{row['ms']:.1f}", f"{row['precomputed, s']:.1f}"]
        yield f"| {name} | {' | '.join(cells)} |"


def _has_samples(truth: TruthData, name: str) -> bool:
    if name not in truth.header.colliders:
        return False
    number = truth.header.colliders.index(name)
    return bool((truth.usable & (truth.contacts["collider"][truth.samples["contact"]] == number)).any())


if __name__ == "__main__":
    run_script(main)
