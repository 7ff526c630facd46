"""The condensed energy of contact: derivatives by finite differences, resultants, and what steps make of it."""

import numpy as np
import pytest

from runtime.colliders import RigidPose, Sphere
from runtime.contact import PenaltyContact
from runtime.corrections.compliance import compute_compliance
from runtime.corrections.contact_loads import LoadProbe
from runtime.corrections.contact_potential import ContactPotential
from runtime.dynamics.condensed_contact import CondensedContact

STIFFNESS = 1e10  # N/m^4
BAND = 2e-3  # m


@pytest.fixture
def pressed(jelly_body, dim):
    """A potential, rows of a strained body and the pose of a ball that is 6 mm deep in its top."""
    ball = Sphere(0.02, dim, "ball")
    compliance = compute_compliance(jelly_body, at_most=400)
    probe = LoadProbe(jelly_body, ball, compliance, STIFFNESS, BAND)
    points = jelly_body.node_points(compliance.nodes)
    rng = np.random.default_rng(5)
    rows = jelly_body.rest_rows + 1e-3 * rng.normal(size=jelly_body.rest_rows.shape)
    turned = [0.3] if dim == 2 else [0.3, -0.2, 0.5]
    pose = RigidPose.from_rotation_vector(turned, np.append(np.full(dim - 1, 0.004), 0.06 + 0.02 - 0.006))
    return ContactPotential(probe, points.basis, points.basis_gradient), rows, pose


def test_derivatives(pressed):
    potential, rows, pose = pressed
    turn = np.eye(rows.shape[1])
    energy, gradient, hessian = potential.linearise(rows, pose, turn)
    assert energy > 0
    rng = np.random.default_rng(0)
    for _ in range(3):
        way, h = rng.normal(size=rows.shape), 1e-7
        ahead, behind = rows + h * way, rows - h * way
        slope = (potential.energy(ahead, pose, turn) - potential.energy(behind, pose, turn)) / (2 * h)
        # Central differences over 1e-7 m of an energy solved to 1e-10: a part in a million.
        assert slope == pytest.approx(np.vdot(gradient, way), rel=1e-5)
        change = (potential.linearise(ahead, pose, turn)[1] - potential.linearise(behind, pose, turn)[1]) / (
            2 * h
        )
        found = (hessian @ way.ravel()).reshape(rows.shape)
        # The third derivative of the distance is itself a difference, over a thousandth of the dent.
        assert np.abs(found - change).max() < 2e-3 * np.abs(change).max()


def test_the_force_on_the_collider_is_the_slope_of_the_energy_along_its_path(pressed, dim):
    potential, rows, pose = pressed
    turn = np.eye(dim)
    contact = CondensedContact({"ball": potential})
    force = contact.forces(rows, {"ball": pose}, turn)["ball"].force
    h = 1e-7
    for axis in np.eye(dim):
        moved = [RigidPose(pose.rotation, pose.translation + side * h * axis) for side in (1, -1)]
        slope = (potential.energy(rows, moved[0], turn) - potential.energy(rows, moved[1], turn)) / (2 * h)
        # Central differences over 1e-7 m, as above.
        assert -slope == pytest.approx(force @ axis, abs=1e-5 * np.linalg.norm(force))


def test_giving_way_costs_less_than_standing_firm(pressed, jelly_body):
    potential, rows, pose = pressed
    probe = potential._probe
    x = jelly_body.basis[probe.compliance.nodes] @ rows
    rigid = PenaltyContact(STIFFNESS).energy(x, probe.compliance.areas, probe.collider, pose)
    assert 0 < potential.energy(rows, pose, np.eye(jelly_body.dim)) < rigid


def test_nothing_out_of_contact(pressed):
    potential, rows, pose = pressed
    away = RigidPose(pose.rotation, pose.translation + 0.02)
    energy, gradient, hessian = potential.linearise(rows, away, np.eye(len(away.translation)))
    assert energy == 0.0
    assert not gradient.any()
    assert hessian is None


def test_moving_body_and_collider_together_changes_nothing(pressed, jelly_body, dim):
    potential, rows, pose = pressed
    motion = RigidPose.from_rotation_vector([0.7] if dim == 2 else [0.2, 0.7, -0.4], 0.1 * np.ones(dim))
    linear = np.ones(len(rows))
    linear[jelly_body.handles.n_points :] = np.tile(
        np.append(np.zeros(dim), 1.0), len(jelly_body.handles.frames)
    )
    moved = rows @ motion.rotation.T + linear[:, None] * motion.translation
    energy, gradient, _ = potential.linearise(rows, pose, np.eye(dim))
    again, turned, _ = potential.linearise(moved, motion.compose(pose), motion.rotation)
    # Round-off of the signed distance, amplified by the stiffness of contact.
    assert again == pytest.approx(energy, rel=1e-8)
    assert np.abs(turned - gradient @ motion.rotation.T).max() < 1e-6 * np.abs(gradient).max()
