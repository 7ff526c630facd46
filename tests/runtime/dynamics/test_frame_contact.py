"""Contact of rigid frames: where their points are, derivatives, balance of forces, and a bone that nothing passes."""

import numpy as np
import pytest

from softprint.runtime.body import assemble_body, frame_in_box, place_handles
from softprint.runtime.colliders import KeyframedPath, RigidPose, Sphere
from softprint.runtime.colliders.pose import rotation_matrix
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.contact_force import ContactForce
from softprint.runtime.contact.frame_points import FramePoints, outside_points
from softprint.runtime.dynamics import DynamicsSettings, KinematicHandle, PlacedCollider, Simulator
from softprint.runtime.dynamics.terms.frame_contact import FrameContact
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mesh import box_mesh

LAW = PenaltyContact(1e12, 2)
RADIUS, TOP, BONE = 0.008, 0.03, 0.01  # m: of the ball, and the tops of block and bone
CELL = 0.005  # m


@pytest.fixture(scope="module", params=[2, 3], ids=["2d", "3d"])
def body(request):
    """A block with a bone as wide as two cells on its base."""
    dim = request.param
    mesh = box_mesh([-0.02] * (dim - 1) + [0.0], [0.02] * (dim - 1) + [TOP], [8] * (dim - 1) + [6])
    wide = [CELL + 1e-6] * (dim - 1)
    bone = frame_in_box(mesh, "bone", [[-w for w in wide] + [-1.0], [*wide, BONE + 1e-6]])
    return assemble_body(
        mesh, place_handles(mesh, 6, [bone]), make_material("stable_neo_hookean", 2e4, 0.4), 1000.0
    )


def ball(body):
    return {"ball": Sphere(RADIUS, body.dim, "ball")}


def pose(body, depth):
    """The ball above the bone, that deep in it, a little aside."""
    return RigidPose(np.eye(body.dim), np.append(np.full(body.dim - 1, 0.001), BONE + RADIUS - depth))


def bent_rows(body):
    """A bone that is moved and turned by a little, and strained, as an unknown of Newton's method may be."""
    return body.rest_rows + 1e-3 * np.random.default_rng(0).standard_normal(body.rest_rows.shape) * np.where(
        body.handles.affine_part, 1.0, 10.0
    ).reshape(-1, 1)


def test_points_cover_the_outside_of_a_bone(body):
    mesh, frame = body.mesh, body.handles.frames[0]
    spacing = CELL / 3.0
    points, areas = outside_points(mesh, frame.nodes, spacing)
    assert len(np.unique(points.round(9), axis=0)) == len(points)
    # A box of two cells across and two high.
    high, wide = points[:, -1], np.abs(points[:, :-1]).max(axis=1)
    on_side, on_end = np.isclose(wide, CELL), np.isclose(high, 0.0) | np.isclose(high, BONE)
    assert (on_side | on_end).all()
    # Any place on the top is that near to one of them: diagonals of squares are longer than their sides.
    top = points[np.isclose(high, BONE)]
    rng = np.random.default_rng(0)
    places = np.column_stack([rng.uniform(-CELL, CELL, (200, mesh.dim - 1)), np.full(200, BONE)])
    nearest = np.linalg.norm(places[:, None] - top[None], axis=2).min(axis=1)
    assert nearest.max() < np.sqrt(mesh.dim) / 2.0 * spacing * 1.01
    # They stand for its area: two ends, and sides that are as high as they are wide.
    across = (2.0 * CELL) ** (mesh.dim - 1)
    assert areas.sum() == pytest.approx(2 * mesh.dim * across, rel=1e-12)
    assert areas[np.isclose(high, BONE) & (wide < 0.9 * CELL)].sum() == pytest.approx(across, rel=0.35)


def test_which_colliders_press_a_bone(body):
    points, (sphere,) = FramePoints.of(body, CELL / 3.0), ball(body).values()
    for depth, presses in ((0.002, True), (-0.0005, False)):
        assert points.any_inside(body.rest_rows, sphere, pose(body, depth)) == presses


def test_a_bone_of_single_nodes_is_a_chain():
    mesh = box_mesh([0.0, 0.0, 0.0], [4 * CELL] * 3, [4, 4, 4])
    line = np.flatnonzero(np.isclose(mesh.points[:, :2], 2 * CELL).all(axis=1))
    points, areas = outside_points(mesh, line, 0.26 * CELL)
    # Four edges of four parts each.
    np.testing.assert_allclose(np.sort(points[:, 2]), CELL / 4.0 * np.arange(17), atol=1e-12)
    np.testing.assert_allclose(points[:, :2], 2 * CELL, atol=1e-12)
    np.testing.assert_array_equal(areas, (0.26 * CELL) ** 2)  # no facet


def test_derivatives(body):
    contact, at = FrameContact(body, ball(body), LAW), pose(body, 0.002)
    rows, poses = bent_rows(body), {"ball": at}
    here = contact.at(rows, poses)
    gradient, hessian, couplings = here.linearise({"ball": at.translation})
    assert here.energy > 0.0
    rng = np.random.default_rng(1)
    for _ in range(3):
        d, h = rng.standard_normal(rows.shape), 1e-7
        ahead, behind = (contact.at(rows + side * h * d, poses) for side in (1, -1))
        # Central differences over 1e-7 m of a cubic energy with depths of some 1e-3 m.
        slope = (ahead.energy - behind.energy) / (2 * h)
        assert slope == pytest.approx(np.vdot(gradient, d), rel=1e-5)
        change = (ahead.linearise({})[0] - behind.linearise({})[0]) / (2 * h)
        found = (hessian @ d.ravel()).reshape(rows.shape)
        np.testing.assert_allclose(found, change, atol=1e-5 * np.abs(change).max())
    (coupling,) = couplings
    mixed, own = coupling.blocks()
    for axis, step in enumerate(1e-7 * np.eye(body.dim)):
        moved = [
            contact.at(rows, {"ball": RigidPose(at.rotation, at.translation + side * step)})
            for side in (1, -1)
        ]
        slope = (moved[0].energy - moved[1].energy) / 2e-7
        assert coupling.gradient[axis] == pytest.approx(
            slope, rel=1e-5, abs=1e-5 * np.abs(coupling.gradient).max()
        )
        change = (moved[0].linearise({})[0] - moved[1].linearise({})[0]).ravel() / 2e-7
        np.testing.assert_allclose(mixed[:, axis], change, atol=1e-5 * np.abs(change).max())
        again = [one.linearise({"ball": at.translation})[2][0].gradient[: body.dim] for one in moved]
        np.testing.assert_allclose(
            own[: body.dim, axis], (again[0] - again[1]) / 2e-7, atol=1e-5 * np.abs(own).max()
        )


def test_moving_everything_changes_nothing_and_forces_balance(body):
    contact, at, rows = FrameContact(body, ball(body), LAW), pose(body, 0.002), body.rest_rows
    motion = RigidPose(
        rotation_matrix([0.7] if body.dim == 2 else [0.2, 0.7, -0.4], body.dim), np.full(body.dim, 0.1)
    )
    moved_rows = rows @ motion.rotation.T + np.outer(body.handles.affine_part, motion.translation)
    here, moved = (
        contact.at(own, {"ball": own_pose})
        for own, own_pose in ((rows, at), (moved_rows, motion.compose(at)))
    )
    assert moved.energy == pytest.approx(here.energy, rel=1e-9)  # round-off of depths of 2 mm in 0.1 m
    gradient = here.linearise({})[0]
    np.testing.assert_allclose(
        moved.linearise({})[0], gradient @ motion.rotation.T, atol=1e-8 * np.abs(gradient).max()
    )
    # What pushes the collider pushes the body the other way.
    touched = here.touched["ball"]
    nothing = ContactForce(np.zeros(body.dim), np.zeros(1 if body.dim == 2 else 3), 0.0, 0)
    force = here.added_to({"ball": nothing})["ball"].force
    np.testing.assert_allclose(force, touched.terms.gradient.sum(axis=0), rtol=1e-12)
    np.testing.assert_allclose((body.handles.affine_part[:, None] * gradient).sum(axis=0), force, rtol=1e-12)


def test_far_colliders_are_not_looked_at(body):
    away = FrameContact(body, ball(body), LAW).at(body.rest_rows, {"ball": pose(body, -0.05)})
    assert away.touched == {}
    assert away.energy == 0.0
    gradient, hessian, couplings = away.linearise({})
    assert not gradient.any()
    assert hessian is None
    assert couplings == []


def test_nothing_passes_through_a_bone(body):
    """A ball is pressed 4 mm deep into the bone. Flesh that gives way linearly would let it, at a force that grows ever
    more slowly; the bone does not, and bears nearly all of it."""
    mechanics = compute_mechanics(body, 400, condensation=False)
    end, step = RADIUS + BONE - 0.004, 0.01
    way = KeyframedPath(
        [0.0, 0.5], [np.append(np.zeros(body.dim - 1), high) for high in (TOP + RADIUS + 0.001, end)]
    )
    simulator = Simulator(
        body,
        [PlacedCollider("ball", ball(body)["ball"], way)],
        contact=LAW,
        mechanics=mechanics,
        kinematic=[KinematicHandle("bone")],
        settings=DynamicsSettings(step),
    )
    state, found = simulator.rest_state(), []
    for _ in range(int(0.5 / step) + 1):
        result = simulator.step(state)
        state = result.state
        found.append((state.poses["ball"].translation[-1] - RADIUS, result.contacts["ball"].force[-1]))
    low, force = np.array(found).T
    above, inside = force[low > BONE].max(), force[-1]
    assert inside > 20.0 * above
