"""Newton's method of full space where the energy is not convex."""

from dataclasses import dataclass

import numpy as np
import pytest

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.energy.total_energy import TotalEnergy
from softprint.fem_truth.linalg.null_space import NullSpace
from softprint.fem_truth.statics.newton import FullSpaceSettings, minimise
from softprint.runtime.body import assemble_body, place_handles
from softprint.runtime.elasticity import make_material
from softprint.runtime.mesh import box_mesh
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


@pytest.mark.parametrize("dim", [2, 3])
def test_the_convex_step_of_a_crushed_body_goes_down(dim):
    """Where cells are inverted, elasticity itself has negative curvature: conjugate gradients stop at it at once."""
    mesh = box_mesh([0.0] * dim, [0.05] * dim, [4] * dim)
    body = assemble_body(mesh, place_handles(mesh, 4), make_material("stable_neo_hookean", 3e4, 0.4), 1e3)
    base = np.flatnonzero(mesh.points[:, -1] < 1e-9)
    energy = TotalEnergy(FullSpaceElasticity(body), [], NullSpace(np.zeros((body.n_nodes, 0)), base))
    x = mesh.points.copy()
    x[:, -1] *= 1.0 - 1.6 * x[:, 0] / 0.05  # folded over at the far side
    _, gradient = energy.evaluate(x)
    assert energy.direction(x, gradient, 1e-3, 500).negative_curvature
    found = energy.direction(x, gradient, 1e-3, 500, convex=True)
    assert not found.negative_curvature
    assert found.slope < 0.0
    assert energy.evaluate(x + found.step)[0] < energy.evaluate(x)[0]
