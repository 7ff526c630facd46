"""Drives models and solvers through the held-out motion, frame by frame, and collects what `comparison`
measures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fem_truth.report.comparison import (
    ModelFrames,
    evenly_spaced,
    measure_frame,
    pool,
)
from fem_truth.report.solves import FrameSolves
from runtime.arrays import Array, IntArray
from runtime.body.body import ReducedBody
from runtime.colliders.collider import Collider
from runtime.colliders.pose import RigidPose
from runtime.learned.correction import BoundCorrection, Correction, FollowsContact
from runtime.mechanics.static_condensation import StaticCondensation

#: The answers of the full-space solvers, beside the bare subspace and the corrections.
SOLVED = ("linear_response", "truth", "statics")


@dataclass(frozen=True, eq=False)
class HeldOutMotion:
    """A full-space motion under one collider: times (n_frames,) [s], a pose a frame, positions read on
    demand."""

    times: Array
    poses: Sequence[RigidPose]
    positions: Callable[[int], Array]

    @property
    def n_frames(self) -> int:
        return len(self.times)


@dataclass(frozen=True, eq=False)
class Corrected:
    """A correction at all nodes of the body: the contact displacement that it learned, and the internal response that
    it comes with, if any."""

    bound: BoundCorrection
    internal: StaticCondensation | None

    @classmethod
    def of(cls, correction: Correction, body: ReducedBody) -> Corrected:
        return cls(correction.bind(body.node_points()), correction.internal)

    def contact(self, rows: Array, pose: RigidPose) -> Array:
        """(n_nodes, dim) [m] displacement by contact."""
        return self.bound.displacement(rows, pose)

    def contact_along(self, rows: Array, poses: Sequence[RigidPose]) -> Array:
        """The same at the last of some poses, come to along them from nothing."""
        self.begin()
        for pose in poses[:-1]:
            self.lead(rows, pose)
        return self.contact(rows, poses[-1])

    def begin(self) -> None:
        """Nothing is in contact yet."""
        if isinstance(self.bound, FollowsContact):
            self.bound.begin()

    def lead(self, rows: Array, pose: RigidPose) -> None:
        """Go to a state on the way to another."""
        if isinstance(self.bound, FollowsContact):
            self.bound.lead(rows, pose)

    def internal_displacement(self, rows: Array) -> Array:
        """(n_nodes, dim) [m] without contact; zero where the correction has no internal response."""
        if self.internal is None:
            return np.zeros((), dtype=np.float64)
        return self.internal.displacement(rows, rows)


class Comparer:
    """Puts every model into the same frame: the projected reduced state, and the collider where it was."""

    def __init__(
        self,
        body: ReducedBody,
        collider: Collider,
        motion: HeldOutMotion,
        corrections: Mapping[str, Corrected],
    ) -> None:
        self.body, self.collider, self.motion, self.corrections = body, collider, motion, corrections
        self._surface = body.mesh.surface_nodes

    def depth(self, positions: Array, pose: RigidPose) -> Array:
        """(n_surface,) penetration of the surface nodes [m]."""
        return np.maximum(0.0, -self.collider.sdf(pose.apply_inverse(positions[self._surface])))

    def rows(self, frame: int) -> Array:
        """The reduced state of a frame, `ReducedBody.project`."""
        return self.body.project(self.motion.positions(frame))

    def reduced(self, frame: int) -> Array:
        """The positions of the bare subspace in a frame."""
        return self.body.reduced_positions(self.rows(frame))

    def contact_frames(self) -> tuple[IntArray, Array]:
        """The frames in which the full-space body touches the collider, and in each of them how deep the
        collider enters the space of the *reduced* body [m]: how much there is to correct."""
        touching: list[int] = []
        press: list[float] = []
        for frame in range(self.motion.n_frames):
            full, pose = self.motion.positions(frame), self.motion.poses[frame]
            if self.depth(full, pose).max() > 0:
                touching.append(frame)
                press.append(self.depth(self.reduced(frame), pose).max())
        return np.array(touching, dtype=np.int64), np.array(press)

    def positions(self, frame: int, solves: FrameSolves | None = None) -> dict[str, Array]:
        """(n_nodes, dim) of every model in a frame, in the order of the tables; the solvers' where there are
        solves."""
        rows, pose = self.rows(frame), self.motion.poses[frame]
        reduced = self.reduced(frame)
        result = {"full": self.motion.positions(frame), "bare": reduced}
        for name, correction in self.corrections.items():
            result[name] = reduced + correction.internal_displacement(rows) + correction.contact(rows, pose)
        if solves is not None:
            result["linear_response"] = reduced + solves.linear
            result["truth"] = reduced + solves.exact
            result["statics"] = reduced + solves.internal + solves.exact
        return result

    def begin(self) -> None:
        """Before the first of frames that are asked for in their order: contacts are followed from each to the next."""
        for correction in self.corrections.values():
            correction.begin()

    def lead_to(self, frame: int, contact: IntArray) -> None:
        """Before a single frame: follow the contact through the frames in contact up to it."""
        self.begin()
        for before in map(int, contact[contact < frame]):
            rows, pose = self.rows(before), self.motion.poses[before]
            for correction in self.corrections.values():
                correction.lead(rows, pose)

    def measure(self, frame: int, solves: FrameSolves | None = None) -> dict[str, ModelFrames]:
        """What every model leaves in a frame."""
        pose = self.motion.poses[frame]
        positions = self.positions(frame, solves)
        full, bare = positions["full"], positions["bare"]
        near = self.collider.sdf(pose.apply_inverse(full)) < 0.5 * self.collider.size
        return {
            name: measure_frame(frame, x, bare, full, near, self.depth(x, pose))
            for name, x in positions.items()
        }


@dataclass(frozen=True, eq=False)
class SceneComparison:
    """The outcome for one test scene.

    contact: (m,) frames in contact; press: (m,) depth of the collider in the reduced body [m]; everywhere:
    what each model leaves in them; solved: the same on the frames where every full-space solve converged,
    solvers included; missed, exact: on those frames, sums over the nodes of the squared error of every
    model's contact displacement, and of the squared exact displacement [m^2]; unsolved: (frame, reason).
    """

    contact: IntArray
    press: Array
    everywhere: Mapping[str, ModelFrames]
    solved: Mapping[str, ModelFrames]
    missed: Mapping[str, Array]
    exact: Array
    unsolved: Sequence[tuple[int, str]]
    solve_seconds: float


def compare(
    comparer: Comparer,
    contact: IntArray,
    press: Array,
    solve: Callable[[int], FrameSolves],
    n_solved: int,
) -> SceneComparison:
    """Compare over all frames in contact (at least one), and with the solvers on `n_solved` of them, evenly
    spaced."""
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
        press=press,
        everywhere=_joined(everywhere),
        solved=_joined(measured),
        missed={name: np.array(squares) for name, squares in missed.items()},
        exact=np.array(exact),
        unsolved=unsolved,
        solve_seconds=seconds,
    )


def _displacements(comparer: Comparer, frame: int, solves: FrameSolves) -> dict[str, Array]:
    rows, pose = comparer.rows(frame), comparer.motion.poses[frame]
    learned = {name: corrected.contact(rows, pose) for name, corrected in comparer.corrections.items()}
    return {"bare": np.zeros_like(solves.exact), "linear_response": solves.linear, **learned}


def _joined(frames: Sequence[Mapping[str, ModelFrames]]) -> dict[str, ModelFrames]:
    return {name: pool([frame[name] for frame in frames]) for name in frames[0]} if frames else {}
