"""Free rigid colliders in full space: derivatives by finite differences, momenta, the reduced simulator with the
identity as its basis, and no tunnelling."""

from dataclasses import replace

import numpy as np
import pytest

from softprint.fem_truth.dynamics import full_space_simulator
from softprint.fem_truth.dynamics.free_body_energy import JointStep
from softprint.fem_truth.dynamics.full_space_simulator import FullSpaceSimulator
from softprint.runtime.body.cubature import Cubature
from softprint.runtime.body.handles import Handles
from softprint.runtime.body.surface_samples import SurfaceSamples
from softprint.runtime.colliders import Box, Capsule, KeyframedPath, Plane, RigidPose, Sphere
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.dynamics import (
    DynamicsSettings,
    KinematicHandle,
    NewtonSettings,
    PlacedCollider,
    Simulator,
    Status,
)
from softprint.runtime.errors import SoftprintError
from softprint.runtime.rigid import free_collider

STEP, TOP = 0.01, 0.05
STIFFNESS = 1e10
both = pytest.mark.parametrize("dim", [2, 3])


def down(dim, amount=9.81):
    return np.append(np.zeros(dim - 1), -amount)


def posed(dim, rotation, *position):
    """The first and the last of a position in the plane."""
    return RigidPose.from_rotation_vector(
        rotation[:1] if dim == 2 else rotation, [*position[: dim - 1], position[-1]]
    )


def placed(shape, pose, density=2000.0, **start):
    return PlacedCollider(shape.name, shape, free=free_collider(shape, pose, density=density, **start))


def pile(dim, sharp):
    """A box deep in the top of the block, a capsule that leans on it and on a wall, and one that touches nothing; all
    spin."""
    spin = [3.0] if dim == 2 else [3.0, -2.0, 1.0]
    low = (
        Box([0.02, 0.01, 0.01][:dim], name="low")
        if sharp
        else Capsule(-0.012 * np.eye(dim)[0], 0.024 * np.eye(dim)[0], 0.012, "low")
    )
    high = Capsule(-0.012 * np.eye(dim)[0], 0.024 * np.eye(dim)[0], 0.012, "high")
    start = {"velocity": np.linspace(-0.2, 0.1, dim), "spin": spin}
    wall = KeyframedPath([0.0], [[0.048, *[0.0] * (dim - 1)]])
    return [
        placed(low, posed(dim, [0.3, -0.2, 0.5], 0.002, 0.007, TOP + 0.005), **start),
        placed(high, posed(dim, [0.4, 0.1, -0.3], 0.022, 0.002, TOP + 0.029), **start),
        placed(Sphere(0.01, dim, "away"), posed(dim, [0.0] * 3, 0.0, 0.0, 0.5), **start),
        PlacedCollider("wall", Plane(-np.eye(dim)[0], "wall"), wall),
    ]


@pytest.fixture
def solved(block, monkeypatch):
    """Steps a scene and returns the problem of its last step, where that ended, and the result."""
    seen = []
    own = full_space_simulator.minimise

    def minimise(problem, start, settings):
        result = own(problem, start, settings)
        seen.append((problem, result.x))
        return result

    monkeypatch.setattr(full_space_simulator, "minimise", minimise)

    def step(simulator, steps=1):
        result = None
        state = simulator.rest_state()
        for _ in range(steps):
            result = simulator.step(state)
            state = result.state
        return *seen[-1], result

    return step


@both
@pytest.mark.parametrize("sharp", [False, True], ids=["at nodes", "on facets, with sharp edges"])
def test_derivatives_by_finite_differences(block, solved, dim, sharp):
    """With penetration, friction, spin, gravity, two colliders in contact and one that leans on a wall. The energy
    along curves of nodes and twists, and its mixed differences."""
    simulator = FullSpaceSimulator(
        block(dim),
        pile(dim, sharp),
        contact=PenaltyContact(STIFFNESS, 2 if sharp else 0),
        friction=CoulombFriction(0.4, slip_velocity=0.1),
        gravity=down(dim),
        kinematic=[KinematicHandle("base")],
        settings=DynamicsSettings(STEP, NewtonSettings(4, 1e-12)),
    )
    problem, x, _ = solved(simulator)
    simulator._tangent._matrix = None  # the elastic Hessian at x, and not one that was kept
    rng = np.random.default_rng(3)
    energy, gradient = problem.evaluate(x)
    assert np.isfinite(energy)
    problem.second_derivatives(
        x, False
    )  # a slip that has not changed since the last call has its exact Hessian
    contacts, nodes, B, C = problem.second_derivatives(x, False)
    A = problem._body.hessian(x.rows)
    for contact in contacts:
        for facets, blocks in contact.blocks:
            A.add_facets(facets, blocks)
    touched = [contact.coupling.name for contact in contacts if len(contact.nodes)]
    assert touched == ["low"]
    assert sharp == any(blocks.shape[1] > 1 for contact in contacts for _, blocks in contact.blocks)

    n = len(C)
    near = np.zeros_like(x.rows)
    near[nodes] = simulator._null_space.project(np.ones_like(x.rows))[nodes]
    twist = n // 3

    def random(part):
        """A direction of the nodes near the contact, or of the twist of a collider."""
        twists = np.zeros(n)
        if part == "nodes":
            way = near * rng.standard_normal(x.rows.shape)
            return JointStep(way / np.linalg.norm(way), twists)
        twists[part * twist : (part + 1) * twist] = rng.standard_normal(twist)
        return JointStep(np.zeros_like(x.rows), twists / np.linalg.norm(twists))

    def along(step, length):
        return problem.evaluate(problem.moved(x, step, length))

    def product(one, other):
        mixed = one.nodes[nodes].ravel() @ B @ other.twists + other.nodes[nodes].ravel() @ B @ one.twists
        return np.vdot(one.nodes, A.apply(other.nodes)) + mixed + one.twists @ C @ other.twists

    h = 1e-6
    ways = {part: random(part) for part in ("nodes", 0, 1, 2)}
    for way in ways.values():
        slope = (along(way, h)[0] - along(way, -h)[0]) / (2 * h)
        # Of second order in 1 um, a thousandth of the depths; energies of 0.1 J are right to 1e-16 of that.
        assert problem.slope(gradient, way) == pytest.approx(slope, rel=1e-4, abs=1e-8)
        bent = (problem.slope(along(way, h)[1], way) - problem.slope(along(way, -h)[1], way)) / (2 * h)
        assert product(way, way) == pytest.approx(bent, rel=2e-4)
    for one, other in (("nodes", 0), ("nodes", 1), (0, 1), (1, 2)):
        a, b = ways[one], ways[other]
        # The twists of different colliders commute, and with the nodes, so that one retraction serves both.
        difference = [problem.slope(along(b, s * h)[1], a) for s in (1, -1)]
        mixed = (difference[0] - difference[1]) / (2 * h)
        stiff = np.sqrt(abs(product(a, a) * product(b, b)))
        assert product(a, b) == pytest.approx(mixed, rel=1e-3, abs=1e-5 * stiff)
        assert ((one, other) in (("nodes", 1), (1, 2))) == (product(a, b) == 0.0)


@both
def test_the_direction_solves_the_joint_system(block, solved, dim):
    """Nodes and twists at once, by eliminating the twists."""
    simulator = FullSpaceSimulator(
        block(dim),
        pile(dim, sharp=True),
        contact=PenaltyContact(STIFFNESS, 2),
        gravity=down(dim),
        kinematic=[KinematicHandle("base")],
        settings=DynamicsSettings(STEP, NewtonSettings(3, 1e-12)),
    )
    problem, x, _ = solved(simulator)
    gradient = problem.evaluate(x)[1]
    found = problem.direction(x, gradient, 1e-10, 5000, convex=True)
    assert not found.negative_curvature
    contacts, nodes, B, C = problem.second_derivatives(x, True)
    matrix = problem._body.hessian(x.rows, True)
    for contact in contacts:
        for facets, blocks in contact.blocks:
            matrix.add_facets(facets, blocks)
    by_nodes = matrix.apply(found.step.nodes) + gradient.body.projected
    by_nodes[nodes] += (B @ found.step.twists).reshape(len(nodes), dim)
    by_twists = B.T @ found.step.nodes[nodes].ravel() + C @ found.step.twists + gradient.twists
    residual = np.hypot(np.linalg.norm(simulator._null_space.project(by_nodes)), np.linalg.norm(by_twists))
    assert residual < 1e-8 * gradient.norm  # 1e-10 was asked for; round-off of a stiff contact
    slope = problem.slope(gradient, found.step)
    assert slope == pytest.approx(found.slope)
    assert slope < 0.0


def moments(points, momenta):
    """sum x cross p, with one component in 2D and three in 3D."""
    return np.atleast_1d(np.cross(points, momenta).sum(axis=0))


def gained(simulator, before, after):
    """Linear and angular momentum that body and colliders together gain in a step, the angular one about their
    positions at its end: exactly the forces at the end of the step enter into it."""
    p = simulator.body.node_mass[:, None] * (after.velocity - before.velocity)
    linear, angular = p.sum(axis=0), moments(after.x, p)
    for collider in simulator.colliders:
        if collider.free is not None:
            old, new = before.motions[collider.name], after.motions[collider.name]
            p = collider.free.mass.mass * (new.velocity - old.velocity)
            centre = after.poses[collider.name].apply(collider.free.mass.centre[None])
            linear, angular = linear + p, angular + moments(centre, p[None]) + new.momentum - old.momentum
    return linear, angular


@both
@pytest.mark.parametrize("refinement", [0, 2])
def test_momentum_is_exchanged_and_conserved(block, dim, refinement):
    """A free body between two spinning colliders that run into it, and a third that runs into one of them, with
    friction and without gravity."""
    spin = [20.0] if dim == 2 else [20.0, 5.0, -10.0]
    right, up = np.eye(dim)[0], np.eye(dim)[-1]
    colliders = [
        placed(
            Sphere(0.02, dim, "side"),
            posed(dim, [0.0] * 3, -0.0705, 0.0, 0.02),
            velocity=0.6 * right,
            spin=spin,
        ),
        placed(
            Box([0.02, 0.015, 0.015][:dim], name="above"),
            posed(dim, [0.2, 0.0, 0.0], 0.02, 0.0, 0.074),
            velocity=-0.5 * up,
            spin=spin,
        ),
        placed(Sphere(0.01, dim, "late"), posed(dim, [0.0] * 3, 0.02, 0.0, 0.12), velocity=-1.5 * up),
    ]
    simulator = FullSpaceSimulator(
        block(dim),
        colliders,
        contact=PenaltyContact(STIFFNESS, refinement),
        friction=CoulombFriction(0.5),
        settings=DynamicsSettings(STEP, NewtonSettings(100, 1e-8)),
    )
    state = simulator.rest_state()
    for _ in range(8):
        before, result = state, simulator.step(state)
        assert result.converged, result.reason
        state = result.state
        linear, angular = gained(simulator, before, state)
        # A residual of 1e-8 of forces of some 10 N for 0.01 s; what is exchanged is of 0.01 to 0.1 kg m/s.
        np.testing.assert_allclose(linear, 0.0, atol=2e-8)
        np.testing.assert_allclose(angular, 0.0, atol=2e-9)
    lost = [np.linalg.norm(c.free.motion.velocity - state.motions[c.name].velocity) for c in colliders]
    assert min(lost) > 0.1  # all of them had contact
    gained_spin = state.motions["side"].momentum - colliders[0].free.motion.momentum
    assert np.abs(gained_spin).max() > 1e-6  # by friction alone: it is a ball


def with_identity(body):
    """The body with a handle at every node, and every cell and surface node evaluated."""
    n = body.n_nodes
    return replace(
        body,
        handles=Handles(body.dim, np.arange(n), ()),
        basis=np.eye(n),
        reduced_mass=np.diag(body.node_mass),
        cubature=Cubature(np.arange(body.mesh.n_cells), body.mesh.cell_volumes, 0.0, 0.0),
        surface=SurfaceSamples(body.mesh.surface_nodes, body.mesh.surface_areas),
    )


@both
@pytest.mark.parametrize("mu", [0.0, 0.3], ids=["smooth", "rough"])
def test_the_reduced_simulator_with_the_identity_as_basis_is_full_space(block, dim, mu):
    """The same energy in both simulators: two colliders fall on the block and on each other, or a spinning ball slides
    on the block."""
    body = with_identity(block(dim))
    at = posed(dim, [0.0] * 3, 0.003, 0.002, TOP + 0.0185)
    start = {"velocity": [0.4, 0.1, -0.1][-dim:], "spin": [3.0] if dim == 2 else [1.0, 2.0, 3.0]}
    scene = {
        "colliders": [placed(Sphere(0.02, dim, "low"), at, **start)] if mu else pile(dim, sharp=False),
        "contact": PenaltyContact(STIFFNESS, refinement=0),  # on facets their points differ
        "friction": CoulombFriction(mu, slip_velocity=0.1) if mu else None,
        "gravity": down(dim),
        "kinematic": [KinematicHandle(int(node)) for node in block(dim).handles.frame_nodes],
        "settings": DynamicsSettings(STEP, NewtonSettings(100, 1e-9), friction_updates=30),
    }
    reduced, full = Simulator(body, **scene), FullSpaceSimulator(body, **scene)
    slow, fast = reduced.settle(), full.settle()
    for _ in range(3):
        slow, fast = reduced.step(slow.state), full.step(fast.state)
        assert slow.converged, slow.reason
        assert fast.converged, fast.reason
        moved = np.abs(fast.state.x - body.mesh.points).max()
        # Residuals of 1e-9; where the normal forces of friction still change a little at their last update, more.
        within = (1e-6 if mu == 0.0 else 1e-3) * moved
        assert np.abs(slow.state.rows - fast.state.x).max() < within
        for name in fast.state.motions:
            one, other = slow.state.poses[name].matrix, fast.state.poses[name].matrix
            np.testing.assert_allclose(one[:-1, -1], other[:-1, -1], atol=within)
            np.testing.assert_allclose(one[:-1, :-1], other[:-1, :-1], atol=within / 0.01)
            force, own = slow.contacts[name].force, fast.contacts[name].force
            share = 1e-5 if mu == 0.0 else 1e-2
            np.testing.assert_allclose(own, force, atol=share * max(1.0, np.linalg.norm(own)))
        for kind in ("kinetic", "gravity", "contact", "elastic", "inertia"):
            assert fast.energies[kind] - slow.energies[kind] == pytest.approx(0.0, abs=1e-3 * moved), kind
    assert moved > 1e-3
    assert np.linalg.norm(fast.contacts["low"].force) > 0.1  # newtons


@both
def test_a_box_slides_on_a_floor_by_coulombs_law(block, dim):
    """Rigid on rigid, beside the body."""
    box = placed(
        Box([0.02, 0.02, 0.01][-dim:], name="box"),
        posed(dim, [0.0] * 3, 1.0, 0.0, -0.49),
        velocity=0.6 * np.eye(dim)[0],
    )
    floor = KeyframedPath([0.0], [-0.5 * np.eye(dim)[-1]])
    simulator = FullSpaceSimulator(
        block(dim),
        [box, PlacedCollider("floor", Plane(np.eye(dim)[-1], "floor"), floor)],
        contact=PenaltyContact(STIFFNESS),
        friction=CoulombFriction(0.4, 1e-3),
        gravity=down(dim),
        kinematic=[KinematicHandle("base")],
        settings=DynamicsSettings(STEP, NewtonSettings(60, 1e-6)),
    )
    result, speeds = simulator.settle(), []
    for _ in range(12):
        result = simulator.step(result.state)
        assert result.converged, result.reason
        speeds.append(result.state.motions["box"].velocity[0])
    # After it has come to rest on its contact points.
    assert (speeds[3] - speeds[-1]) / (8 * STEP) == pytest.approx(0.4 * 9.81, rel=0.01)


def test_a_ball_comes_to_rest_by_its_weight(block):
    ball = placed(Sphere(0.02, 2, "ball"), RigidPose(np.eye(2), [0.003, TOP + 0.021]), 1500.0)
    simulator = FullSpaceSimulator(
        block(2),
        [ball],
        contact=PenaltyContact(STIFFNESS),
        friction=CoulombFriction(0.3),
        gravity=down(2),
        kinematic=[KinematicHandle("base")],
        settings=DynamicsSettings(0.02, NewtonSettings(60, 1e-5)),
    )
    result = simulator.settle()
    for _ in range(60):
        result = simulator.step(result.state)
        assert result.converged, result.reason
    weight = 9.81 * ball.free.mass.mass
    # Backward Euler damps the bounce; it still rolls a little on the few nodes under it.
    assert result.contacts["ball"].force[-1] == pytest.approx(weight, rel=1e-2)


@both
def test_there_is_no_tunnelling(block, dim):
    """A plate, 8 mm thick, falls 3 cm in a step onto the block."""
    plate = placed(
        Box([0.04, 0.04, 0.004][-dim:], name="plate"),
        posed(dim, [0.0] * 3, 0.0, 0.0, 0.2),
        velocity=down(dim, 3.0),
    )
    simulator = FullSpaceSimulator(
        block(dim),
        [plate],
        contact=PenaltyContact(STIFFNESS),
        gravity=down(dim),
        kinematic=[KinematicHandle("base")],
        settings=DynamicsSettings(STEP, NewtonSettings(100, 1e-4)),
    )
    state = simulator.settle().state
    for _ in range(10):
        result = simulator.step(state)
        assert result.converged, result.reason
        state = result.state
        under = state.poses["plate"].apply_inverse(state.x)
        above = under[np.abs(under[:, :-1]).max(axis=1) < 0.03, -1]
        assert above.max() < 0.0  # no part of the block below it is above its middle
    assert state.poses["plate"].translation[-1] < TOP + 0.03  # it did arrive


def test_a_collider_that_pierces_the_body_is_held_and_named(block):
    """A heavy shot on a soft contact, in full space and in the reduced simulator with the identity as its basis."""
    start = RigidPose(np.eye(2), [0.004, TOP + 0.01])
    shot = placed(Sphere(0.006, 2, "shot"), start, 4e5, velocity=[0.0, -2.0])
    body = with_identity(block(2))
    scene = {
        "contact": PenaltyContact(1e8, refinement=0),
        "kinematic": [KinematicHandle(int(node)) for node in block(2).handles.frame_nodes],
        "settings": DynamicsSettings(STEP, NewtonSettings(40, 1e-4)),
    }
    said = []
    for simulator in (FullSpaceSimulator(body, [shot], **scene), Simulator(body, [shot], **scene)):
        state = simulator.rest_state()
        steps = 0
        while state.time < 8 * STEP:
            result, steps = simulator.step(state), steps + 1
            state = result.state
            if result.piercing is not None:
                break
        assert result.status is Status.PIERCED
        assert result.piercing.collider == "shot"
        assert f"collider 'shot' {'would be' if result.piercing.refused else 'is'}" in result.reason
        assert 0.0 < state.poses["shot"].translation[-1] < TOP  # held inside, and not below
        said.append((steps, result.piercing.depth))
    assert said[0][0] == said[1][0]
    assert said[0][1] == pytest.approx(said[1][1], rel=0.2)  # where the line search stops is not the same


def test_settling_keeps_free_colliders_where_they_are(block):
    shot = placed(Sphere(0.02, 2, "ball"), RigidPose(np.eye(2), [0.0, TOP + 0.019]), velocity=[0.0, -1.0])
    simulator = FullSpaceSimulator(
        block(2), [shot], contact=PenaltyContact(STIFFNESS), kinematic=[KinematicHandle("base")]
    )
    rest, settled = simulator.at_rest(), simulator.settle()
    assert settled.converged
    for result in (rest, settled):
        np.testing.assert_array_equal(result.state.poses["ball"].matrix, shot.free.pose.matrix)
        assert result.state.motions["ball"] is shot.free.motion
        assert result.energies["kinetic"] == pytest.approx(0.5 * shot.free.mass.mass)
    assert settled.contacts["ball"].force[-1] > 0.0  # pressed in by 1 mm
    with pytest.raises(SoftprintError, match="leave its pose to the step"):
        simulator.step(settled.state, {"ball": shot.free.pose})
