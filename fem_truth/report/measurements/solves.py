"""The full-space solves at a frame of the held-out motion, cached in the run directory.

At the reduced state q of a frame, with the collider's recorded pose: the internal equilibrium, the linear response
about it, and the exact constrained equilibrium. The last starts from the frame's own positions (which satisfy the
constraint), so that of several equilibria it finds the one on the branch of the motion."""

import logging
import time
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from softprint.fem_truth.statics.constrained import ConstrainedProblem, Solution
from softprint.runtime.arrays import Array
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.io.files import atomic_path, content_hash

log = logging.getLogger(__name__)

_VERSION = "frame solves 3"  # increase it when the meaning of the stored data changes


@dataclass(frozen=True, eq=False)
class FrameSolves:
    """Displacements at the nodes, (n_nodes, dim) [m].

    internal: internal equilibrium minus U q; linear, exact: contact displacement, from the internal
    equilibrium, of the linear response and of the constrained truth; seconds: total time; problem: why the
    frame cannot be used, or ""."""

    internal: Array
    linear: Array
    exact: Array
    seconds: float
    problem: str


def solve_frame(
    problem: ConstrainedProblem, rows: Array, reduced: Array, full: Array, collider: Collider, pose: RigidPose
) -> FrameSolves:
    """Solve at the reduced state rows (n_rows, dim) of a frame with reduced positions and full positions
    (n_nodes, dim)."""
    start = time.perf_counter()
    internal = problem.internal_equilibrium(rows, x0=reduced)
    linear = problem.linear_response(rows, collider, pose, internal.x)
    exact = problem.solve(rows, collider, pose, full, internal=internal.x)
    named = (("internal equilibrium", internal), ("linear response", linear), ("constrained truth", exact))
    return FrameSolves(
        internal=internal.x - reduced,
        linear=linear.x - internal.x,
        exact=exact.x - internal.x,
        seconds=time.perf_counter() - start,
        problem="; ".join(_complaint(name, solution) for name, solution in named if not solution.converged),
    )


def _complaint(name: str, solution: Solution) -> str:
    return f"{name}: {solution.reason}"


class SolveStore:
    """Finished frame solves in a folder, one file per frame, each written atomically; `context` identifies the rest of
    the problem (body, material, collider, contact), so that a changed experiment is solved again."""

    def __init__(self, folder: Path, context: str) -> None:
        self._folder, self._context = folder, context

    def load(self, frame: int, full: Array, pose: RigidPose) -> FrameSolves | None:
        """The solves of this frame, if they exist."""
        path = self._path(frame)
        if not path.is_file():
            return None
        try:
            with np.load(path, allow_pickle=False) as kept:
                if str(kept["key"]) != self._key(full, pose):
                    return None
                return FrameSolves(
                    internal=kept["internal"],
                    linear=kept["linear"],
                    exact=kept["exact"],
                    seconds=float(kept["seconds"]),
                    problem=str(kept["problem"]),
                )
        # RuntimeError: damage can make the archive look encrypted or of a kind unknown to zipfile.
        except (OSError, ValueError, KeyError, BadZipFile, RuntimeError) as error:
            log.warning("%s: not readable (%s); the frame is solved again", path, error)
            return None

    def save(self, frame: int, full: Array, pose: RigidPose, solves: FrameSolves) -> None:
        key = np.array(self._key(full, pose))
        with atomic_path(self._path(frame)) as temporary:
            np.savez(temporary, key=key, **vars(solves))

    def _path(self, frame: int) -> Path:
        return self._folder / f"frame_{frame:05d}.npz"

    def _key(self, full: Array, pose: RigidPose) -> str:
        return content_hash(
            {
                "version": _VERSION,
                "context": self._context,
                "full": full,
                "pose": np.ascontiguousarray(pose.matrix),
            }
        )
