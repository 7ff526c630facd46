"""Full-space steps compared with momentum balance, closed forms, and the reduced simulator with the identity as
its basis."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from softprint.fem_truth.dynamics.full_space_simulator import FullSpaceSimulator
from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.energy.full_space_springs import linear_springs
from softprint.fem_truth.statics.constrained import ConstrainedProblem
from softprint.runtime.body import assemble_body, frame_in_box, place_handles
from softprint.runtime.body.cubature import Cubature
from softprint.runtime.body.handles import Handles
from softprint.runtime.body.surface_samples import SurfaceSamples
from softprint.runtime.colliders import Box, KeyframedPath, Plane, RigidPose, Sphere
from softprint.runtime.contact import CoulombFriction, PenaltyContact, sharp_planes
from softprint.runtime.dynamics import (
    DynamicsSettings,
    HandleSpring,
    KinematicHandle,
    NewtonSettings,
    PlacedCollider,
    Simulator,
)
from softprint.runtime.elasticity import make_material
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mesh import box_mesh
from softprint.runtime.optimise import Newton

CONTACT = PenaltyContact(1e9, refinement=0)  # at nodes: simple enough to be written out here
STEP = 0.01
TIGHT = DynamicsSettings(STEP, NewtonSettings(50, 1e-10))
both = pytest.mark.parametrize("dim", [2, 3])


def down(dim, amount=9.81):
    return np.array([0.0] * (dim - 1) + [-amount])


def ball(dim, positions, radius=0.015, times=None):
    times = np.arange(len(positions)) * STEP if times is None else times
    points = np.zeros((len(positions), dim))
    points[:, -1] = positions
    return PlacedCollider("ball", Sphere(radius, dim), KeyframedPath(times, points))


@both
def test_free_body_keeps_its_momentum(block, dim):
    """Elastic forces sum to zero: a free wobbling body keeps its momentum, up to the residual."""
    body = block(dim)
    simulator = FullSpaceSimulator(
        body, contact=CONTACT, settings=DynamicsSettings(STEP, NewtonSettings(50, 1e-8))
    )
    velocity = 0.2 + 0.3 * np.random.default_rng(0).standard_normal(body.mesh.points.shape)
    state = replace(simulator.rest_state(), velocity=velocity)
    momentum = body.node_mass @ velocity
    for _ in range(4):
        result = simulator.step(state)
        assert result.converged, result.reason
        state = result.state
    np.testing.assert_allclose(body.node_mass @ state.velocity, momentum, rtol=1e-6)  # residual 1e-8 a step


@both
def test_free_fall_follows_backward_euler(block, dim):
    body = block(dim)
    simulator = FullSpaceSimulator(body, contact=CONTACT, gravity=down(dim), settings=TIGHT)
    state = simulator.rest_state()
    for _ in range(5):
        state = simulator.step(state).state
    fall = down(dim) * STEP**2 * 5 * 6 / 2  # v_k = k h g, x_n = h sum v_k
    np.testing.assert_allclose(state.x - body.mesh.points, np.broadcast_to(fall, state.x.shape), atol=1e-9)


@both
def test_kinematic_handles_follow_their_keyframes(block, dim):
    body = block(dim)
    shift = np.full((2, dim), [[0.0], [0.004]])
    path = KeyframedPath([0.0, STEP], shift)
    held = [KinematicHandle("base"), KinematicHandle(0, path)]
    simulator = FullSpaceSimulator(body, contact=CONTACT, gravity=down(dim), kinematic=held, settings=TIGHT)
    state = simulator.step(simulator.rest_state()).state
    base = body.handles.frame_nodes
    np.testing.assert_allclose(state.x[base], body.mesh.points[base], atol=1e-15)
    # A point is prescribed in the reduced state; round-off of a sum over all nodes.
    np.testing.assert_allclose(body.project(state.x)[0], body.rest_rows[0] + 0.004, atol=1e-14)
    free = np.setdiff1d(np.arange(body.n_nodes), base)
    assert np.abs(state.x - body.mesh.points)[free].max() > 1e-4


@both
def test_settled_body_rests_on_the_floor_with_its_weight(block, dim):
    body = block(dim)
    floor = PlacedCollider("floor", Plane(-down(dim)), KeyframedPath.constant(RigidPose.identity(dim)))
    # The floor stops it from falling, a spring to the base from drifting sideways.
    spring = HandleSpring(
        "base", 1.0, KeyframedPath.constant(RigidPose(np.eye(dim), body.handles.frames[0].pivot))
    )
    simulator = FullSpaceSimulator(
        body, [floor], contact=CONTACT, gravity=down(dim), springs=[spring], settings=TIGHT
    )
    result = simulator.settle()
    assert result.converged, result.reason
    weight = body.node_mass.sum() * 9.81
    pull = 1.0 * (body.handles.frames[0].pivot - result.state.x[body.handles.frame_nodes].mean(axis=0))
    np.testing.assert_allclose(result.contacts["floor"].force[-1], -weight + pull[-1], rtol=1e-4)
    assert 0 < result.penetration < 0.002


@both
def test_frame_springs_pull_position_and_orientation(block, dim):
    """Undeformed and rotated by a small angle, the spring's energy is that of the reduced model's formula."""
    body = block(dim)
    angle = 0.3
    vector = np.array([angle]) if dim == 2 else np.array([0.0, 0.0, angle])
    frame = body.handles.frames[0]
    target = RigidPose.from_rotation_vector(vector, frame.pivot + 0.01)
    spring = HandleSpring("base", 50.0, KeyframedPath.constant(target), rotation_stiffness=2.0)
    energy = sum(term.energy(body.mesh.points) for term in linear_springs([spring], body, 0.0))
    turns = 2.0 / 4.0 * 4.0 * (1 - np.cos(angle))  # |I - R|_F^2 = 4 (1 - cos) in 2D and 3D
    assert energy == pytest.approx(0.5 * 50.0 * dim * 0.01**2 + turns, rel=1e-9)


@both
@pytest.mark.parametrize("led", [False, True], ids=["a spring", "kinematic"])
def test_what_pulls_a_point_pulls_its_state(block, dim, led):
    """The force is one of those that hold a state in the truth: nothing is displaced but what the state displaces."""
    body, target = block(dim), np.zeros(dim)
    target[-1] = 0.07
    held, springs = [KinematicHandle("base")], []
    if led:
        held.append(KinematicHandle(0, KeyframedPath([0.0], [np.full(dim, 0.006)])))
    else:
        springs.append(HandleSpring(0, 30.0, KeyframedPath.constant(RigidPose(np.eye(dim), target))))
    simulator = FullSpaceSimulator(
        body, contact=CONTACT, gravity=down(dim), springs=springs, kinematic=held, settings=TIGHT
    )
    x = simulator.settle().state.x
    rows = body.project(x)
    problem = ConstrainedProblem(FullSpaceElasticity(body), down(dim), CONTACT, body)
    pulled = x - body.reduced_positions(body.rest_rows)
    # Both are solved to 1e-7 of their forces or better.
    assert np.abs(problem.internal_equilibrium(rows).x - x).max() < 1e-5 * np.abs(pulled).max()
    # In the reduced model it acts on the same row.
    np.testing.assert_allclose(body.point_projection @ x, rows[: body.handles.n_points], atol=1e-12)


@both
def test_friction_drags_within_the_cone_and_against_the_slip(block, dim):
    body = block(dim)
    positions = np.zeros((3, dim))
    positions[:, -1] = [0.065, 0.061, 0.061]  # the ball has radius 15 mm, the top is at 50 mm: 4 mm deep
    positions[2, 0] = 0.004
    placed = PlacedCollider("ball", Sphere(0.015, dim), KeyframedPath(np.array([0, 4, 8]) * STEP, positions))
    coefficient = 0.4
    forces = {}
    for mu in (0.0, coefficient):
        simulator = FullSpaceSimulator(
            body,
            [placed],
            contact=CONTACT,
            friction=CoulombFriction(mu),
            kinematic=[KinematicHandle("base")],
            settings=DynamicsSettings(STEP, NewtonSettings(60, 1e-6)),
        )
        state = simulator.rest_state()
        for _ in range(8):
            result = simulator.step(state)
            assert result.converged, result.reason
            state = result.state
        forces[mu] = result.contacts["ball"].force
    drag = forces[coefficient][0] - forces[0.0][0]
    normal = forces[coefficient][-1]
    assert normal > 0  # the body pushes the ball up
    assert drag < 0  # and drags it back
    assert abs(drag) < 1.1 * coefficient * normal  # the cone, with room for the slope of the ball


@both
@pytest.mark.parametrize("velocity", [(2.0, -1.0), (0.5, -0.3)])
def test_a_block_thrown_on_a_rough_floor_slides_by_coulombs_law(dim, velocity):
    """Friction is mu N in every step that slides, also in the first ones, whose forces begin far from balance; so the
    block loses mu times the momentum that the floor gives it upward."""
    mesh = box_mesh([-0.05] * (dim - 1) + [0.0], [0.05] * (dim - 1) + [0.06], [5] * (dim - 1) + [4])
    material = make_material("stable_neo_hookean", 2e4, 0.4)
    body = assemble_body(mesh, place_handles(mesh, 8), material, 1000.0, name="block")
    floor = PlacedCollider(
        "floor", Plane(np.eye(dim)[-1], "floor"), KeyframedPath.constant(RigidPose(np.eye(dim), down(dim, 0.002)))
    )
    mu = 0.3
    simulator = FullSpaceSimulator(
        body,
        [floor],
        contact=PenaltyContact(1e10),
        friction=CoulombFriction(mu),
        gravity=down(dim),
        settings=DynamicsSettings(1 / 60, NewtonSettings(100, 1e-6)),
    )
    start = np.zeros(dim)
    start[0], start[-1] = velocity
    state = replace(simulator.rest_state(), velocity=np.tile(start, (body.n_nodes, 1)))
    for _ in range(4):
        result = simulator.step(state)
        assert result.converged, result.reason
        state = result.state
        force = result.contacts["floor"].force
        assert force[-1] < 0.0  # the block presses the floor
        # Normal forces are those of the last update, where forces balance to 5 % of a change that is itself small.
        assert force[0] == pytest.approx(-mu * force[-1], rel=0.01)


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
@pytest.mark.parametrize("refinement", [0, 2], ids=["at nodes", "on facets"])
def test_reduced_dynamics_with_the_identity_as_basis_is_full_dynamics(
    block, dim, mu, refinement, monkeypatch
):
    """At nodes, and on facets with as many points on each as in full space, which has points on blunt parts of a
    collider, too; a reduced model without mechanics has none."""
    monkeypatch.setattr(sharp_planes, "BLUNT", 1.0)
    body = block(dim)
    led = ball(dim, [0.065, 0.064, 0.062, 0.060])
    identity = with_identity(body)
    scene = {
        "colliders": [led],
        "contact": replace(CONTACT, refinement=refinement, reduced_refinement=2),
        "friction": CoulombFriction(mu) if mu else None,
        "gravity": down(dim),
        "kinematic": [KinematicHandle(int(node)) for node in body.handles.frame_nodes],
        "settings": TIGHT,
    }
    reduced, full = Simulator(identity, **scene), FullSpaceSimulator(identity, **scene)
    slow, fast = reduced.rest_state(), full.rest_state()
    for _ in range(3):
        slow, fast = reduced.step(slow).state, full.step(fast).state
        moved = np.abs(fast.x - body.mesh.points).max()
        # Both stop at a residual of 1e-10; friction, frozen after a few updates at slightly different
        # iterates, differs more.
        assert np.abs(slow.rows - fast.x).max() < (1e-7 if mu == 0 else 1e-2) * moved
    assert moved > 1e-3


@both
def test_friction_on_sharp_edges_is_coulombs(block, dim):
    """A plate, thinner than the facets, is pressed in and drawn aside: its lower edge alone touches."""
    body, mu = block(dim), 0.5
    plate = Box(np.array([0.002, 0.004, 0.015])[[0, 2] if dim == 2 else slice(None)], name="plate")
    positions = np.full((7, dim), 0.024)
    positions[:, 0] = [0.03, 0.03, 0.032, 0.034, 0.036, 0.038, 0.040]
    positions[:, -1] = [0.066, 0.062, *[0.061] * 5]  # m, of its middle: the top is at 50 mm
    simulator = FullSpaceSimulator(
        body,
        [PlacedCollider("plate", plate, KeyframedPath(np.arange(7) * STEP, positions))],
        contact=PenaltyContact(1e11, 2),
        friction=CoulombFriction(mu, slip_velocity=0.02),
        kinematic=[KinematicHandle("base")],
        # The normal forces are renewed until they no longer change.
        settings=replace(TIGHT, friction_updates=30),
    )
    state = simulator.rest_state()
    for _ in range(6):
        result = simulator.step(state)
        assert result.converged, result.reason
        state = result.state
    normal = simulator.contact_forces(state)["plate"].force
    tangential = result.contacts["plate"].force - normal
    assert np.abs(state.x - body.mesh.points).max() > 1e-3
    assert tangential[0] < 0.0
    # It slips at 0.2 m/s. The normals of the points, all of them on the lower edges, are nearly parallel.
    assert np.linalg.norm(tangential) == pytest.approx(mu * np.linalg.norm(normal), rel=0.05)


@both
def test_one_iteration_is_reported_as_not_converged(block, dim):
    body = block(dim)
    simulator = FullSpaceSimulator(
        body,
        [ball(dim, [0.065, 0.055])],
        contact=CONTACT,
        kinematic=[KinematicHandle("base")],
        settings=DynamicsSettings(STEP, NewtonSettings(1, 1e-6)),
    )
    result = simulator.step(simulator.rest_state())
    assert not result.converged
    assert result.iterations == 1
    assert "ran out" in result.reason


@both
def test_a_body_at_rest_on_a_rough_floor_is_found_at_rest(block, dim):
    """Friction updates its normal forces so often that the last steps are below round-off."""
    floor = PlacedCollider("floor", Plane(-down(dim)), KeyframedPath.constant(RigidPose.identity(dim)))
    scene = {"contact": CONTACT, "gravity": down(dim)}
    standing = FullSpaceSimulator(block(dim), [floor], **scene)
    low = replace(standing.rest_state(), x=block(dim).mesh.points + 1e-4 * down(dim))
    settled = standing.settle(low, NewtonSettings(100, 1e-9))
    assert settled.converged, settled.reason
    settings = DynamicsSettings(STEP, NewtonSettings(50, 1e-6), friction_updates=15)
    rough = FullSpaceSimulator(block(dim), [floor], friction=CoulombFriction(0.5), settings=settings, **scene)
    result = rough.step(settled.state)
    assert result.converged, result.reason
    assert np.abs(result.state.x - settled.state.x).max() < 1e-8  # metres: the tolerance of `settle`


def test_another_optimiser_is_refused(block):
    """It would be ignored: full space has a Newton's method of its own."""
    settings = DynamicsSettings(STEP, optimiser=Newton())
    with pytest.raises(SoftprintError, match="without an optimiser"):
        FullSpaceSimulator(block(2), contact=CONTACT, settings=settings)


@pytest.mark.parametrize("coefficient", [0.3, 5.0], ids=["slips in part", "sticks"])
def test_condensed_friction_gives_way_as_full_space_does(dim: int, coefficient: float) -> None:
    """A ball is pressed 4 mm into a block and dragged by 2.4 mm. The basis alone holds it back by 1.3 (2D) to 5 (3D)
    times the force of full space."""
    divisions = (20, 12) if dim == 2 else (10, 10, 6)
    mesh = box_mesh([0.0] * dim, [0.1, 0.06] if dim == 2 else [0.1, 0.1, 0.06], divisions)
    base = frame_in_box(mesh, "base", [[-1.0] * dim, [1.0] * (dim - 1) + [0.011]])
    material = make_material("stable_neo_hookean", 2e4, 0.4)
    body = assemble_body(mesh, place_handles(mesh, 8, [base]), material, 1000.0, name="block")
    options: dict[str, Any] = {
        "contact": PenaltyContact(1e11, 1),
        "kinematic": [KinematicHandle("base")],
        "friction": CoulombFriction(coefficient, slip_velocity=1e-3),
        "settings": DynamicsSettings(0.01, newton=NewtonSettings(40, 1e-5)),
    }
    ball = [PlacedCollider("ball", Sphere(0.03, dim, "ball"))]

    def pulled(simulator: Simulator | FullSpaceSimulator) -> np.ndarray:
        middle = np.append(np.full(dim - 1, 0.05), 0.09)
        along, down = np.eye(dim)[0], np.eye(dim)[-1]
        places = [middle - depth * down for depth in (0.001, 0.002, 0.003, 0.004)]
        places += [places[-1] + way * along for way in np.arange(1, 9) * 3e-4]
        state = simulator.rest_state(poses={"ball": RigidPose(np.eye(dim), middle + 0.001 * down)})
        for place in places:
            result = simulator.step(state, poses={"ball": RigidPose(np.eye(dim), place)})
            assert result.converged, result.reason
            state = result.state
        return np.asarray(result.contacts["ball"].force)

    true = pulled(FullSpaceSimulator(body, ball, **options))
    mechanics = compute_mechanics(body, 400, condensation=True)
    found = pulled(Simulator(body, ball, mechanics=mechanics, **options))
    assert true[0] < -0.1 * true[-1]  # the block holds the ball back
    # Compliance is linear, and pressure is that without friction: measured 4 to 5 %.
    assert np.linalg.norm(found - true) < 0.1 * np.linalg.norm(true)
