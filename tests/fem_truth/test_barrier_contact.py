"""Contact by a barrier: derivatives, and motions in which nothing passes through."""

from __future__ import annotations

import importlib
import json
import sys
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import trimesh

from softprint.fem_truth.dynamics.collision_free_way import CollisionFreeWay
from softprint.fem_truth.dynamics.full_space_simulator import FullSpaceSimulator
from softprint.fem_truth.energy.barrier_contact import BarrierContact, BarrierLaw, CollisionSurfaces
from softprint.fem_truth.linalg.block_matrix import BlockMatrix, BlockPattern, UpperBlocks
from softprint.runtime.colliders import Box, Plane, RigidPose, Sphere, mesh_collider
from softprint.runtime.colliders.surface_points import surface_points
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.contact.intrusion import intrusion
from softprint.runtime.dynamics import DynamicsSettings, KinematicHandle, NewtonSettings, PlacedCollider
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import box_mesh
from softprint.runtime.rigid import free_collider
from softprint.runtime.scenes.motion_file import load_motion
from softprint.runtime.scenes.simulate import motion_path
from tests.toy_experiment import write_experiment

DISTANCE = 1e-3  # m
LAW = BarrierLaw(DISTANCE, 1e5)
EDGE = 0.1  # m, of the block


@pytest.fixture
def near(dim):
    """A block with a ball half the distance above its top, shaken so that no closest pair is special."""
    mesh = box_mesh([0.0] * dim, [EDGE] * dim, [5] * dim)
    ball = Sphere(0.02, dim, "ball")
    centre = np.full(dim, 0.47 * EDGE)
    centre[-1] = EDGE + 0.02 + 0.5 * DISTANCE
    x = mesh.points + 2e-5 * np.random.default_rng(0).standard_normal(mesh.points.shape)
    surfaces = CollisionSurfaces(mesh, ball, LAW)
    return mesh, surfaces, RigidPose(np.eye(dim), centre), x


def empty_matrix(n, dim):
    pattern, _ = BlockPattern.from_pairs(np.empty((0, 2), dtype=np.int64), n)
    return BlockMatrix(UpperBlocks(pattern, np.zeros((1, dim, dim))), np.zeros((n, dim, dim)))


def test_gradient_is_the_derivative_of_the_energy(near):
    _, surfaces, pose, x = near
    contact = BarrierContact(surfaces, pose, x)
    direction, step = np.random.default_rng(1).standard_normal(x.shape), 1e-7
    rise = contact.energy(x + step * direction) - contact.energy(x - step * direction)
    slope = float(np.vdot(contact.gradient(x), direction))
    assert contact.energy(x) > 0.0
    # Central differences: step^2 / distance^2, with a few derivatives of the logarithm.
    assert rise / (2 * step) == pytest.approx(slope, rel=1e-5)


def test_hessian_is_that_of_the_energy_and_more_where_that_is_negative(near, dim):
    """The Hessian less that by finite differences is positive, and so is the Hessian."""
    _, surfaces, pose, x = near
    contact = BarrierContact(surfaces, pose, x)
    nodes, step = contact.touched(x), 1e-8
    matrix = empty_matrix(len(x), dim)
    contact.add_hessian(x, matrix, convex=False)
    columns, products = [], []
    for node in nodes:
        for axis in range(dim):
            unit = np.zeros_like(x)
            unit[node, axis] = 1.0
            change = contact.gradient(x + step * unit) - contact.gradient(x - step * unit)
            columns.append((change[nodes] / (2 * step)).ravel())
            products.append(matrix.apply(unit)[nodes].ravel())
    exact, found = np.array(columns), np.array(products)
    scale = np.abs(found).max()
    np.testing.assert_allclose(found, found.T, atol=1e-12 * scale)
    assert np.linalg.eigvalsh(found).min() > -1e-9 * scale
    # Differences of gradients: right to step / distance.
    assert np.linalg.eigvalsh(found - 0.5 * (exact + exact.T)).min() > -1e-4 * scale
    # Along the approach the energy is convex, and nothing is added.
    up = np.tile(np.eye(dim)[-1], len(nodes))
    assert up @ found @ up == pytest.approx(up @ exact @ up, rel=0.3)


def test_action_is_reaction(near, dim):
    """The sum of the forces on the nodes is the derivative of the energy by the position of the ball."""
    _, surfaces, pose, x = near
    up, step = np.eye(dim)[-1], 1e-8
    energies = [
        BarrierContact(surfaces, RigidPose(pose.rotation, pose.translation + k * step * up), x).energy(x)
        for k in (1, -1)
    ]
    by_ball = (energies[0] - energies[1]) / (2 * step)
    assert by_ball == pytest.approx(-BarrierContact(surfaces, pose, x).gradient(x)[:, -1].sum(), rel=1e-5)


def test_beyond_the_distance_there_is_nothing(near):
    mesh, surfaces, pose, _ = near
    away = RigidPose(pose.rotation, pose.translation + DISTANCE * np.eye(mesh.dim)[-1])
    contact = BarrierContact(surfaces, away, mesh.points)
    assert contact.energy(mesh.points) == 0.0
    assert not contact.gradient(mesh.points).any()
    assert not len(contact.touched(mesh.points))


def test_positions_behind_a_collision_have_no_finite_energy(near, dim):
    """Though they do not intersect: the whole block has passed the ball."""
    _, surfaces, pose, x = near
    contact = BarrierContact(surfaces, pose, x)
    behind = x + 3.0 * EDGE * np.eye(dim)[-1]
    assert contact.energy(behind) == np.inf
    contact.accepted(behind)
    assert contact.energy(behind) == 0.0


def test_a_way_ends_before_a_collision_and_goes_on_from_there(near, dim):
    _, surfaces, pose, x = near
    inside = {"ball": RigidPose(pose.rotation, pose.translation - 0.01 * np.eye(dim)[-1])}
    way = CollisionFreeWay({"ball": surfaces}, x, {"ball": pose})
    arrived, reached = way.advance(x, x, inside)
    assert not arrived
    moved = pose.translation[-1] - way.poses["ball"].translation[-1]
    assert 0.2 * DISTANCE < moved < 0.6 * DISTANCE  # some of half the distance
    np.testing.assert_array_equal(reached, x)
    # A body that gives way as fast as the ball comes lets it arrive.
    arrived, _ = way.advance(x - 0.02 * np.eye(dim)[-1], x, inside)
    assert arrived


def test_an_intersection_at_the_start_is_refused(near, dim):
    _, surfaces, pose, x = near
    inside = RigidPose(pose.rotation, pose.translation - 0.01 * np.eye(dim)[-1])
    with pytest.raises(SoftprintError, match="'ball' intersects the body at the start"):
        surfaces.require_apart(x, inside)


@pytest.fixture
def plate_on_block(dim, jelly_body):
    """Presses a plate edge-on into the block, thinner than a third of the distance between nodes, 2 mm a step."""
    half = np.array([0.0015, 0.015] if dim == 2 else [0.03, 0.003, 0.015])
    solid = trimesh.creation.box(2.0 * half) if dim == 3 else None
    plate = Box(half, name="plate") if dim == 2 else mesh_collider(solid.vertices, solid.faces, 48, "plate")
    settings = DynamicsSettings(0.02, NewtonSettings(max_iterations=60, tolerance=1e-4))

    def press(barrier):
        simulator = FullSpaceSimulator(
            jelly_body,
            [PlacedCollider("plate", plate)],
            contact=PenaltyContact(1e10, refinement=0),
            kinematic=[KinematicHandle("base")],
            settings=settings,
            barrier=barrier,
        )
        aside = np.zeros(dim - 1)  # between nodes
        top = jelly_body.mesh.points[:, -1].max() + half[-1]
        state = simulator.rest_state(poses={"plate": RigidPose(np.eye(dim), np.append(aside, top + 1e-3))})
        for depth in (0.0, 2e-3, 4e-3, 6e-3):
            result = simulator.step(state, {"plate": RigidPose(np.eye(dim), np.append(aside, top - depth))})
            state = result.state
            inside = intrusion(state.poses["plate"].apply(surface_points(plate)), jelly_body.mesh, state.x)
            yield result, inside.depth

    return press


def test_a_plate_does_not_cut_into_a_body(plate_on_block):
    results = list(plate_on_block(LAW))
    for result, inside in results:
        assert result.converged, result.reason
        assert inside == 0.0
    forces = [result.contacts["plate"].force[-1] for result, _ in results]
    assert all(later > earlier for earlier, later in pairwise(forces))


def test_the_penalty_at_nodes_lets_the_same_plate_in(plate_on_block):
    *_, (result, inside) = plate_on_block(None)
    assert inside > 5e-3
    assert result.contacts["plate"].force[-1] < 0.01


def test_a_collider_that_moves_freely_is_refused(jelly_body, dim):
    ball = Sphere(0.01, dim, "ball")
    pose = RigidPose(np.eye(dim), 0.2 * np.eye(dim)[-1])
    free = PlacedCollider("ball", ball, free=free_collider(ball, pose, density=1e3))
    with pytest.raises(
        SoftprintError, match="'ball' moves freely, which contact by a barrier cannot simulate"
    ):
        FullSpaceSimulator(jelly_body, [free], contact=PenaltyContact(1e10), barrier=LAW)


def test_friction_and_half_spaces_are_refused(jelly_body, dim):
    ball = PlacedCollider("ball", Sphere(0.02, dim))
    with pytest.raises(SoftprintError, match="without friction"):
        FullSpaceSimulator(
            jelly_body, [ball], contact=PenaltyContact(1e10), friction=CoulombFriction(0.3), barrier=LAW
        )
    floor = replace(ball, collider=Plane(np.eye(dim)[-1]))
    with pytest.raises(SoftprintError, match="has no bounds"):
        FullSpaceSimulator(jelly_body, [floor], contact=PenaltyContact(1e10), barrier=LAW)


def test_a_distance_suits_the_mesh(jelly_body):
    assert BarrierLaw.of(None, jelly_body.mesh, 2e4).distance < 0.05 * jelly_body.mesh.surface_spacing
    assert BarrierLaw.of(2e-4, jelly_body.mesh, 2e4) == BarrierLaw(2e-4, 1e5)


def test_a_scene_is_played_with_a_barrier_and_truth_is_not_generated(softprint_here, tmp_path):
    experiment, run = write_experiment(tmp_path, 3), tmp_path / "run"
    options = ("--out", run, "--quiet", "--set", "contact.model='barrier'", "--set", "contact.friction=0")
    done = softprint_here("body", experiment, *options)
    assert done.returncode == 0, done.stderr
    played = softprint_here("simulate", experiment, *options, "--model", "full")
    assert played.returncode == 0, played.stderr
    motion = load_motion(motion_path(run, "held_out", "full"))
    assert motion.converged.all()
    assert motion.colliders["ball"].force[-1][2] > 0.05
    assert not motion.colliders["ball"].intrusion.any()
    # Contact is told by forces: nothing penetrates.
    reported = softprint_here("report", experiment, *options, "--no-pictures")
    assert reported.returncode == 0, reported.stderr
    (scene,) = json.loads((run / "report.json").read_text())["scenes"]
    assert scene["n_contact"] == motion.in_contact.sum() > 0
    refused = softprint_here("generate", experiment, *options)
    assert refused.returncode == 1
    assert "reference samples are solved with a penalty" in refused.stderr
    assert not (run / "truth.h5").exists()


def test_a_missing_toolkit_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "ipctk", None)
    monkeypatch.delitem(sys.modules, BarrierContact.__module__)
    with pytest.raises(SoftprintError, match=r"pip install 'softprint\[barrier\]'"):
        importlib.import_module(BarrierContact.__module__)
