"""The rotation of slender bodies in free flight: derivatives, conservation, and the solution of Euler's equations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from softprint.runtime.body.rotations import rotation_exponential, skew
from softprint.runtime.colliders import Box, Capsule, RigidPose
from softprint.runtime.errors import SoftprintError
from softprint.runtime.rigid import FreeFlight, free_collider
from softprint.runtime.rigid.free_rotation import free_rotation
from softprint.runtime.rigid.free_rotation_kernels import midpoint_equation

STEP = 1 / 60  # s
# Axes of spin; rods lie along x.
ALONG, ACROSS, LEANING = [0.95, 0.3, 0.1], [0.1, 0.99, 0.05], [0.8, 0.6, 0.0]


def rod(ratio):
    """A capsule 110 mm long."""
    radius = 0.055 / ratio
    end = np.array([0.055 - radius, 0.0, 0.0])
    return Capsule(-end, end, radius, "rod")


def rod_inertia(ratio):
    """Of a solid rod with a square section, up to its mass [m^2]."""
    half = np.array([1.0, 1.0 / ratio, 1.0 / ratio]) * 0.055
    return np.diag((half @ half - half**2) / 3.0)


def spin_about(axis, speed):
    return speed * np.array(axis) / np.linalg.norm(axis)


def exact_rotation(inertia, momentum, seconds):
    """R' = R [I^-1 R^T L] from R = 1, to 1e-10."""

    def rate(_, entries):
        R = entries.reshape(3, 3)
        return (R @ skew(np.linalg.solve(inertia, R.T @ momentum))).ravel()

    solution = solve_ivp(rate, (0.0, seconds), np.eye(3).ravel(), "DOP853", rtol=1e-11, atol=1e-12)
    return solution.y[:, -1].reshape(3, 3)


def rotation_after(inertia, momentum, steps, h):
    """By the midpoint rule from R = 1, and the number of turns that it took."""
    R, count = np.eye(3), 0
    for _ in range(steps):
        for duration, spin in free_rotation(inertia, R, momentum, h):
            R = rotation_exponential(duration * spin) @ R
            count += 1
    return R, count


def angle_between(one, other):
    return np.linalg.norm(Rotation.from_matrix(one @ other.T).as_rotvec())


@pytest.mark.parametrize("spin", [[0.0, 0.0, 0.0], [2.0, 19.8, 1.0], [-32.0, 24.0, 5.0]])
def test_the_derivative_of_the_midpoint_equation_is_that_of_finite_differences(spin):
    inertia = rod_inertia(12)
    momentum = inertia @ np.array([3.0, -15.0, 8.0])
    _, found = midpoint_equation(inertia, momentum, STEP, np.array(spin))
    e = 1e-3  # rad/s
    differences = [
        midpoint_equation(inertia, momentum, STEP, spin + e * axis)[0]
        - midpoint_equation(inertia, momentum, STEP, spin - e * axis)[0]
        for axis in np.eye(3)
    ]
    # Central: the error is (h e)^2 = 3e-10 of the value, and round-off of the momentum 1e-16 / 1e-3.
    np.testing.assert_allclose(found, np.transpose(differences) / (2 * e), atol=1e-9 * np.abs(found).max())


@pytest.mark.parametrize(("ratio", "speed"), [(12, 20), (12, 40), (4, 80)])
@pytest.mark.parametrize("axis", [ALONG, ACROSS, LEANING])
def test_a_slender_rod_keeps_its_energy_and_its_angular_momentum(ratio, speed, axis):
    start = free_collider(rod(ratio), RigidPose.identity(3), density=1e3, spin=spin_about(axis, speed))
    pose, motion = start.pose, start.motion
    energies = [motion.energy(start.mass, pose)]
    for _ in range(300):
        flight = FreeFlight(start.mass, pose, motion, STEP, np.zeros(3))
        pose = flight.carried_on()
        motion = flight.motion_at(pose)
        energies.append(motion.energy(start.mass, pose))
    # Round-off of some thousand turns.
    scale = np.linalg.norm(start.motion.momentum)
    np.testing.assert_allclose(motion.momentum, start.motion.momentum, atol=1e-13 * scale)
    # A body of revolution keeps its energy exactly. The inertia of a capsule is computed on a grid, and its two moments
    # across differ by so little that the energy swings by 2e-9.
    np.testing.assert_allclose(energies, energies[0], rtol=1e-8)


@pytest.mark.parametrize(
    ("half", "speed"),
    [([0.055, 0.0046, 0.0046], 20), ([0.055, 0.0046, 0.0046], 40), ([0.055, 0.005, 0.0025], 20)],
    ids=["rod at 20 rad/s", "rod at 40 rad/s", "slat at 20 rad/s"],
)
@pytest.mark.parametrize("axis", [ALONG, LEANING, [0.3, 0.3, 0.9]])
def test_a_slender_body_turns_as_eulers_equations_say(half, speed, axis):
    half = np.array(half)
    inertia = np.diag(half @ half - half**2)
    momentum = inertia @ spin_about(axis, speed)
    found, _ = rotation_after(inertia, momentum, 15, STEP)
    # Of the second order: 0.2 to 0.8 % of the angle of the whole motion, as a part of a step is 1e-3 rad off at most.
    turned = speed * 15 * STEP
    assert angle_between(found, exact_rotation(inertia, momentum, 0.25)) < 0.01 * turned


def test_the_rotation_is_of_second_order():
    inertia = rod_inertia(12)
    momentum = inertia @ spin_about(LEANING, 5.0)
    exact = exact_rotation(inertia, momentum, 0.25)
    errors = []
    for steps in (60, 120):
        found, count = rotation_after(inertia, momentum, steps, 0.25 / steps)
        assert count == steps  # undivided
        errors.append(angle_between(found, exact))
    # 4, and the next term is of the fourth order.
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.02)


@pytest.mark.parametrize("axis", np.eye(3))
def test_about_a_principal_axis_the_rotation_is_exact(axis):
    inertia = rod_inertia(12)
    found, _ = rotation_after(inertia, inertia @ (30.0 * axis), 10, STEP)
    # Round-off; a rod turns steadily about any of its axes.
    np.testing.assert_allclose(found, rotation_exponential(30.0 * axis * 10 * STEP), atol=1e-12)


def test_a_share_of_a_divided_step_is_a_shorter_step():
    start = free_collider(rod(12), RigidPose.identity(3), density=1e3, spin=spin_about(LEANING, 40.0))
    assert len(free_rotation(start.mass.inertia, np.eye(3), start.motion.momentum, STEP)) > 2
    whole, half = (
        FreeFlight(start.mass, start.pose, start.motion, h, np.zeros(3)) for h in (STEP, 0.5 * STEP)
    )
    # The same turns, as parts are powers of two; to round-off.
    np.testing.assert_allclose(whole.carried_on(0.5).rotation, half.carried_on().rotation, atol=1e-13)
    assert np.linalg.norm(whole.step[3:]) == pytest.approx(40.0 * STEP, rel=0.05)  # its axis wobbles


@pytest.mark.parametrize("speed", [1e7, np.nan])
def test_a_body_that_spins_too_fast_for_any_number_of_turns_is_an_error(speed):
    start = free_collider(Box([0.01, 0.02, 0.03]), RigidPose.identity(3), density=1e3)
    momentum = start.mass.inertia @ np.array([speed, 1.0, 1.0])
    with pytest.raises(SoftprintError, match="spins too fast"):
        free_rotation(start.mass.inertia, np.eye(3), momentum, STEP)
