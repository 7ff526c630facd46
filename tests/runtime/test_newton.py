"""Newton's method: exact on quadratics, downhill from saddles, and honest about where it stopped."""

import numpy as np
import pytest

from runtime.dynamics.newton import Descent, Linearisation, NewtonSettings, Status, minimise
from runtime.errors import SoftprintError


class Smooth:
    """E(x) of plain numbers; `pieces` gives energy, gradient and Hessian."""

    def __init__(self, pieces):
        self.pieces = pieces

    def linearise(self, x):
        energy, gradient, hessian = self.pieces(x)
        return Linearisation(energy, 1e-13 * abs(energy), gradient, lambda: hessian, scale=1.0)

    def energy(self, x):
        return self.pieces(x)[0]

    def retract(self, x, v):
        return x + v

    def longest(self, x, v):
        return 1.0


def quadratic(x):
    matrix, force = np.diag([1.0, 4.0, 100.0]), np.array([1.0, -2.0, 3.0])
    return 0.5 * x @ matrix @ x - force @ x, matrix @ x - force, matrix


def double_well(x):
    """(x0^2 - 1)^2 + x1^2: a saddle at 0, where the Hessian is indefinite, and minima at (+-1, 0)."""
    energy = (x[0] ** 2 - 1) ** 2 + x[1] ** 2
    gradient = np.array([4 * x[0] * (x[0] ** 2 - 1), 2 * x[1]])
    return energy, gradient, np.diag([12 * x[0] ** 2 - 4, 2.0])


def test_a_quadratic_takes_one_step():
    result = minimise(Smooth(quadratic), np.zeros(3), NewtonSettings())
    assert result.converged
    assert result.iterations == 1
    np.testing.assert_allclose(result.x, [1.0, -0.5, 0.03], rtol=1e-14)  # a diagonal solve: round-off


def test_a_hessian_serves_again_where_that_is_enough():
    """|x|^2 / 2 + |x|^4 / 4 from x = 0.2: Newton's method leaves 0.014 and then 6e-6; with the first Hessian again, too
    stiff by a tenth, the second iteration leaves 1.5e-3."""
    asked = []

    class Counted(Smooth):
        def linearise(self, x):
            at = super().linearise(x)
            return Linearisation(
                at.energy, at.noise, at.gradient, lambda: asked.append(x) or at.hessian, at.scale
            )

    def quartic(x):
        square = x @ x
        hessian = (1.0 + square) * np.eye(2) + 2.0 * np.outer(x, x)
        return 0.5 * square + 0.25 * square**2, (1.0 + square) * x, hessian

    begin = np.array([0.2, 0.0])
    rough = minimise(Counted(quartic), begin, NewtonSettings(tolerance=3e-3))
    assert (rough.converged, rough.iterations, len(asked)) == (True, 2, 1)
    asked.clear()
    fine = minimise(Counted(quartic), begin, NewtonSettings(tolerance=1e-4))
    assert (fine.converged, fine.iterations, len(asked)) == (True, 2, 2)


def test_one_iteration_does_not_claim_convergence_it_has_not_seen():
    result = minimise(Smooth(quadratic), np.zeros(3), NewtonSettings(max_iterations=1))
    assert result.status is Status.MAX_ITERATIONS
    assert not result.converged
    assert result.residual == pytest.approx(np.sqrt(14.0))  # of the start, which is the last it has seen
    assert "iteration limit" in result.reason
    assert result.decrement == pytest.approx(0.5 * (1 + 1 + 0.09))  # 1/2 f K^-1 f


def test_negative_curvature_leads_to_a_minimum():
    result = minimise(Smooth(double_well), np.array([0.1, 1.0]), NewtonSettings(tolerance=1e-10))
    assert result.converged
    np.testing.assert_allclose(result.x, [1.0, 0.0], atol=1e-9)  # tolerance over the curvature 8


def test_the_direction_is_downhill_for_any_symmetric_hessian():
    rng = np.random.default_rng(1)
    for _ in range(20):
        matrix = rng.normal(size=(6, 6))
        gradient = rng.normal(size=6)
        assert gradient @ Descent(matrix + matrix.T)(gradient) < 0


def test_energies_that_are_not_finite_are_named():
    result = minimise(Smooth(lambda x: (np.inf, x, np.eye(2))), np.ones(2), NewtonSettings())
    assert result.status is Status.NOT_FINITE
    assert "not finite" in result.reason


def test_a_line_search_without_a_way_down_is_named():
    """The gradient lies: the energy rises along every direction it proposes."""
    result = minimise(Smooth(lambda x: (x @ x, -2 * x, np.eye(2))), np.ones(2), NewtonSettings())
    assert result.status is Status.LINE_SEARCH_FAILED
    np.testing.assert_array_equal(result.x, np.ones(2))


@pytest.mark.parametrize("options", [{"max_iterations": 0}, {"tolerance": 0.0}])
def test_settings_that_make_no_sense_are_refused(options):
    with pytest.raises(SoftprintError, match="must be"):
        NewtonSettings(**options)


def test_a_jump_beside_the_minimum_is_told_and_not_tried_to_the_last():
    """A parabola whose energy is higher beyond a cliff, behind which the minimum lies: at the cliff forces do not
    balance, and yet there is nowhere to go."""

    def cliff(x):
        return 0.5 * x @ x + float(x[0] < 0.01), x.copy(), np.eye(1)

    result = minimise(Smooth(cliff), np.ones(1), NewtonSettings(max_iterations=200, tolerance=1e-6))
    assert result.status is Status.STALLED
    assert not result.converged
    assert "falls hardly further" in result.reason
    # Six steps of less than a fiftieth of the way to the minimum.
    assert result.x[0] == pytest.approx(0.01, rel=0.05)
    assert result.residual == pytest.approx(0.01, rel=0.05)
    assert result.iterations < 60
