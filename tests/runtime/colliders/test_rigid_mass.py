"""Mass, centre and inertia compared with closed forms; the flight of a rigid body and its conservation laws."""

import numpy as np
import pytest

from softprint.runtime.colliders import Box, Capsule, Cylinder, Placed, RigidPose, Sphere
from softprint.runtime.colliders.sampled.grid import GridCollider
from softprint.runtime.errors import SoftprintError
from softprint.runtime.rigid import FreeFlight, RigidMotion, free_collider, mass_properties
from softprint.runtime.rigid.free_collider import surface_points

R, L = 0.01, 0.04
SHARP = 1e-4  # m, of edges: small beside 1 cm, so that the closed forms of sharp solids hold to 1e-4


def ball(dim):
    return (4 / 3 * np.pi * R**3, 4 / 15 * np.pi * R**5) if dim == 3 else (np.pi * R**2, np.pi / 4 * R**4)


def capsule():
    """Volume, second moment across and along the axis: a cylinder and two half balls, 3/8 R off their faces."""
    volume = np.pi * R**2 * L + ball(3)[0]
    across = np.pi * R**4 * L / 4 + ball(3)[1]
    ends = ball(3)[0] * (R**2 / 5 + L / 2 * 3 / 4 * R + L**2 / 4)
    return volume, [across, across, np.pi * R**2 * L**3 / 12 + ends]


HALF = np.array([0.01, 0.02, 0.03])
CLOSED_FORMS = {
    "ball": (Sphere(R), ball(3)[0], [ball(3)[1]] * 3),
    "circle": (Sphere(R, 2), ball(2)[0], [ball(2)[1]] * 2),
    "box": (Box(HALF, SHARP), 8 * HALF.prod(), 8 * HALF.prod() * HALF**2 / 3),
    "rectangle": (Box(HALF[:2], SHARP), 4 * HALF[:2].prod(), 4 * HALF[:2].prod() * HALF[:2] ** 2 / 3),
    "cylinder": (
        Cylinder(R, L / 2, SHARP),
        np.pi * R**2 * L,
        np.pi * R**2 * L * np.array([R**2 / 4, R**2 / 4, L**2 / 12]),
    ),
    "capsule": (Capsule([0, 0, -L / 2], [0, 0, L / 2], R), *capsule()),
}


@pytest.mark.parametrize("name", CLOSED_FORMS)
def test_closed_forms(name):
    collider, volume, second = CLOSED_FORMS[name]
    found = mass_properties(collider, density=500.0)
    # What `mass.py` states; rounded edges are part of it.
    assert found.mass == pytest.approx(500.0 * volume, rel=1e-4)
    np.testing.assert_allclose(found.second_moment, 500.0 * np.diag(second), atol=3e-4 * 500.0 * max(second))
    np.testing.assert_allclose(found.centre, 0.0, atol=1e-9)  # by symmetry


def test_a_mesh_is_measured_exactly():
    """A tetrahedron with a corner at (a, b, c): V = abc/6, centre (a, b, c)/4, and it stays so when it is moved."""
    a = np.array([0.01, 0.02, 0.03])
    vertices = np.vstack([np.zeros(3), np.diag(a)])
    facets = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    collider = GridCollider(lambda z: z.sum(axis=1), vertices, facets, 8, "corner")
    found = mass_properties(collider, density=6.0 / a.prod())
    pose = RigidPose.from_rotation_vector([0.3, -0.4, 0.5], [0.1, 0.2, 0.3])
    moved = mass_properties(Placed(collider, pose), density=6.0 / a.prod())
    # int x_i x_j over the simplex: a_i a_j (1 + [i = j]) / 20 of its mass; round-off.
    second = np.outer(a, a) * (1 + np.eye(3)) / 20 - np.outer(a, a) / 16
    assert found.mass == pytest.approx(1.0, rel=1e-12)
    np.testing.assert_allclose(found.centre, a / 4, rtol=1e-12)
    np.testing.assert_allclose(found.second_moment, second, atol=1e-12 * second.max())
    assert moved.mass == pytest.approx(1.0, rel=1e-12)
    np.testing.assert_allclose(moved.centre, pose.apply(a[None] / 4)[0], rtol=1e-12)
    turned = pose.rotation @ second @ pose.rotation.T
    np.testing.assert_allclose(moved.second_moment, turned, atol=1e-12 * second.max())


def test_points_cover_the_surface(dim):
    shape = Sphere(R, dim)
    points, areas = surface_points(shape)
    np.testing.assert_allclose(shape.sdf(points), 0.0, atol=1e-12)
    # Of a surface of triangles on a grid of 72 or 240 cells.
    assert areas.sum() == pytest.approx(4 * np.pi * R**2 if dim == 3 else 2 * np.pi * R, rel=1e-3)
    # Evenly: uniform pressure on all points has no net force, up to the share of one point.
    assert np.linalg.norm(areas @ points) < areas.max() * R


def test_mass_instead_of_density_and_invalid_masses():
    pose = RigidPose.identity(3)
    assert free_collider(Sphere(R), pose, mass=0.2).mass.mass == pytest.approx(0.2, rel=1e-12)
    for wrong in ({"mass": -1.0}, {"density": 0.0}, {"density": np.nan}, {"mass": 1.0, "density": 1.0}):
        with pytest.raises(SoftprintError, match="'sphere'"):
            free_collider(Sphere(R), pose, **wrong)


def test_free_flight(dim):
    """A tumbling box: linear and angular momentum to round-off; energy to second order in the step, without drift."""
    box = Box(HALF[:dim], SHARP)
    spin = [5.0] if dim == 2 else [5.0, 0.1, 0.1]  # about an unstable axis in 3D: it flips repeatedly
    start = free_collider(box, RigidPose.identity(dim), density=1e3, velocity=np.ones(dim), spin=spin)
    drift = {}
    for steps in (300, 600):
        h = 5.0 / steps
        pose, motion = start.pose, start.motion
        energies = [motion.energy(start.mass, pose)]
        for _ in range(steps):
            flight = FreeFlight(start.mass, pose, motion, h, np.zeros(dim))
            pose = flight.carried_on()
            gradient, hessian = flight.linearise(pose)
            assert np.abs(gradient).max() < 1e-9  # the minimum of the incremental potential, to round-off
            assert np.linalg.eigvalsh(hessian).min() > 0
            motion = flight.motion_at(pose)
            energies.append(motion.energy(start.mass, pose))
        # Round-off of some hundred steps.
        np.testing.assert_allclose(motion.velocity, 1.0, rtol=1e-11)
        np.testing.assert_allclose(
            motion.momentum, start.motion.momentum, atol=1e-11 * np.linalg.norm(motion.momentum)
        )
        np.testing.assert_allclose(pose.rotation.T @ pose.rotation, np.eye(dim), atol=1e-13)
        drift[steps] = np.abs(np.array(energies) / energies[0] - 1).max()
    if dim == 2:
        assert max(drift.values()) < 1e-11
        angle = np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0])
        assert np.exp(1j * angle) == pytest.approx(np.exp(25j), abs=1e-9)  # 5 rad/s for 5 s
    else:
        assert drift[300] < 1e-7
        assert drift[600] == pytest.approx(drift[300] / 4, rel=0.1)  # second order


def test_torque_changes_angular_momentum(dim):
    """With a linear rotation spring the body gains the angular momentum h T, where T is the torque of the spring."""
    start = free_collider(Box(HALF[:dim], SHARP), RigidPose.identity(dim), density=1e3)
    flight = FreeFlight(start.mass, start.pose, start.motion, 0.01, np.zeros(dim))
    turned = RigidPose.from_rotation_vector([0.1] if dim == 2 else [0.1, -0.2, 0.05], np.zeros(dim))
    torque = flight.linearise(turned)[0][dim:]
    expected = start.motion.momentum + 0.01 * torque
    found = flight.motion_at(turned)
    assert isinstance(found, RigidMotion)
    np.testing.assert_allclose(found.momentum, expected, rtol=1e-12)
    # A rotation w in one step is a spin w / h, to second order in w.
    spin = np.array([0.1] if dim == 2 else [0.1, -0.2, 0.05]) / 0.01
    np.testing.assert_allclose(found.spin(start.mass, turned), spin, atol=0.03 * np.linalg.norm(spin))
