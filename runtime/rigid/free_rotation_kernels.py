"""The equation of the implicit midpoint rule on rotations in 3D, and Newton's method for it; see `free_rotation.py`."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm, expm_frechet
from scipy.optimize import root

from softprint.runtime.arrays import Array
from softprint.runtime.compiled import compiled

# Newton's method converges quadratically: after a change of so much [rad] the next one would be round-off.
_LAST_CHANGE = 1e-8
# Two to five are enough, or the step is too long for the rule.
_ITERATIONS = 10


def _cross(w: Array) -> Array:
    return -np.cross(np.eye(3), w).T


def _equation(inertia: Array, momentum: Array, h: float, spin: Array) -> tuple[Array, Array]:
    half, along = -0.5 * h * _cross(spin), [-0.5 * h * _cross(axis) for axis in np.eye(3)]
    changes = [expm_frechet(half, change, compute_expm=False) @ momentum for change in along]
    return inertia @ spin - expm(half) @ momentum, inertia - np.transpose(changes)


def _found(inertia: Array, momentum: Array, h: float) -> tuple[Array, bool]:
    start = np.linalg.solve(inertia, momentum)
    return root(lambda spin: _equation(inertia, momentum, h, spin), start, jac=True, tol=1e-14).x, True


@compiled
def _crossed(a: Array, b: Array) -> Array:
    """a x b (3,)."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@compiled
def _solved(columns: Array, b: Array) -> Array:
    """x (3,) of a system of three equations with a matrix given by its columns (3, 3), by Cramer's rule."""
    across = _crossed(columns[1], columns[2])
    x = np.array([across @ b, columns[0] @ _crossed(b, columns[2]), columns[0] @ _crossed(columns[1], b)])
    return x / (columns[0] @ across)


@compiled(reference=_equation)
def midpoint_equation(inertia: Array, momentum: Array, h: float, spin: Array) -> tuple[Array, Array]:
    """I u - m (3,) [kg m^2/s] and its derivative by the spin u (3, 3) [kg m^2], from the momentum (3,) at the start;
    all in the coordinates of the body."""
    a = -0.5 * h * spin
    angle = np.sqrt(a @ a)
    # sin|a|/|a|, (1 - cos|a|)/|a|^2 without cancellation, and (|a| - sin|a|)/|a|^3, where what cancels is multiplied by
    # |a|^2 below.
    first = np.sin(angle) / angle if angle > 0.0 else 1.0
    half = np.sin(0.5 * angle) / (0.5 * angle) if angle > 0.0 else 1.0
    second, third = 0.5 * half * half, (1.0 - first) / (angle * angle) if angle > 0.0 else 1.0 / 6.0
    across = _crossed(a, momentum)
    middle = momentum + first * across + second * _crossed(a, across)
    derivative = inertia.copy()
    for k in range(3):
        axis = np.zeros(3)
        axis[k] = 1.0
        turned = _crossed(a, axis)
        rotation = axis + second * turned + third * _crossed(a, turned)
        derivative[:, k] -= 0.5 * h * _crossed(middle, rotation)
    return inertia @ spin - middle, derivative


@compiled(reference=_found)
def middle_spin(inertia: Array, momentum: Array, h: float) -> tuple[Array, bool]:
    """u (3,) [rad/s] of the midpoint rule over h [s], and whether it was found."""
    spin = _solved(inertia, momentum)  # which is symmetric
    for _ in range(_ITERATIONS):
        residual, derivative = midpoint_equation(inertia, momentum, h, spin)
        change = _solved(np.ascontiguousarray(derivative.T), residual)
        spin = spin - change
        if h * np.sqrt(change @ change) < _LAST_CHANGE:
            return spin, True
    return spin, False
