"""Newton's method of full space, on an energy of two unknowns with a saddle."""

from dataclasses import dataclass

import numpy as np
import pytest

from softprint.fem_truth.statics.newton import FullSpaceSettings, minimise
from softprint.runtime.optimise import NewtonSettings, Status

# E = x^2/2 + c (y^4/4 - y^2/2): a saddle at zero, minima at y = -1 and y = 1.
_CURVATURE = 0.1


@dataclass(frozen=True)
class _Slope:
    whole: np.ndarray

    @property
    def norm(self) -> float:
        return float(np.linalg.norm(self.whole))


@dataclass(frozen=True)
class _Direction:
    step: np.ndarray
    slope: float
    negative_curvature: bool
    direction: np.ndarray | None
    iterations: int = 1


class _Saddle:
    """Its convex model has the curvature one along y wherever the energy has a negative one."""

    noise = 0.0

    def __init__(self, longest: float) -> None:
        self._longest = longest

    def evaluate(self, x):
        y = x[0, 1]
        energy = 0.5 * x[0, 0] ** 2 + _CURVATURE * (0.25 * y**4 - 0.5 * y**2)
        return energy, _Slope(np.array([[x[0, 0], _CURVATURE * (y**3 - y)]]))

    def direction(self, x, gradient, tolerance, max_iterations, convex=False):
        curvature = _CURVATURE * (3.0 * x[0, 1] ** 2 - 1.0)
        negative = curvature <= 0.0
        stiffness = 1.0 if negative else curvature
        step = -gradient.whole / [1.0, stiffness]
        found = negative and not convex
        return _Direction(step, float(np.vdot(gradient.whole, step)), found, np.eye(2)[1:] if found else None)

    def moved(self, x, step, length):
        return x + length * step

    def longest(self, x, step):
        return self._longest

    def allows(self, x):
        return True

    def slope(self, gradient, step):
        return float(np.vdot(gradient.whole, step))

    def stepped(self, x, step, length, before, after):
        return False

    def force_scale(self, x, gradient):
        return 1.0

    def energy_scale(self, x):
        return 1.0


@pytest.mark.parametrize(("longest", "fewest", "most"), [(np.inf, 1, 15), (1.0, 60, 200)])
def test_the_line_search_leaves_a_saddle(longest, fewest, most):
    """Step by step the distance from the saddle grows by a tenth: seventy iterations from 0.001 to 1."""
    settings = FullSpaceSettings(NewtonSettings(200, 1e-6))
    result = minimise(_Saddle(longest), np.array([[1.0, 1e-3]]), settings)
    assert result.status is Status.CONVERGED
    np.testing.assert_allclose(result.x, [[0.0, 1.0]], atol=1e-5)
    assert fewest <= result.newton_iterations <= most
