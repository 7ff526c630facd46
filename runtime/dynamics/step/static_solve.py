"""Static equilibrium, frame after frame: each solve holds the rotations of its corotated frame, the next takes those of
its solution.

Where the strain is small the rotations hardly matter, and two to four frames are enough. A slender body that bends far
rotates by a tenth of a radian per frame on its way, and near its equilibrium by a half to four fifths of the frame
before: a cantilever that sags by two fifths of its length takes 24 frames in 2D, 43 in 3D.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.dynamics.state import ReducedState
from softprint.runtime.dynamics.step.step_energy import StepEnergy, StepPoint
from softprint.runtime.dynamics.step.step_solve import solve_step
from softprint.runtime.optimise import Minimum, Optimiser, Status

# The frame is that of the solution once no rotation changes by more than this [rad].
_SAME_ROTATION = 1e-6
_FRAMES = 100


def solve_static(
    begin: ReducedState,
    static: Callable[[ReducedState], tuple[StepEnergy, StepPoint]],
    rotations: Callable[[Array], Array],
    optimiser: Optimiser,
) -> Minimum[StepPoint]:
    """The equilibrium near a state. static: the energy without inertia in the frame of a state, and its point there;
    rotations: (n, dim, dim) of a frame, from its handle rows. MAX_ITERATIONS, with the residual in the frame of the
    solution, where the rotations still change after the last frame."""
    iterations = 0
    for _ in range(_FRAMES):
        solved = solve_step(*static(begin), optimiser, None)
        iterations += solved.iterations
        body, before = solved.x.body, begin.rows
        contact = None if body.contact is None else body.contact.solved
        begin = replace(begin, rows=body.at.rows, contact=contact)
        if not solved.converged:
            break
        if np.abs(rotations(begin.rows) - rotations(before)).max(initial=0.0) < _SAME_ROTATION:
            break
    else:
        problem, point = static(begin)
        residual = problem.linearise(point).residual
        solved = replace(solved, status=Status.MAX_ITERATIONS, residual=residual)
    return replace(solved, iterations=iterations)
