"""What several colliders near each other do to a body: contacts that are solved together, and the dents that they make
together, as they are drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from softprint.runtime.colliders import KeyframedPath, Placed, RigidPose, SmoothUnion, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.dynamics.kinematic import KinematicHandle
from softprint.runtime.dynamics.placed_collider import PlacedCollider
from softprint.runtime.dynamics.simulator import Simulator
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.force.correction import ForceCorrection
from softprint.runtime.learned.force.model import ForceModel, ForceModelOptions
from softprint.runtime.mechanics.body_mechanics import compute_mechanics

STIFFNESS = 1e10  # N/m^4
OPTIONS = ForceModelOptions((4, 4), "silu", 5e-4, 3e-3, STIFFNESS)


@pytest.fixture(params=[(0, 1), (4, 2), (4, 3)], ids=["at nodes", "two along a facet", "three"])
def law(request):
    """Contact at nodes, and at several points of every facet, so that no ball counts as sharp: where its sharp points
    are depends on what else is in the same collider."""
    return PenaltyContact(STIFFNESS, *request.param)


def two_balls(dim):
    """Two balls side by side, pressed into the top of the block, and their poses."""
    balls = [Sphere(0.015, dim, name) for name in ("left", "right")]
    places = [np.append([x, 0.01][: dim - 1], z) for x, z in ((-0.017, 0.071), (0.017, 0.07))]
    return balls, [RigidPose(np.eye(dim), place) for place in places]


def as_one(balls, poses):
    """The same two as one collider, at the identity."""
    return SmoothUnion([Placed(ball, pose) for ball, pose in zip(balls, poses, strict=True)], 1e-9, "two")


def evaluated(body, mechanics, shapes, poses, law):
    """The contact of the body at rest with some colliders."""
    contact = CondensedContact.of(body, mechanics, {shape.name: shape for shape in shapes}, law)
    at = {shape.name: pose for shape, pose in zip(shapes, poses, strict=True)}
    return contact.evaluate(contact.in_frame(body.rest_rows), body.rest_rows, at, None)


def test_colliders_near_each_other_are_solved_together(jelly_body, dim, law):
    """Two balls are one collider of two balls: energy, gradient and forces; alone, each would say something else."""
    mechanics = compute_mechanics(jelly_body, 400, condensation=False)
    balls, poses = two_balls(dim)
    away = Sphere(0.015, dim, "away"), RigidPose(np.eye(dim), np.append(np.zeros(dim - 1), 0.2))
    together = evaluated(jelly_body, mechanics, [*balls, away[0]], [*poses, away[1]], law)
    union = evaluated(jelly_body, mechanics, [as_one(balls, poses)], [RigidPose.identity(dim)], law)
    # Balanced to 1e-6 of the depth each.
    assert together.energy == pytest.approx(union.energy, rel=1e-5)
    largest = np.abs(union.gradient).max()
    np.testing.assert_allclose(together.gradient, union.gradient, atol=1e-5 * largest)
    stiffness = union.hessian()
    np.testing.assert_allclose(together.hessian(), stiffness, atol=1e-5 * np.abs(stiffness).max())
    active = {name: together.active_points(name) for name in ("left", "right", "away")}
    assert len(active["left"].index) > 0
    assert len(active["right"].index) > 0
    assert len(active["away"].index) == 0
    push = sum(own.pressure @ own.normal for own in active.values())
    expected = union.active_points("two")
    tolerance = 1e-5 * expected.pressure.sum()
    np.testing.assert_allclose(push, expected.pressure @ expected.normal, atol=tolerance)
    separately = [
        evaluated(jelly_body, mechanics, [ball], [pose], law) for ball, pose in zip(balls, poses, strict=True)
    ]
    # Fifty times as much as it is right to.
    assert abs(sum(alone.energy for alone in separately) - together.energy) > 5e-4 * together.energy


def test_one_collider_is_a_group_of_one(jelly_body, dim, law):
    """A collider that touches nothing changes no bit of the contact with another."""
    mechanics = compute_mechanics(jelly_body, 400, condensation=True)
    balls, poses = two_balls(dim)
    away = RigidPose(np.eye(dim), np.append(np.zeros(dim - 1), 0.2))
    alone = evaluated(jelly_body, mechanics, balls[:1], poses[:1], law)
    beside = evaluated(jelly_body, mechanics, balls, [poses[0], away], law)
    assert beside.energy == alone.energy > 0.0
    np.testing.assert_array_equal(beside.gradient, alone.gradient)
    np.testing.assert_array_equal(beside.hessian(), alone.hessian())
    np.testing.assert_array_equal(beside.forces()["left"].force, alone.forces()["left"].force)
    assert not beside.forces()["right"].force.any()


def corrected(body, mechanics, placed, options=OPTIONS) -> list[PlacedCollider]:
    """With untrained corrections, whose dents are those of mechanics, on colliders held at poses."""
    model = ForceModel(options, body.dim, body.n_rows).double()
    return [
        PlacedCollider(
            shape.name,
            shape,
            KeyframedPath([0.0], [pose.translation]),
            correction=ForceCorrection("x", model, body, shape, mechanics),
        )
        for shape, pose in placed
    ]


def test_dents_near_each_other_are_drawn_as_of_one_collider(jelly_body, dim, law):
    mechanics = compute_mechanics(jelly_body, 400, condensation=False)
    balls, poses = two_balls(dim)
    scenes = {
        "together": [*zip(balls, poses, strict=True)],
        "union": [(as_one(balls, poses), RigidPose.identity(dim))],
        "left": [(balls[0], poses[0])],
        "right": [(balls[1], poses[1])],
    }
    rest, moved = jelly_body.mesh.points, {}
    for name, placed in scenes.items():
        colliders = corrected(
            jelly_body,
            mechanics,
            placed,
            replace(OPTIONS, refinement=law.refinement, reduced_refinement=law.reduced_refinement),
        )
        simulator = Simulator(jelly_body, colliders, contact=law, mechanics=mechanics)
        state = simulator.rest_state()
        moved[name] = simulator.positions(state) - rest
        nodes = jelly_body.surface.nodes
        # The same forces, summed at fewer nodes.
        np.testing.assert_allclose(
            simulator.surface_positions(state) - rest[nodes], moved[name][nodes], atol=1e-12
        )
    largest = np.abs(moved["union"]).max()
    # Both are balanced to 1e-6 of the depth.
    np.testing.assert_allclose(moved["together"], moved["union"], atol=1e-5 * largest)
    # Each on its own would go in as if the other were not there.
    assert np.abs(moved["left"] + moved["right"] - moved["union"]).max() > 0.02 * largest


def test_corrections_of_one_body_have_one_stiffness(jelly_body, dim):
    mechanics = compute_mechanics(jelly_body, 50, condensation=False)
    soft, stiff = zip(*two_balls(dim), strict=True)
    stiffer = replace(OPTIONS, stiffness=2.0 * STIFFNESS)
    colliders = corrected(jelly_body, mechanics, [soft]) + corrected(jelly_body, mechanics, [stiff], stiffer)
    with pytest.raises(
        SoftprintError,
        match=r"was trained for a contact stiffness of 2e\+10 N/m\^4, not for 1e\+10: give Pen",
    ):
        Simulator(jelly_body, colliders, contact=PenaltyContact(STIFFNESS), mechanics=mechanics)


def test_corrections_of_contact_on_facets_are_for_contact_on_facets(jelly_body, dim):
    mechanics = compute_mechanics(jelly_body, 50, condensation=False)
    one, _ = zip(*two_balls(dim), strict=True)
    colliders = corrected(jelly_body, mechanics, [one], replace(OPTIONS, refinement=3))
    Simulator(jelly_body, colliders, contact=PenaltyContact(STIFFNESS, 3), mechanics=mechanics)
    with pytest.raises(
        SoftprintError,
        match=r"corners of every facet, and at tips and edges with refinement 3, not at nodes: give contact=Pen",
    ):
        Simulator(jelly_body, colliders, contact=PenaltyContact(STIFFNESS, refinement=0), mechanics=mechanics)


LEARNED = replace(OPTIONS, energy=(1.0,))


def test_corrections_of_one_body_have_one_energy(jelly_body, dim):
    mechanics = compute_mechanics(jelly_body, 50, condensation=False)
    one, other = zip(*two_balls(dim), strict=True)
    colliders = corrected(jelly_body, mechanics, [one]) + corrected(jelly_body, mechanics, [other], LEARNED)
    with pytest.raises(SoftprintError, match="different energies of contact with the body"):
        Simulator(jelly_body, colliders, contact=PenaltyContact(STIFFNESS), mechanics=mechanics)


def test_one_energy_is_the_same_in_each_correction(jelly_body, dim):
    """Corrections of one training that are read from its file one by one."""
    mechanics = compute_mechanics(jelly_body, 50, condensation=False)
    one, other = zip(*two_balls(dim), strict=True)
    colliders = [
        placed
        for ball in (one, other)
        for placed in corrected(jelly_body, mechanics, [ball], replace(LEARNED))
    ]
    Simulator(jelly_body, colliders, contact=PenaltyContact(STIFFNESS), mechanics=mechanics)


def test_what_is_learned_moves_the_body(jelly_body, dim):
    """The energy is in the step: two balls that are pressed in for ten steps leave other handles, and feel other
    forces."""
    mechanics = compute_mechanics(jelly_body, 400, condensation=True)
    placed = [*zip(*two_balls(dim), strict=True)]
    rows, forces = {}, {}
    for name, options in (("mechanics", OPTIONS), ("learned", LEARNED)):
        colliders = corrected(jelly_body, mechanics, placed, options)
        simulator = Simulator(
            jelly_body,
            colliders,
            contact=PenaltyContact(STIFFNESS),
            mechanics=mechanics,
            kinematic=[KinematicHandle("base")],
        )
        state = simulator.rest_state()
        for _ in range(10):
            result = simulator.step(state)
            assert result.converged
            state = result.state
        rows[name], forces[name] = state.rows, result.contacts["left"].force
    moved = np.abs(rows["mechanics"] - jelly_body.rest_rows).max()
    assert np.abs(rows["learned"] - rows["mechanics"]).max() > 0.01 * moved
    change = np.linalg.norm(forces["learned"] - forces["mechanics"])
    # The dents are shallow, and harden by some per cent; steps are solved to 1e-4.
    assert change > 0.005 * np.linalg.norm(forces["mechanics"])


@pytest.mark.parametrize("given", ["none", "other nodes", "of another material"])
def test_corrections_of_one_body_have_one_mechanics(jelly_body, dim, given):
    trained_with = compute_mechanics(jelly_body, 50, condensation=False)
    softer = replace(trained_with.compliance, operator=2.0 * trained_with.compliance.operator)
    mechanics = {
        "none": None,
        "other nodes": compute_mechanics(jelly_body, 20, condensation=False),
        "of another material": trained_with._replace(compliance=softer),
    }[given]
    colliders = corrected(jelly_body, trained_with, zip(*two_balls(dim), strict=True))
    with pytest.raises(SoftprintError, match=r"of collider 'left' .*mechanics: give Simulator\(mechanics="):
        Simulator(jelly_body, colliders, contact=PenaltyContact(STIFFNESS), mechanics=mechanics)
