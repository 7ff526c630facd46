"""What a tactile camera sees: nothing of rigid motions, forces that balance, markers and depths of the surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from softprint.runtime.body import assemble_body, place_handles
from softprint.runtime.colliders import KeyframedPath, RigidPose, Sphere
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.dynamics import KinematicHandle, PlacedCollider, Simulator
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.errors import SoftprintError
from softprint.runtime.inspect.kind import inspect_file
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mesh import box_mesh
from softprint.runtime.touch import TactileCamera, TouchSensor, point_places, surface_places
from softprint.runtime.touch.camera_series import draw_images, write_images

TOP, RADIUS = 0.06, 0.02  # m
STIFFNESS = 3e11  # N/m^4
IMAGE = {2: (16,), 3: (16, 12)}
MARKERS = {2: (6,), 3: (4, 3)}


def ball_at(dim, depth, along=0.0):
    return RigidPose(np.eye(dim), np.append(np.eye(dim - 1)[0] * along, TOP + RADIUS - depth))


def simulator_of(body, mechanics=None, motion=None, friction=None):
    """motion: a rigid motion of the base, from rest."""
    path = None
    if motion is not None:
        pivot = body.handles.frames[0].pivot
        shift = motion.apply(pivot[None])[0] - pivot
        path = KeyframedPath([0.0], [shift], np.atleast_2d(motion.rotation_vector))
    return Simulator(
        body,
        [PlacedCollider("ball", Sphere(RADIUS, body.dim, "ball"))],
        contact=PenaltyContact(STIFFNESS, 1),
        mechanics=mechanics,
        friction=friction,
        kinematic=[KinematicHandle("base", path)],
    )


def camera_of(source, body, **options):
    return TactileCamera(source, body, markers=MARKERS[body.dim], image=IMAGE[body.dim], **options)


@pytest.fixture(params=["bare", "mechanics"])
def mechanics(request, jelly_body):
    return None if request.param == "bare" else compute_mechanics(jelly_body, 400, True)


def test_at_rest_it_sees_nothing(jelly_body, dim) -> None:
    simulator = simulator_of(jelly_body)
    result = simulator.settle(simulator.rest_state(poses={"ball": ball_at(dim, -0.01)}))
    seen = camera_of(simulator, jelly_body).see(result)
    # To the solve, of bodies of 0.1 m.
    np.testing.assert_allclose(seen.markers, 0.0, atol=1e-8)
    np.testing.assert_allclose(seen.depth, 0.0, atol=1e-8)
    assert seen.depth.shape == IMAGE[dim][::-1]
    assert not seen.force.any()
    assert not seen.torque.any()


def test_a_rigid_motion_of_the_scene_changes_nothing(jelly_body, dim, mechanics) -> None:
    turn = [0.5] if dim == 2 else [0.3, -0.4, 0.5]
    motion = RigidPose.from_rotation_vector(turn, np.arange(1.0, dim + 1) * 0.03)
    pose = ball_at(dim, 4e-3, along=0.011)
    seen = []
    for moved in (None, motion):
        simulator = simulator_of(jelly_body, mechanics, moved)
        here = pose if moved is None else moved.compose(pose)
        state = simulator.rest_state(poses={"ball": here})
        if moved is not None:
            rows = jelly_body.rest_rows @ moved.rotation.T
            rows += np.outer(jelly_body.handles.affine_part, moved.translation)
            state = replace(state, rows=rows)
        result = simulator.settle(state)
        assert result.converged
        seen.append(camera_of(simulator, jelly_body).see(result))
    still, moved = seen
    assert np.linalg.norm(still.force) > 0.1
    # Both are solved to 1e-6 of the forces, and the compliance is in single precision.
    np.testing.assert_allclose(moved.markers, still.markers, atol=2e-5 * np.abs(still.markers).max())
    np.testing.assert_allclose(moved.depth, still.depth, atol=2e-5 * np.abs(still.depth).max())
    np.testing.assert_allclose(moved.force, still.force, atol=2e-5 * np.abs(still.force).max())
    np.testing.assert_allclose(moved.torque, still.torque, atol=2e-5 * np.abs(still.force).max() * TOP)


def test_force_and_torque_are_those_of_the_tractions(jelly_body, dim, mechanics) -> None:
    simulator = simulator_of(jelly_body, mechanics, friction=CoulombFriction(0.4))
    camera, places = camera_of(simulator, jelly_body), surface_places(jelly_body)
    sensor = TouchSensor(simulator, jelly_body, places)
    state = simulator.rest_state(poses={"ball": ball_at(dim, 0.0)})
    for step in range(1, 6):
        result = simulator.step(state, {"ball": ball_at(dim, 1e-3 * step, 5e-4 * step)})
        state = result.state
    seen, felt = camera.see(result), sensor.feel(result)
    # A sum in another order.
    np.testing.assert_allclose(
        seen.force, places.areas @ felt.traction, atol=1e-12 * np.linalg.norm(seen.force)
    )
    assert seen.force[-1] < -0.1  # pressed
    assert seen.force[0] > 0.0  # and dragged along
    # About the middle of the side; the ball presses where it is, not in the middle.
    arm = result.contacts["ball"].parts[0].points - camera.side.origin
    torque = sum(
        np.cross(part.points - camera.side.origin, -part.forces).sum(axis=0)
        for part in result.contacts["ball"].parts
    )
    np.testing.assert_allclose(seen.torque, np.atleast_1d(torque), atol=1e-12 * np.abs(arm).max())


def test_markers_move_as_the_points_that_they_are_printed_on(jelly_body, dim, mechanics) -> None:
    simulator = simulator_of(jelly_body, mechanics)
    result = simulator.settle(simulator.rest_state(poses={"ball": ball_at(dim, 5e-3)}))
    camera = camera_of(simulator, jelly_body)
    points = {str(k): np.append(place, TOP) for k, place in enumerate(camera.places)}
    sensor = TouchSensor(simulator, jelly_body, point_places(jelly_body, points))
    moved = sensor.feel(result).position - np.array(list(points.values()))
    # The pose of the back is fitted to nodes that are where they are to round-off.
    np.testing.assert_allclose(camera.see(result).markers, moved, atol=1e-10)
    assert np.abs(moved).max() > 1e-3


def block(dim, divisions=4):
    mesh = box_mesh([-0.05] * dim, [0.05] * dim, [divisions] * dim)
    material = make_material("linear", 1e4, 0.3)
    return assemble_body(mesh, place_handles(mesh, 2**dim + 1, []), material, 1000.0, name="block")


@pytest.mark.parametrize("side", ["+x", "-x", "+y", "-y", "+z", "-z"])
def test_the_depth_of_a_stretched_and_tilted_side_is_that_of_its_plane(side, dim) -> None:
    """A body without a frame, seen by a camera that stands still. Linear maps are drawn exactly."""
    if side[1] not in "xyz"[:dim]:
        return
    body = block(dim)
    simulator = Simulator(body, [], contact=PenaltyContact(1e9))
    rest = simulator.at_rest()
    camera = camera_of(simulator, body, side=side)
    axes = camera.side.axes
    np.testing.assert_allclose(np.linalg.det(axes), 1.0)
    own = np.eye(dim)  # in the frame of the side: wider along its first axis, and tilted
    own[0, 0], own[-1, 0] = 1.05, 0.2
    shift = np.zeros(dim)
    shift[-1] = -0.003
    A = axes.T @ own @ axes
    rows = body.rest_rows @ A.T + axes.T @ shift
    seen = camera.see(replace(rest, state=replace(rest.state, rows=rows)))
    columns, width = IMAGE[dim][0], camera.field[0]
    u = width * ((np.arange(columns) + 0.5) / columns - 0.5)
    # The lowest point of the plane through the middle, 0.05 m from the centre, is where u is zero.
    expected = 0.003 - 0.2 * u / 1.05
    np.testing.assert_allclose(seen.depth, np.broadcast_to(expected, seen.depth.shape), atol=1e-9)
    in_plane = camera.places[:, 0]
    np.testing.assert_allclose(seen.markers[:, 0], 0.05 * in_plane, atol=1e-9)
    np.testing.assert_allclose(seen.markers[:, -1], 0.2 * in_plane - 0.003, atol=1e-9)


def test_where_the_surface_has_gone_there_is_no_depth(dim) -> None:
    body = block(dim)
    simulator = Simulator(body, [], contact=PenaltyContact(1e9))
    rest = simulator.at_rest()
    away = np.eye(dim)[0] * 0.06
    seen = camera_of(simulator, body).see(
        replace(rest, state=replace(rest.state, rows=body.rest_rows + away))
    )
    gone = np.isnan(seen.depth)
    assert 0.4 < gone.mean() < 0.8  # moved by 0.06 m out of a picture of 0.09 m
    assert gone[..., 0].all()
    assert not gone[..., -1].any()


class Spy:
    def __init__(self, body) -> None:
        self.body = body

    def follow(self, nodes):
        self.nodes = nodes
        return lambda state: self.body.mesh.points[nodes]


def test_what_is_followed_does_not_grow_with_the_mesh(dim) -> None:
    counts = []
    for divisions in (24, 48) if dim == 2 else (6, 12):
        spy = Spy(block(dim, divisions))
        TactileCamera(spy, spy.body, markers=[2] * (dim - 1), image=[3] * (dim - 1))
        counts.append(len(spy.nodes))
    corners = (3 + 1 + 8) ** (dim - 1) + 2 ** (dim - 1)  # of pixels, the margin included, and markers
    assert max(counts) <= dim * corners


def test_a_dent_is_as_deep_as_the_ball(jelly3d_body) -> None:
    mechanics = compute_mechanics(jelly3d_body, 400, True)
    simulator = simulator_of(jelly3d_body, mechanics)
    result = simulator.settle(simulator.rest_state(poses={"ball": ball_at(3, 6e-3)}))
    camera = TactileCamera(simulator, jelly3d_body, image=(45, 45), markers=(3, 3))
    seen = camera.see(result)
    row, column = np.unravel_index(seen.depth.argmax(), seen.depth.shape)
    # Facets are 20 mm long, so a dent by forces at their corners is blunt: it is where the ball is, and nearly as deep.
    assert abs(row - 22) <= 5
    assert abs(column - 22) <= 5
    assert seen.depth.max() == pytest.approx(6e-3 - result.penetration, rel=0.25)
    # Upright but for the cells, which are not symmetric.
    np.testing.assert_allclose(seen.force[:2], 0.0, atol=0.1 * abs(seen.force[2]))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"side": "up"}, r"side 'up': the sides of a body in 3D are \+x, -x"),
        ({"markers": (3,)}, r"markers \[3\]: must be 2 whole"),
        ({"markers": (3, 0)}, r"markers \[3, 0\]"),
        ({"image": (3.5, 2)}, r"pixels \[3.5, 2.0\]"),
        ({"image": (100000, 2)}, "from 1 to 4096"),
        ({"field": (0.2, 0.1)}, "no larger than the side, 0.1 x 0.1 m"),
        ({"field": (float("nan"), 0.1)}, "field of view"),
        ({"frame": "bone"}, "the body has no frame 'bone'; its frames: base"),
    ],
)
def test_what_does_not_fit_is_refused(jelly3d_body, options, words) -> None:
    with pytest.raises(SoftprintError, match=words):
        TactileCamera(Spy(jelly3d_body), jelly3d_body, **options)


def test_series_are_written_with_units_and_drawn(jelly_body, dim, tmp_path) -> None:
    simulator = simulator_of(jelly_body)
    camera = camera_of(simulator, jelly_body)
    state, images = simulator.rest_state(poses={"ball": ball_at(dim, 0.0)}), []
    for step in range(4):
        result = simulator.step(state, {"ball": ball_at(dim, 1e-3 * step)})
        state = result.state
        images.append(camera.see(result))
    texts = {"scene": "s", "model": "bare", "body_hash": "0", "experiment": ""}
    write_images(tmp_path / "a.h5", camera, images, **texts)
    text = inspect_file(tmp_path / "a.h5").as_text()
    assert "what a tactile camera sees" in text
    assert "s, bare" in text
    import h5py

    with h5py.File(tmp_path / "a.h5") as file:
        assert file["depth"].attrs["unit"] == b"m"
        assert file["torque"].attrs["unit"] == b"N m"
        assert file["markers"].shape == (4, len(camera.places), dim)
        np.testing.assert_allclose(file["depth"][-1], images[-1].depth, rtol=1e-6, atol=1e-9)
    draw_images(tmp_path / "a.png", "s", camera, {"bare": images, "again": images})
    assert (tmp_path / "a.png").stat().st_size > 10000
