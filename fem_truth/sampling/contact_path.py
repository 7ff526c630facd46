"""One contact: a collider pressed along one line, shallow to deep, each depth solved from the last (DESIGN.md, part 6).

Contact truth can be multi-valued. What is recorded is the branch that a slow press from outside reaches:

* the first depth starts from the state's internal equilibrium, every further one from the depth before it;
* a depth that does not converge is tried again in smaller steps; where that fails too, its sample gets the solver's
  status and the deeper ones are `unreached`: a path that has broken off has no truth beyond;
* a sample whose fastest node moved much faster along the path than at the depth before is flagged as a jump.

A share of the contacts is solved a second time *unloading*: in steps between the recorded depths to one beyond the
deepest, then back from deep to shallow. Where truth is single-valued both ways end in the same place, up to the
solver's tolerance; the spread between them is the label noise.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fem_truth.constrained import ConstrainedProblem, Solution
from fem_truth.newton import NewtonSettings
from fem_truth.sampling.approach import Approach
from runtime.arrays import Array
from runtime.colliders.collider import Collider
from runtime.colliders.pose import RigidPose

# A step that fails is halved so often: four small steps in place of one.
_HALVINGS = 2

# A node moves about as fast as the collider that pushes it, and the speed grows smoothly with depth as contact widens.
# Smooth paths stay below 2; snaps to another branch were seen from 5 upwards.
JUMP_LIMIT = 3.0


@dataclass
class Work:
    """What a sample cost, extra steps included."""

    newton_iterations: int = 0
    cg_iterations: int = 0
    seconds: float = 0.0

    def add(self, solution: Solution) -> None:
        self.newton_iterations += solution.newton_iterations
        self.cg_iterations += solution.cg_iterations
        self.seconds += solution.seconds


@dataclass(frozen=True, eq=False)
class PathSample:
    """One depth of a path. solution is None where the path broke off before; jump: see :func:`jumps`."""

    depth: float
    pose: RigidPose
    solution: Solution | None
    work: Work = field(default_factory=Work)

    @property
    def converged(self) -> bool:
        return self.solution is not None and self.solution.converged


@dataclass(frozen=True, eq=False)
class ContactPath:
    """The presses of one line of approach. rows: the state; internal: (n_nodes, dim) its internal equilibrium [m]."""

    problem: ConstrainedProblem
    collider: Collider
    rows: Array
    internal: Array
    approach: Approach
    settings: NewtonSettings

    def load(self, depths: Array) -> list[PathSample]:
        """Press to ascending depths (k,) [m], from the internal equilibrium."""
        samples: list[PathSample] = []
        x, reached = self.internal, 0.0
        for depth, pose in zip(depths, self.approach.poses_at(depths), strict=True):
            if samples and not samples[-1].converged:
                samples.append(PathSample(depth, pose, None))
                continue
            work = Work()
            solution = self._advance(x, reached, float(depth), pose, _HALVINGS, work)
            samples.append(PathSample(float(depth), pose, solution, work))
            x, reached = solution.x, float(depth)
        return samples

    def unload(self, samples: list[PathSample]) -> list[Solution | None]:
        """Solve the same samples again on the other path: past the deepest in steps between, and back to shallow.

        None where the other path broke off before it came to a sample.
        """
        depths = np.array([sample.depth for sample in samples])
        steps = np.diff(depths, prepend=0.0)
        outward = self.load(np.append(depths - 0.5 * steps, depths[-1] + 0.5 * steps[-1]))
        if not all(step.converged for step in outward):
            return [None] * len(samples)
        last = outward[-1].solution
        backward: list[Solution | None] = []
        for sample in reversed(samples):
            if last is not None:
                solution = self._solve(last.x, sample.pose)
                last = solution if solution.converged else None
                backward.append(solution)
            else:
                backward.append(None)
        return backward[::-1]

    def _advance(
        self, x: Array, reached: float, depth: float, pose: RigidPose, halvings: int, work: Work
    ) -> Solution:
        """Go from x at depth ``reached`` to ``depth``; in two halves where one step fails, as often as allowed."""
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
        return self.problem.solve(self.rows, self.collider, pose, x, self.settings, internal=self.internal)


def jumps(displacements: list[Array | None], depths: Array) -> Array:
    """(k,) how much faster the fastest node moved with depth than at the depth before; NaN where unknown.

    v_j = max_i |u_i(d_j) - u_i(d_{j-1})| / (d_j - d_{j-1}), and the result is v_j / max(v_{j-1}, 1): 1 is the speed of
    the collider itself, which is also what a linear extrapolation gives the first depth.
    """
    result = np.full(len(depths), np.nan)
    before: Array | float = 0.0
    speed_before, depth_before = 1.0, 0.0
    for j, (displacement, depth) in enumerate(zip(displacements, depths, strict=True)):
        if displacement is None:
            break
        speed = float(np.linalg.norm(displacement - before, axis=1).max() / (depth - depth_before))
        result[j] = speed / max(speed_before, 1.0)
        before, speed_before, depth_before = displacement, speed, float(depth)
    return result
