"""Sharp colliders pressed into reduced bodies: what they press, how they bear, and that they do not go in."""

from __future__ import annotations

import numpy as np
import pytest

from softprint.runtime.body import assemble_body, frame_in_box, place_handles
from softprint.runtime.colliders import Box, Capsule, KeyframedPath, RigidPose, Sphere
from softprint.runtime.colliders.sharp_points import bearing_normals, sharp_points
from softprint.runtime.colliders.surface_points import surface_points
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.contact.condensed.condensed_friction import CondensedFriction
from softprint.runtime.contact.intrusion import intrusion
from softprint.runtime.contact.lagged_friction import SlipStart
from softprint.runtime.contact.solver.sharp_search import Dent
from softprint.runtime.dynamics import DynamicsSettings, KinematicHandle, PlacedCollider, Simulator
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mesh.box import box_mesh

TOP, DEPTH = 0.06, 0.006  # m, of the block; of the edge below it
STIFFNESS = 3e11  # N/m^4
THIN = 0.001  # m, half of the plate's thickness: a sixth of the distance between nodes


@pytest.fixture(scope="module")
def bodies():
    """{dim: (body, its mechanics)}: blocks whose surface nodes are some 6 mm apart."""
    return {dim: block(dim) for dim in (2, 3)}


def block(dim):
    mesh = box_mesh([-0.03] * (dim - 1) + [0.0], [0.03] * (dim - 1) + [TOP], [10] * (dim - 1) + [8])
    slab = [[-1.0] * dim, [1.0] * (dim - 1) + [0.009]]
    handles = place_handles(mesh, 6, [frame_in_box(mesh, "base", slab)])
    body = assemble_body(mesh, handles, make_material("stable_neo_hookean", 2e4, 0.4), 1000.0, name="block")
    return body, compute_mechanics(body, 1000, True)


def plate(dim):
    return Box([THIN, *[0.02] * (dim - 1)], 2e-4, "plate")


def upright(dim, depth=DEPTH, at=0.0023):
    """Its lower edge that deep below the top; between nodes."""
    return RigidPose(np.eye(dim), np.append(np.full(dim - 1, at), TOP + 0.02 - depth))


def follow(contact, body, poses):
    """The evaluations along poses of the plate, each from the one before."""
    rows, warm_start = body.rest_rows, None
    for pose in poses:
        found = contact.evaluate(contact.in_frame(rows), rows, {"plate": pose}, warm_start)
        warm_start = found.warm_start
        yield found


def pressed(bodies, dim, law, depths):
    body, mechanics = bodies[dim]
    contact = CondensedContact.of(body, mechanics, {"plate": plate(dim)}, law)
    return body, list(follow(contact, body, [upright(dim, depth) for depth in depths]))


def test_an_edge_thinner_than_a_facet_is_held(bodies, dim):
    """Its force grows with the depth, and the surface below it gives way by nearly the depth."""
    depths = np.linspace(0.0, DEPTH, 13)[1:]
    law = PenaltyContact(STIFFNESS, 2)
    _, found = pressed(bodies, dim, law, depths)
    force = np.array([one.forces()["plate"].force[-1] for one in found])
    assert all(one.converged for one in found)
    assert (np.diff(force) > 0.0).all()
    # Linear elasticity and a penalty: nearly proportional to the depth.
    assert force[-1] == pytest.approx(2.0 * force[5], rel=0.25)
    solved = found[-1].solved
    below = solved.is_pressed
    assert below.any()
    given = -solved.solution.displacement[solved.solution.active[below]][:, -1]
    assert (
        given.max() > 0.85 * DEPTH
    )  # the rest is penetration, the square root of the pressure over the stiffness
    # Points of the body alone hold a tenth of that at most: those in the plate are pushed out of its sides.
    at_nodes = PenaltyContact(STIFFNESS, refinement=0)
    nodes = pressed(bodies, dim, at_nodes, depths)[1][-1].forces()["plate"].force[-1]
    assert nodes < 0.1 * force[-1]


def deepest_of(body, mechanics, collider, path, law):
    """How deep points of the collider go into the body along a path, found by the cells of the deformed body, and how
    many of the 48 steps do not converge."""
    simulator = Simulator(
        body,
        [PlacedCollider(collider.name, collider, path)],
        contact=law,
        mechanics=mechanics,
        kinematic=[KinematicHandle("base")],
        settings=DynamicsSettings(1.0 / 60.0),
    )
    points, state, deepest, unconverged = surface_points(collider), simulator.rest_state(), 0.0, 0
    for _ in range(48):
        result = simulator.step(state)
        state, unconverged = result.state, unconverged + (not result.converged)
        around = state.poses[collider.name].apply(points)
        deepest = max(deepest, intrusion(around, body.mesh, simulator.positions(state)).depth)
    return deepest, unconverged


def lowered(dim, radius, at):
    """The path of a ball that is pressed in to the depth in half a second, and held."""
    end = np.append(np.full(dim - 1, at), TOP + radius - DEPTH)
    return KeyframedPath([0.0, 0.5, 0.8], [end + 0.008 * np.eye(dim)[-1], end, end])


def test_the_edge_does_not_go_into_the_body(bodies, dim):
    """Dragged sideways."""
    start, end = upright(dim).translation, upright(dim, at=0.0123).translation
    above = start + 0.008 * np.eye(dim)[-1]
    path = KeyframedPath([0.0, 0.3, 0.8], [above, start, end])
    deepest, unconverged = deepest_of(*bodies[dim], plate(dim), path, PenaltyContact(STIFFNESS, 2))
    # A point of a facet that the edge comes to is first nearest to its face, and then to its side: a jump, at which a
    # step may end without convergence. It says so, and is not pierced.
    assert unconverged <= 8
    # A third of the depth, and of the distance between nodes, in the one step of a jump, a fifth in all others; in
    # full space 0.15 in 2D and 0.19 in 3D.
    assert 0.0 < deepest < 0.35 * DEPTH


@pytest.mark.parametrize("radius", [0.0036, 0.0045, 0.006])
@pytest.mark.parametrize("at", [0.0, 0.0023])
def test_a_ball_that_fits_between_contact_points_does_not_go_into_the_body(bodies, dim, radius, at):
    """Where all nodes are contact nodes, some 6 mm apart, with the middles of facets alone and without sharp points on
    the ball it goes in by more than it is pressed, with steps that converge."""
    path = lowered(dim, radius, at)
    deepest, unconverged = deepest_of(*bodies[dim], Sphere(radius, dim), path, PenaltyContact(STIFFNESS, 2))
    assert unconverged == 0
    assert deepest < 0.3 * DEPTH  # half of the radius, between points of a surface that is stretched


@pytest.mark.parametrize("radius", [0.0042, 0.005, 0.006, 0.007])
def test_a_blunt_tip_does_not_slip_through_the_surface_that_it_stretches(bodies, dim, radius):
    """A round tip wider than the gaps between contact points at rest, pressed in by several times its radius. Its dent
    stretches the facets below it to three times their length; with contact points alone it slips through at half of the
    depth or before, and the force ends."""
    (body, mechanics), up = bodies[dim], np.eye(dim)[-1]
    tip = Capsule(np.zeros(dim), 0.05 * up, radius, "tip")
    contact = CondensedContact.of(body, mechanics, {"tip": tip}, PenaltyContact(STIFFNESS, 2))
    rows, warm_start, force, share = body.rest_rows, None, [], []
    for depth in np.linspace(0.0, 0.024, 49)[1:]:
        pose = RigidPose(np.eye(dim), np.append(np.full(dim - 1, 0.0023), TOP + radius - depth))
        found = contact.evaluate(contact.in_frame(rows), rows, {"tip": pose}, warm_start)
        warm_start = found.warm_start
        assert found.converged
        force.append(found.forces()["tip"].force[-1])
        share.append(0.0 if found.solved.pressed is None else found.solved.pressed.area_share.max())
    # Sharp points take over where contact points slide off its sides, by and by.
    assert share[3] == 0.0
    assert 0.2 < share[-1] <= 1.0
    assert np.diff(share).max() < 0.25
    # So the force grows, without a jump: 6 % at most.
    assert (np.diff(force) > -0.1 * force[-1]).all()
    assert force[-1] > 1.5 * force[23]


def test_what_fits_between_few_contact_nodes_does_not_go_into_the_body(bodies, dim):
    """A round tip that nodes of the surface feel, and the fewer contact nodes do not."""
    body, _ = bodies[dim]
    few = compute_mechanics(body, 9 if dim == 2 else 100, True)  # a third of the nodes, and a quarter
    path, law = lowered(dim, 0.004, 0.0023), PenaltyContact(STIFFNESS, 2)
    deepest, unconverged = deepest_of(body, few, Sphere(0.004, dim), path, law)
    assert unconverged == 0
    assert 0.0 < deepest < 0.3 * DEPTH


def test_without_a_dent_the_nearest_point_is_pressed(bodies, dim):
    body, mechanics = bodies[dim]
    law, rows = PenaltyContact(STIFFNESS, 2), body.rest_rows
    contact = CondensedContact.of(body, mechanics, {"plate": plate(dim)}, law)
    pose = upright(dim, 0.002)
    solved = contact.evaluate(contact.in_frame(rows), rows, {"plate": pose}, None).solved
    at = solved.pressed
    rest = (at.weights[..., None] * body.mesh.points[at.corners]).sum(axis=1)
    p = pose.apply(at.place)
    np.testing.assert_allclose(rest[:, -1], TOP, atol=1e-12)
    np.testing.assert_allclose(rest[:, :-1], p[:, :-1], atol=1e-12)
    # The flat lower face bears, and against the flat top it bears along the normal.
    np.testing.assert_allclose(at.direction[:, -1], -1.0, atol=1e-3)


def test_friction_held_from_a_contact_that_is_lost_acts_where_it_was(bodies, dim):
    """The last evaluation of a step may have no pressed points, or others, where friction still has those of one
    before."""
    _, found = pressed(bodies, dim, PenaltyContact(STIFFNESS, 2), [0.002, DEPTH])
    _, (lost,) = pressed(bodies, dim, PenaltyContact(STIFFNESS, 2), [-0.002])
    before, poses = found[-1], {"plate": upright(dim)}
    assert before.solved.is_pressed.any()
    assert lost.solved is None
    aside = np.append(0.02, np.zeros(dim - 1))
    slip = SlipStart(
        np.empty((0, dim)), poses, 0.01, lambda index, of: of.deformed_positions(index) - aside, lambda: None
    )
    friction = CondensedFriction(CoulombFriction(0.5))
    sliding = friction.lag(before, poses, slip)
    forces = friction.evaluate(sliding, lost.rows, poses, 0.01).added_to(lost.forces())
    # Dragged along by the body, which slips by 20 mm, more than its surface gives way: Coulomb's force, of the normal
    # forces held.
    normal = sliding["plate"].lagged.force.sum()
    assert 0.3 * normal < forces["plate"].force[0] <= 0.5 * normal


def test_the_points_stay_during_a_step(bodies, dim):
    """So that the energy is a function of the handle rows; in the next step they are looked for anew."""
    body, mechanics = bodies[dim]
    law, rows = PenaltyContact(STIFFNESS, 2), body.rest_rows
    contact = CondensedContact.of(body, mechanics, {"plate": plate(dim)}, law)
    points = contact.in_frame(rows)
    first = contact.evaluate(points, rows, {"plate": upright(dim)}, None)
    moved = {"plate": upright(dim, at=0.0033)}
    same = contact.evaluate(points, rows, moved, first.warm_start)
    assert same.solved.pressed is first.solved.pressed
    renewed = contact.evaluate(contact.in_frame(rows), rows, moved, first.warm_start)
    assert renewed.solved.pressed is not first.solved.pressed
    # A millimetre is a sixth of a facet, and the dent moves along in part.
    old, new = first.solved.pressed, renewed.solved.pressed
    common, one, other = np.intersect1d(new.index, old.index, return_indices=True)
    assert len(common)
    assert np.abs(new.weights[one] - old.weights[other]).max() > 0.05


def test_a_step_presses_where_its_own_dent_is(bodies, dim):
    """The plate jumps aside by more than a facet: the dent of before says little about where its edge is now."""
    body, mechanics = bodies[dim]
    law, rows = PenaltyContact(STIFFNESS, 2), body.rest_rows
    contact = CondensedContact.of(body, mechanics, {"plate": plate(dim)}, law)
    moved = {"plate": upright(dim, at=0.0104)}

    def step(poses, warm_start):
        return contact.evaluate(contact.in_frame(rows), rows, poses, warm_start)

    first = step({"plate": upright(dim)}, None)
    jumped = step(moved, first.warm_start)
    stayed = step(moved, jumped.warm_start)
    points, last = contact.in_frame(rows), first.solved
    dent = Dent(*contact.node_forces(last), last.solution.largest_displacement)
    by_last = contact.sharp.find(points, rows, moved, points.positions(rows), dent)
    bearing = stayed.solved.active

    def apart(pressed):
        """How far the places at rest are, at most, from those of the step that stayed."""
        other = stayed.solved.pressed
        both = np.intersect1d(np.intersect1d(pressed.index, bearing), other.index)
        one, two = (
            (own.weights[..., None] * body.mesh.points[own.corners]).sum(axis=1)[
                np.searchsorted(own.index, both)
            ]
            for own in (pressed, other)
        )
        return np.linalg.norm(two - one, axis=1).max()

    # They are found again from a fifth of the distance between nodes on.
    assert apart(by_last) > 0.5 * body.mesh.surface_spacing
    assert apart(jumped.solved.pressed) < 0.25 * body.mesh.surface_spacing


def test_pressed_points_slide_along_their_planes_only(bodies, dim):
    body, mechanics = bodies[dim]
    law, rows, pose = PenaltyContact(STIFFNESS, 2), body.rest_rows, upright(dim)
    contact = CondensedContact.of(body, mechanics, {"plate": plate(dim)}, law)
    points = contact.in_frame(rows)
    pressed = contact.sharp.find(points, rows, {"plate": pose}, points.positions(rows), None)
    which = np.arange(len(pressed.index))[::2]
    p, g = pose.apply(pressed.place[which]), pose.rotate(pressed.direction[which])
    along = np.zeros_like(g)
    along[:, 0], along[:, -1] = -g[:, -1], g[:, 0]  # square to g
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    spacing = body.mesh.surface_spacing
    for y, slid in ((p, False), (p + spacing * g, False), (p + 0.1 * spacing * along, False)):
        assert contact.sharp.have_slid(pressed, which, y, [pose]) is slid
    # One of them is enough.
    y = p.copy()
    y[0] += 0.3 * spacing * along[0] - spacing * g[0]
    assert contact.sharp.have_slid(pressed, which, y, [pose])


def test_how_a_box_bears(dim):
    """An edge bears against every push between the normals of its faces, a face only along its own normal."""
    box, spacing = Box([0.01] * dim, 1e-5, "box"), 0.003
    points = sharp_points(box, spacing)
    corner = points[np.argmin(np.linalg.norm(points - 0.01, axis=1))][None]
    for against in np.eye(dim):
        for share in (0.2, 0.5, 0.8):
            push = share * against + (1.0 - share) * np.ones(dim) / np.sqrt(dim)
            push /= np.linalg.norm(push)
            normal, bears = bearing_normals(box, corner, push[None], spacing)
            assert bears.all()
            np.testing.assert_allclose(normal[0], push, atol=0.02)  # rounded by a hundredth of a millimetre
    away = -np.ones(dim) / np.sqrt(dim)
    assert not bearing_normals(box, corner, away[None], spacing)[1].any()


def test_a_small_ball_bears_along_the_push(dim):
    """A tip that is much smaller than the distance between points has every normal."""
    ball, push = Sphere(3e-4, dim), np.zeros((1, dim))
    push[0, 0], push[0, -1] = 0.3, -np.sqrt(1.0 - 0.09)
    lowest = np.zeros((1, dim))
    lowest[0, -1] = -3e-4
    normal, bears = bearing_normals(ball, lowest, push, 0.003)
    assert bears.all()
    assert normal[0] @ push[0] > 0.99
