"""The rotation of a rigid body over a step without torque: the implicit midpoint rule on rotations.

The angular momentum L stays the same in the world. With R the rotation at the start, the spin u in the coordinates of
the body is the one that belongs to the momentum m in the middle of the step:

    I u = m,    m = exp(-h [u] / 2) R^T L,    R' = R exp(h [u]).

Newton's method solves this from the spin at the start (`free_rotation_kernels.py`). With J_l the derivative of the
exponential map from the left,

    d(I u - m)/du = I - h/2 [m] J_l(-h u / 2),    J_l(a) = 1 + (1 - cos|a|)/|a|^2 [a] + (|a| - sin|a|)/|a|^3 [a]^2.

A slender body needs that: u <- I^-1 m converges only while h |L| / 2 is less than the smallest moment of inertia, for a
rod of 12:1 less than a degree per step. A slender body also needs short steps, since a small error of m is a large one
of the spin about its axis: a step in which the midpoint rule and the trapezoidal rule differ is divided.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.rotations import rotation_exponential
from softprint.runtime.errors import SoftprintError
from softprint.runtime.rigid.free_rotation_kernels import middle_spin

# The longest rotation of one part of a step [rad].
_LONGEST = 1.0
# The largest difference between the midpoint and the trapezoidal rule over a part [rad].
_DIFFERENCE = 1e-3
# More parts than this are not affordable.
_MOST_PARTS = 1024


class Turn(NamedTuple):
    """A rotation by a constant spin (n_spin,) [rad/s], in the world, for a duration [s]."""

    duration: float
    spin: Array


def free_rotation(inertia: Array, rotation: Array, momentum: Array, time_step: float) -> list[Turn]:
    """The turns of a body, one after the other, in time_step [s]: one if that is accurate enough, else a power of two.
    inertia (n_spin, n_spin) [kg m^2] in the coordinates of the body; rotation (dim, dim) at the start; momentum
    (n_spin,) in the world [kg m^2/s]. Raises SoftprintError for a body that is too fast for the number of turns."""
    if len(momentum) == 1:
        return [Turn(time_step, np.linalg.solve(inertia, momentum))]
    turns: list[Turn] = []
    parts, done = 1, 0
    while done < parts:
        h = time_step / parts
        spin = _accurate_spin(inertia, rotation.T @ momentum, h)
        if spin is not None:
            turns.append(Turn(h, rotation @ spin))
            rotation = rotation @ rotation_exponential(h * spin)
            done += 1
        elif parts < _MOST_PARTS:
            parts, done = 2 * parts, 2 * done
        else:
            raise SoftprintError(
                f"a free collider with an angular momentum of {np.linalg.norm(momentum):.3g} kg m^2/s spins too fast "
                f"for steps of {time_step:g} s: take shorter steps"
            )
    return turns


def _accurate_spin(inertia: Array, momentum: Array, h: float) -> Array | None:
    """u (3,) [rad/s] from the momentum (3,) at the start in the coordinates of the body; None if h [s] is too long."""
    spin, found = middle_spin(inertia, momentum, h)
    if not (found and h * np.linalg.norm(spin) <= _LONGEST):
        return None
    at_end = rotation_exponential(-h * spin) @ momentum
    trapezoidal = np.linalg.solve(inertia, 0.5 * (momentum + at_end))
    return spin if h * np.linalg.norm(spin - trapezoidal) <= _DIFFERENCE else None
