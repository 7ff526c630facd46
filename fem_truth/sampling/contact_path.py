"""One contact: a collider moved along one line, shallow to deep, each solve started from the previous
depth.

Contact truth can be multi-valued. The recorded branch is the one that slow loading from outside reaches:

* the first depth starts from the state's internal equilibrium, every further one from the previous depth;
* a depth that does not converge is tried again in smaller steps; if that fails too, its sample gets the
  solver's status and the deeper ones are `unreached`: there is no truth beyond the end of a path;
* where the fastest node moved much faster than the collider since the previous depth, that step is solved again in four
  parts, and the sample is flagged as a jump if most of the motion happens within one of them.

A share of the contacts is solved a second time *from the side*: before every depth the collider is moved
sideways by one depth step, and slides back at full depth to the recorded pose. If the truth is single-valued, both
paths end in the same solution, up to the solver's tolerance; the spread between them is the label noise.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from softprint.fem_truth.statics.constrained import ConstrainedProblem, Press, Solution
from softprint.fem_truth.statics.newton import FullSpaceSettings
from softprint.runtime.arrays import Array
from softprint.runtime.colliders.approach import Approach
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose

# How often a failed step is halved: twice makes four small steps of one.
_HALVINGS = 2

# Mostly the fastest node is hardly faster than the collider that pushes it. Above this speed the step is solved in
# parts. What moves fast need not have snapped: of 45 such samples of a library without inverted cells, in which most of
# the motion was in no single part, 43 agree with a second path to 2 %; of slower ones 458 of 466.
FAST = 2.0
# A jump is in one of so many parts, whatever their number; on a smooth path each has its share of the motion.
_PARTS, _MOST = 4, 0.5


@dataclass
class Work:
    """The cost of a sample, including extra steps."""

    newton_iterations: int = 0
    cg_iterations: int = 0
    seconds: float = 0.0

    def add(self, solution: Solution) -> None:
        self.newton_iterations += solution.newton_iterations
        self.cg_iterations += solution.cg_iterations
        self.seconds += solution.seconds


@dataclass(frozen=True, eq=False)
class PathSample:
    """One depth of a path. solution: None if the path ended before it; work: total cost; jumped: to another branch
    since the depth before."""

    depth: float
    pose: RigidPose
    solution: Solution | None
    work: Work = field(default_factory=Work)
    jumped: bool = False

    @property
    def converged(self) -> bool:
        return self.solution is not None and self.solution.converged


@dataclass(frozen=True, eq=False)
class ContactPath:
    """The contact solves along one line of approach. rows: the state; internal: (n_nodes, dim) its internal
    equilibrium [m]."""

    problem: ConstrainedProblem
    collider: Collider
    rows: Array
    internal: Array
    approach: Approach
    settings: FullSpaceSettings

    def load(self, depths: Array) -> list[PathSample]:
        """Solve at ascending depths (k,) [m], starting from the internal equilibrium."""
        samples: list[PathSample] = []
        x, reached = self.internal, 0.0
        for depth, pose in zip(depths, self.approach.poses_at(depths), strict=True):
            if samples and not samples[-1].converged:
                samples.append(PathSample(depth, pose, None))
                continue
            work, jumped = Work(), False
            solution = self._advance(x, reached, float(depth), pose, _HALVINGS, work)
            if solution.converged and _fastest(x, solution.x) > FAST * (depth - reached):
                solution, jumped = self._in_parts(x, reached, float(depth), solution, work)
            samples.append(PathSample(float(depth), pose, solution, work, jumped))
            x, reached = solution.x, float(depth)
        return samples

    def _in_parts(
        self, x: Array, reached: float, depth: float, at_once: Solution, work: Work
    ) -> tuple[Solution, bool]:
        """Solve from x at depth ``reached`` to ``depth`` in parts, and whether it jumps on the way; at_once: what to
        keep where a part does not converge, which counts as a jump."""
        start, moved, solution = x, [], at_once
        for pose in self.approach.poses_at(np.linspace(reached, depth, _PARTS + 1)[1:]):
            solution = self._solve(x, pose)
            work.add(solution)
            if not solution.converged:
                return at_once, True
            moved.append(_fastest(x, solution.x))
            x = solution.x
        return solution, max(moved) > _MOST * _fastest(start, x)

    def from_the_side(self, samples: list[PathSample], direction: Array) -> list[Solution | None]:
        """Solve the same samples again, sliding into each pose along ``direction`` (dim,), a unit vector.

        None for samples that this path did not reach.
        """
        again: list[Solution | None] = []
        x: Array | None = self.internal
        step = samples[-1].depth / len(samples)
        for sample in samples:
            aside = RigidPose(sample.pose.rotation, sample.pose.translation + step * direction)
            before = None if x is None else self._solve(x, aside)
            solution = self._solve(before.x, sample.pose) if before is not None and before.converged else None
            again.append(solution)
            x = solution.x if solution is not None and solution.converged else None
        return again

    def _advance(
        self, x: Array, reached: float, depth: float, pose: RigidPose, halvings: int, work: Work
    ) -> Solution:
        """Solve from x at depth ``reached`` to ``depth``; a failed step is halved, as often as allowed."""
        solution = self._solve(x, pose)
        work.add(solution)
        if solution.converged or halvings == 0:
            return solution
        middle = 0.5 * (reached + depth)
        half_pose = self.approach.poses_at(np.array([middle]))[0]
        half = self._advance(x, reached, middle, half_pose, halvings - 1, work)
        if not half.converged:
            return solution
        return self._advance(half.x, middle, depth, pose, halvings - 1, work)

    def _solve(self, x: Array, pose: RigidPose) -> Solution:
        return self._press.solve(pose, self.settings, x)

    @cached_property
    def _press(self) -> Press:
        """The sequence of contact solves, which reuses the elastic Hessian while it converges fast enough."""
        return self.problem.press(self.rows, self.collider, self.internal)


def node_speeds(displacements: list[Array | None], depths: Array) -> Array:
    """(k,) speed of the fastest node between one depth and the next, relative to the collider's; NaN where
    unknown.

    v_j = max_i |u_i(d_j) - u_i(d_{j-1})| / (d_j - d_{j-1}), with u = 0 at d_0 = 0. Pushed nodes move with the collider:
    a linear extrapolation along the path predicts about 1.
    """
    speeds = np.full(len(depths), np.nan)
    before: Array | float = 0.0
    depth_before = 0.0
    for j, (displacement, depth) in enumerate(zip(displacements, depths, strict=True)):
        if displacement is None:
            break
        speeds[j] = _fastest(before, displacement) / (depth - depth_before)
        before, depth_before = displacement, float(depth)
    return speeds


def _fastest(before: Array | float, after: Array) -> float:
    """The way of the node that moved farthest [m]."""
    return float(np.linalg.norm(after - before, axis=1).max())
