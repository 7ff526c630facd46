"""Evaluates models and solvers on the held-out motion, frame by frame, and collects their errors (see
`comparison`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from softprint.fem_truth.report.measurements.body_alone import NoCollider
from softprint.fem_truth.report.measurements.comparison import (
    ModelFrames,
    evenly_spaced,
    measure_frame,
    node_distances,
    pool,
    root_mean_square,
)
from softprint.fem_truth.report.measurements.solves import FrameSolves
from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact.solver.solved_contact import SolvedContact
from softprint.runtime.elasticity.invariants import determinant


@dataclass(frozen=True, eq=False)
class HeldOutMotion:
    """A full-space motion with one collider, or `NoCollider`: times (n_frames,) [s], one pose per frame, in which
    frames the body pushes the collider (n_frames,), positions read on demand."""

    times: Array
    poses: Sequence[RigidPose]
    in_contact: BoolArray
    positions: Callable[[int], Array]

    @property
    def n_frames(self) -> int:
        return len(self.times)


class StateCorrection(Protocol):
    """A correction evaluated state by state: `StaticCorrection`, or `InternalDisplacement`."""

    def solve(self, rows: Array, pose: RigidPose, near: SolvedContact | None) -> SolvedContact | None: ...
    def displacement_of(self, solved: SolvedContact | None, rows: Array, pose: RigidPose) -> Array: ...
    def condensed_displacement(self, rows: Array) -> Array: ...


class Comparer:
    """Evaluates every model at the same frame: the projected reduced state and the collider's recorded pose."""

    def __init__(
        self,
        body: ReducedBody,
        collider: Collider,
        motion: HeldOutMotion,
        corrections: Mapping[str, StateCorrection],
    ) -> None:
        self.body, self.collider, self.motion, self.corrections = body, collider, motion, corrections
        self._surface = body.mesh.surface_nodes
        self._near: dict[str, SolvedContact | None] = {}  # warm start of each correction's contact

    def depth(self, positions: Array, pose: RigidPose) -> Array:
        """(n_surface,) penetration of the surface nodes [m]."""
        return np.maximum(0.0, -self.collider.sdf(pose.apply_inverse(positions[self._surface])))

    def _inverted(self, positions: Array) -> int:
        """How many cells have det F <= 0."""
        F = self.body.mesh.deformation_gradients(positions)
        return int((determinant(F) <= 0.0).sum())

    def rows(self, frame: int) -> Array:
        """The reduced state of a frame, by `ReducedBody.project`."""
        return self.body.project(self.motion.positions(frame))

    def reduced(self, frame: int) -> Array:
        """The positions of the bare subspace in a frame."""
        return self.body.reduced_positions(self.rows(frame))

    def contact_frames(self) -> tuple[IntArray, Array]:
        """The frames in which the full-space body touches the collider, and in each of them the penetration depth of
        the collider in the *reduced* body [m], which measures how much there is to correct."""
        if isinstance(self.collider, NoCollider):
            return self._all_frames()
        touching = np.flatnonzero(self.motion.in_contact)
        depth = [self.depth(self.reduced(frame), self.motion.poses[frame]).max() for frame in touching]
        return touching, np.array(depth)

    def _all_frames(self) -> tuple[IntArray, Array]:
        """Those after the start of the scene; instead of a depth, the RMS distance of the reduced body from full space
        [m]."""
        frames = np.arange(1, self.motion.n_frames)
        distance = [
            root_mean_square(node_distances(self.reduced(frame), self.motion.positions(frame)))
            for frame in frames
        ]
        return frames, np.array(distance)

    def positions(self, frame: int, solves: FrameSolves | None = None) -> dict[str, Array]:
        """Positions (n_nodes, dim) of every model in a frame, in the order of the tables; those of the solvers if there
        are solves."""
        rows, pose = self.rows(frame), self.motion.poses[frame]
        reduced = self.reduced(frame)
        result = {"full": self.motion.positions(frame), "bare": reduced}
        for name, correction in self.corrections.items():
            result[name] = reduced + correction.condensed_displacement(rows)
            result[name] += self.contact_displacement(name, rows, pose)
        if solves is not None:
            result["linear_response"] = reduced + solves.linear
            result["truth"] = reduced + solves.exact
            result["statics"] = reduced + solves.internal + solves.exact
        return result

    def begin(self) -> None:
        """Call before the first of a sequence of frames: contacts are followed from each frame to the next."""
        self._near = {}

    def contact_displacement(self, name: str, rows: Array, pose: RigidPose) -> Array:
        """(n_nodes, dim) [m] of one correction; the next evaluation starts from this contact."""
        correction = self.corrections[name]
        solved = correction.solve(rows, pose, self._near.get(name))
        self._near[name] = solved
        return correction.displacement_of(solved, rows, pose)

    def last_contact(self, name: str) -> SolvedContact | None:
        """The contact in the last evaluation of one correction."""
        return self._near.get(name)

    def lead_to(self, frame: int, contact: IntArray) -> None:
        """Call before a single frame: follows the contact through the frames in contact up to it."""
        self.begin()
        for before in map(int, contact[contact < frame]):
            rows, pose = self.rows(before), self.motion.poses[before]
            for name, correction in self.corrections.items():
                self._near[name] = correction.solve(rows, pose, self._near.get(name))

    def measure(self, frame: int, solves: FrameSolves | None = None) -> dict[str, ModelFrames]:
        """The errors of every model in a frame."""
        pose = self.motion.poses[frame]
        positions = self.positions(frame, solves)
        full, bare = positions["full"], positions["bare"]
        near = self.collider.sdf(pose.apply_inverse(full)) < 0.5 * self.collider.size
        return {
            name: measure_frame(frame, x, bare, full, near, self.depth(x, pose), self._inverted(x))
            for name, x in positions.items()
        }


@dataclass(frozen=True, eq=False)
class SceneComparison:
    """The comparison for one test scene.

    contact: (m,) frames in contact; depth: (m,) depth of the collider in the reduced body [m]; everywhere:
    the errors of each model in them; solved: the same on the frames where every full-space solve converged,
    including the solvers; missed, exact: on those frames, sums over the nodes of the squared error of every
    model's contact displacement, and of the squared exact displacement [m^2]; unsolved: (frame, reason).
    """

    contact: IntArray
    depth: Array
    everywhere: Mapping[str, ModelFrames]
    solved: Mapping[str, ModelFrames]
    missed: Mapping[str, Array]
    exact: Array
    unsolved: Sequence[tuple[int, str]]
    solve_seconds: float


def compare(
    comparer: Comparer,
    contact: IntArray,
    depth: Array,
    solve: Callable[[int], FrameSolves],
    n_solved: int,
) -> SceneComparison:
    """Compare over all frames in contact (at least one), and with the solvers on `n_solved` evenly spaced ones of
    them."""
    everywhere: list[dict[str, ModelFrames]] = []
    measured: list[dict[str, ModelFrames]] = []
    missed: dict[str, list[float]] = {}
    exact: list[float] = []
    unsolved: list[tuple[int, str]] = []
    seconds = 0.0
    asked = set(evenly_spaced(contact, n_solved))
    comparer.begin()
    for frame in map(int, contact):
        everywhere.append(comparer.measure(frame))
        if frame not in asked:
            continue
        solves = solve(frame)
        seconds += solves.seconds
        if solves.problem:
            unsolved.append((frame, solves.problem))
            continue
        measured.append(comparer.measure(frame, solves))
        exact.append(float(np.square(solves.exact).sum()))
        for name, displacement in _displacements(comparer, frame, solves).items():
            missed.setdefault(name, []).append(float(np.square(displacement - solves.exact).sum()))
    return SceneComparison(
        contact=contact,
        depth=depth,
        everywhere=_joined(everywhere),
        solved=_joined(measured),
        missed={name: np.array(squares) for name, squares in missed.items()},
        exact=np.array(exact),
        unsolved=unsolved,
        solve_seconds=seconds,
    )


def _displacements(comparer: Comparer, frame: int, solves: FrameSolves) -> dict[str, Array]:
    rows, pose = comparer.rows(frame), comparer.motion.poses[frame]
    learned = {name: comparer.contact_displacement(name, rows, pose) for name in comparer.corrections}
    return {"bare": np.zeros_like(solves.exact), "linear_response": solves.linear, **learned}


def _joined(frames: Sequence[Mapping[str, ModelFrames]]) -> dict[str, ModelFrames]:
    return {name: pool([frame[name] for frame in frames]) for name in frames[0]} if frames else {}
