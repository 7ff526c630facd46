"""The reduced simulator: laws that a backward Euler step keeps exactly, and friction on an incline."""

import numpy as np
import pytest

from softprint.runtime.body import ReducedBody, assemble_body, frame_in_box, place_handles
from softprint.runtime.body.cubature import Cubature
from softprint.runtime.body.handles import Handles
from softprint.runtime.body.surface_samples import SurfaceSamples
from softprint.runtime.colliders import Box, KeyframedPath, Plane, RigidPose, Sphere
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.dynamics import (
    DynamicsSettings,
    HandleSpring,
    KinematicHandle,
    NewtonSettings,
    PlacedCollider,
    ReducedState,
    Simulator,
    Status,
)
from softprint.runtime.elasticity import make_material
from softprint.runtime.elasticity.elastic_energy import elastic_energy, elastic_gradient
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import box_mesh

TIGHT = NewtonSettings(max_iterations=50, tolerance=1e-9)
H = 0.01
CONTACT = PenaltyContact(1e8, refinement=0)  # at nodes: simple enough to be written out here
dims = pytest.mark.parametrize("dim", [2, 3])


def make_body(dim, frames=True, points=6):
    mesh = box_mesh([0.0] * dim, [0.1, 0.05, 0.05][:dim], [6, 3, 3][:dim])
    regions = [frame_in_box(mesh, "base", [[-1.0] * dim, [0.02] + [1.0] * (dim - 1)])] if frames else []
    handles = place_handles(mesh, points, regions)
    return assemble_body(mesh, handles, make_material("stable_neo_hookean", 2e4, 0.4), 1000.0, name="box")


def free_body(dim, newton=TIGHT, **options):
    return Simulator(make_body(dim), contact=CONTACT, settings=DynamicsSettings(H, newton), **options)


def moving_state(simulator, scale=1.0):
    """A strained body with every handle at its own velocity; frames rigid."""
    rng = np.random.default_rng(5)
    handles, rest = simulator.body.handles, simulator.rest_state()
    rows = handles.retract(rest.rows, 1e-3 * scale * rng.normal(size=handles.n_dofs))
    velocity = (handles.tangent(rows) @ (0.3 * scale * rng.normal(size=handles.n_dofs))).reshape(rows.shape)
    return ReducedState(0.0, rows, velocity, {})


def angular(positions, momenta):
    """sum_i x_i cross p_i, as the skew matrix x^T p - p^T x (any dimension)."""
    return positions.T @ momenta - momenta.T @ positions


@dims
def test_free_fall_follows_backward_euler(dim):
    gravity = np.array([0.0] * (dim - 1) + [-9.81])
    simulator = free_body(dim, gravity=gravity)
    state = simulator.rest_state()
    for _ in range(5):
        result = simulator.step(state)
        assert result.converged
        state = result.state
    fallen = gravity * H**2 * 15  # sum_{k<=n} k h^2 g = n (n + 1)/2 h^2 g
    expected = simulator.body.mesh.points + fallen
    np.testing.assert_allclose(
        simulator.positions(state), expected, atol=1e-10
    )  # Newton's tolerance, 1e-9 of it


@dims
def test_a_free_body_keeps_its_momentum(dim):
    """Linear momentum exactly; of angular momentum L backward Euler keeps the discrete identity

    x_new x (M v_new) = x_new x (M v_old), so that L_new = L_old + h v_new x (M v_old)."""
    simulator = free_body(dim)
    mass, basis = simulator.body.node_mass[:, None], simulator.body.basis
    state = moving_state(simulator)
    for _ in range(4):
        result = simulator.step(state)
        assert result.converged
        old, new = mass * (basis @ state.rows_velocity), mass * (basis @ result.state.rows_velocity)
        # 1e-9 of a force of some newtons for 0.01 s, on momenta of 0.01 to 0.1 kg m/s.
        np.testing.assert_allclose(new.sum(axis=0), old.sum(axis=0), atol=1e-9)
        x = basis @ result.state.rows
        np.testing.assert_allclose(angular(x, new), angular(x, old), atol=1e-9)
        state = result.state


@dims
def test_a_rigidly_translating_body_keeps_its_shape(dim):
    # No force at all: the tolerance is relative to the smallest force scale.
    simulator = free_body(dim, NewtonSettings())
    rest = simulator.rest_state()
    velocity = np.zeros_like(rest.rows)
    velocity[[*range(6), -1]] = np.arange(1, dim + 1)
    result = simulator.step(ReducedState(0.0, rest.rows, velocity, {}))
    assert result.iterations == 0  # at its position by constant velocity, it is already in balance
    np.testing.assert_allclose(result.state.rows_velocity, velocity, atol=1e-12)


@dims
def test_static_equilibrium_is_preserved(dim):
    simulator = Simulator(
        make_body(dim),
        contact=CONTACT,
        gravity=[0.0] * (dim - 1) + [-9.81],
        kinematic=[KinematicHandle("base")],
        settings=DynamicsSettings(H, NewtonSettings(50, 1e-5)),
    )
    settled = simulator.settle()
    assert settled.converged
    sag = simulator.positions(settled.state)[:, -1] - simulator.body.mesh.points[:, -1]
    assert sag.min() < -1e-4
    result = simulator.step(settled.state)
    assert result.iterations == 0
    np.testing.assert_array_equal(result.state.rows, settled.state.rows)


@dims
def test_a_spring_stretches_by_force_over_stiffness(dim):
    """A floating body hangs from three springs on handles, which together carry its weight."""
    body = make_body(dim)
    target = [KeyframedPath([0.0], [body.mesh.points[body.handles.points[k]]]) for k in range(6)]
    simulator = Simulator(
        body,
        contact=CONTACT,
        gravity=[0.0] * (dim - 1) + [-9.81],
        springs=[HandleSpring(k, 40.0, target[k]) for k in range(6)],
        settings=DynamicsSettings(H, TIGHT),
    )
    settled = simulator.settle(newton=TIGHT)
    assert settled.converged
    stretch = sum(body.mesh.points[body.handles.points[k]] - settled.state.rows[k] for k in range(6))
    expected = [0.0] * (dim - 1) + [9.81 * body.node_mass.sum() / 40.0]
    np.testing.assert_allclose(stretch, expected, atol=1e-7)  # residual 1e-9 of some newtons over 40 N/m


@dims
def test_a_frame_follows_the_rotation_of_its_spring(dim):
    body = make_body(dim)
    angles = [0.4] if dim == 2 else [0.1, 0.4, -0.2]
    pivot = body.handles.position(body.rest_rows, "base")
    target = KeyframedPath([0.0], [pivot], [angles])
    simulator = Simulator(
        body,
        contact=CONTACT,
        springs=[HandleSpring("base", 100.0, target, 1.0)],
        settings=DynamicsSettings(H, TIGHT),
    )
    settled = simulator.settle(newton=NewtonSettings(max_iterations=50))
    assert settled.converged
    rotation = settled.state.rows[-dim - 1 : -1].T
    np.testing.assert_allclose(rotation, target.pose(0).rotation, atol=1e-7)
    assert settled.energies["elastic"] == pytest.approx(0.0, abs=1e-10)  # J: the whole body rotated with it


def test_a_handle_is_held_once():
    """The last of two paths would win in silence."""
    twice = [KinematicHandle("base"), KinematicHandle(0), KinematicHandle("base")]
    with pytest.raises(SoftprintError, match="handle 'base' is given twice"):
        Simulator(make_body(2), contact=CONTACT, kinematic=twice)


@dims
def test_kinematic_handles_follow_their_paths(dim):
    body = make_body(dim)
    angles = [0.3] if dim == 2 else [0.0, 0.3, 0.1]
    lead = KeyframedPath([0.0, 0.05], [[0.0] * dim, [0.01] * dim], [[0.0] * len(angles), angles])
    simulator = Simulator(
        body, contact=CONTACT, kinematic=[KinematicHandle("base", lead), KinematicHandle(0)]
    )
    state = simulator.rest_state()
    for _ in range(3):
        state = simulator.step(state).state
    pose, pivot = lead.pose(state.time), body.handles.position(body.rest_rows, "base")
    region = body.handles.frames[0].nodes
    expected = pose.rotate(body.mesh.points[region] - pivot) + pivot + pose.translation
    np.testing.assert_allclose(simulator.positions(state)[region], expected, atol=1e-12)
    np.testing.assert_array_equal(state.rows[0], body.rest_rows[0])


def whole_mesh_as_subspace(dim):
    """A body whose basis is the identity: every node a point handle, every cell a cubature cell."""
    mesh = box_mesh([0.0] * dim, [0.06, 0.03, 0.03][:dim], [3, 2, 2][:dim])
    material = make_material("stable_neo_hookean", np.full(mesh.n_cells, 2e4), np.full(mesh.n_cells, 0.4))
    mass = mesh.lump(1000.0 * mesh.cell_volumes)
    return ReducedBody(
        mesh=mesh,
        handles=Handles(dim, np.arange(mesh.n_nodes), ()),
        basis=np.eye(mesh.n_nodes),
        material=material,
        density=np.full(mesh.n_cells, 1000.0),
        node_mass=mass,
        reduced_mass=np.diag(mass),
        cubature=Cubature(np.arange(mesh.n_cells), mesh.cell_volumes, 0.0, 0.0),
        surface=SurfaceSamples(mesh.surface_nodes, mesh.surface_areas),
        name="identity",
    )


@dims
def test_with_the_identity_as_basis_it_is_full_space_dynamics(dim):
    """The step satisfies the full-space backward Euler equations, assembled here node by node:

    M (v_new - v_old)/h = -dW_elastic/dx - dW_contact/dx + M g on every free node."""
    body = whole_mesh_as_subspace(dim)
    gravity = np.array([0.0] * (dim - 1) + [-9.81])
    held = np.flatnonzero(body.mesh.points[:, 0] == 0.0)
    ball, above = Sphere(0.02, dim, "ball"), np.array([0.05, 0.049, 0.02])[:dim]
    simulator = Simulator(
        body,
        [PlacedCollider("ball", ball)],
        contact=CONTACT,
        gravity=gravity,
        kinematic=[KinematicHandle(int(node)) for node in held],
        settings=DynamicsSettings(H, TIGHT),
    )
    state = simulator.rest_state(poses={"ball": RigidPose(np.eye(dim), above)})
    free = np.setdiff1d(np.arange(body.n_nodes), held)
    for number in range(3):
        pose = RigidPose(np.eye(dim), above - (0.004 + 0.004 * number) * np.eye(dim)[1])
        result = simulator.step(state, {"ball": pose})
        assert result.converged
        x, v = result.state.rows, result.state.rows_velocity
        terms = CONTACT.terms(x[body.surface.nodes], body.surface.areas, ball, pose)
        assert len(terms.index) > 0
        contact = np.zeros_like(x)
        contact[body.surface.nodes[terms.index]] = terms.gradient
        elastic = elastic_gradient(body.mesh, body.material, x)
        change = body.node_mass[:, None] * (v - state.rows_velocity) / H
        balance = change + elastic + contact - body.node_mass[:, None] * gravity
        assert np.linalg.norm(balance[free]) < 1e-8 * np.linalg.norm(contact)  # Newton's tolerance is 1e-9
        np.testing.assert_array_equal(x[held], body.mesh.points[held])
        assert result.energies["elastic"] == pytest.approx(
            elastic_energy(body.mesh, body.material, x), rel=1e-12
        )
        np.testing.assert_allclose(result.contacts["ball"].force, contact.sum(axis=0), atol=1e-12)
        state = result.state


@pytest.mark.parametrize(("angle", "slides"), [(12.0, False), (22.0, True)])
def test_a_block_on_an_incline_slides_above_the_angle_of_friction(angle, slides):
    """mu = 0.3: the angle of friction is 16.7 degrees. A sliding block gains g (sin - mu cos) a second."""
    mu, slip = 0.3, 1e-3
    mesh = box_mesh([0.0, 0.0], [0.08, 0.04], [8, 4])
    handles = place_handles(mesh, 6, [frame_in_box(mesh, "top", [[-1, 0.025], [1, 1]])])
    body = assemble_body(mesh, handles, make_material("stable_neo_hookean", 2e5, 0.4), 1000.0)
    slope = np.radians(angle)
    simulator = Simulator(
        body,
        [PlacedCollider("floor", Plane([0.0, 1.0], "floor"), KeyframedPath([0.0], [[0.0, 0.0]]))],
        contact=PenaltyContact(1e9),
        friction=CoulombFriction(mu, slip),
        gravity=9.81 * np.array([np.sin(slope), -np.cos(slope)]),
        settings=DynamicsSettings(0.005, NewtonSettings(50, 1e-6)),
    )
    state = simulator.rest_state()
    for _ in range(120):
        result = simulator.step(state)
        state = result.state
    mass = body.node_mass
    speed = (mass @ (body.basis @ state.rows_velocity))[0] / mass.sum()
    force = result.contacts["floor"].force
    if slides:
        # The block lands and rocks a little in the first 0.1 s of 0.6 s.
        assert speed == pytest.approx(0.6 * 9.81 * (np.sin(slope) - mu * np.cos(slope)), rel=0.1)
        assert force[0] == pytest.approx(-mu * force[1], rel=1e-3)
    else:
        assert 0 <= speed < slip  # it creeps below the slip velocity, which is what "sticks" means here
        assert force[0] == pytest.approx(mass.sum() * 9.81 * np.sin(slope), rel=0.02)


def test_a_moving_floor_carries_a_block():
    """Friction is relative to the collider: on a floor that moves steadily the body is carried along."""
    body = make_body(2, frames=False)
    path = KeyframedPath([0.0, 1.0], [[0.0, 0.0], [0.05, 0.0]])
    simulator = Simulator(
        body,
        [
            PlacedCollider(
                "floor", Box([1.0, 0.1], name="floor"), KeyframedPath(path.times, path.positions - [0, 0.1])
            )
        ],
        contact=PenaltyContact(1e9),
        friction=CoulombFriction(0.5),
        gravity=[0.0, -9.81],
        settings=DynamicsSettings(H),
    )
    state = simulator.rest_state()
    for _ in range(50):
        state = simulator.step(state).state
    drift = (body.node_mass @ (body.basis @ state.rows - body.mesh.points))[0] / body.node_mass.sum()
    assert drift == pytest.approx(path.pose(state.time).translation[0], rel=0.02)  # creep and the first slip


def test_one_iteration_is_reported_as_not_converged():
    simulator = Simulator(
        make_body(3),
        contact=CONTACT,
        gravity=[0, 0, -9.81],
        kinematic=[KinematicHandle("base")],
        settings=DynamicsSettings(H, NewtonSettings(max_iterations=1)),
    )
    result = simulator.step(simulator.rest_state())
    assert result.status is Status.MAX_ITERATIONS
    assert not result.converged
    assert result.iterations == 1
    assert result.residual > 1e-4
    assert "iterations ran out" in result.reason
    assert set(result.timings) == {"positions", "elastic", "contact", "correction", "solve", "total"}


def test_contact_forces_agree_with_the_step_and_with_newtons_third_law():
    """A body at rest on a floor: the floor carries its weight, with the torque of its centre of mass."""
    body = make_body(2, frames=False)
    simulator = Simulator(
        body,
        [PlacedCollider("floor", Plane([0.0, 1.0], "floor"), KeyframedPath([0.0], [[0.0, 0.0]]))],
        contact=PenaltyContact(1e9),
        gravity=[0.0, -9.81],
        settings=DynamicsSettings(H, TIGHT),
    )
    state = simulator.rest_state()
    for _ in range(150):
        result = simulator.step(state)
        state = result.state
    contact = result.contacts["floor"]
    weight = 9.81 * body.node_mass.sum()
    np.testing.assert_allclose(contact.force, [0.0, -weight], atol=0.02 * weight)  # still swinging a little
    np.testing.assert_allclose(simulator.contact_forces(state)["floor"].force, contact.force, rtol=1e-12)
    centre = (body.node_mass @ (body.basis @ state.rows))[0] / body.node_mass.sum()
    np.testing.assert_allclose(contact.torque, [-weight * centre], rtol=0.03)
    assert 0 < contact.penetration == result.penetration < 2e-3


@dims
def test_deformation_gradients_are_those_of_the_positions(dim):
    simulator = free_body(dim)
    state = moving_state(simulator)
    F = simulator.deformation_gradients(state)
    np.testing.assert_allclose(F, simulator.body.mesh.deformation_gradients(simulator.positions(state)))
    np.testing.assert_array_equal(simulator.deformation_gradients(state, np.array([3])), F[[3]])


def test_inconsistent_inputs_are_refused():
    body, ball = make_body(3), PlacedCollider("ball", Sphere(0.02, 3, "ball"))
    with pytest.raises(SoftprintError, match="gravity must be 3 numbers"):
        Simulator(body, contact=CONTACT, gravity=[0.0, -9.81])
    with pytest.raises(SoftprintError, match="must be 3D"):
        Simulator(body, [PlacedCollider("disc", Sphere(0.02, 2, "disc"))], contact=CONTACT)
    with pytest.raises(SoftprintError, match="same name"):
        Simulator(body, [ball, ball], contact=CONTACT)
    with pytest.raises(SoftprintError, match="no frame named 'bass'"):
        Simulator(body, contact=CONTACT, kinematic=[KinematicHandle("bass")])
    simulator = Simulator(body, [ball], contact=CONTACT)
    with pytest.raises(SoftprintError, match="has no path"):
        simulator.rest_state()
    with pytest.raises(SoftprintError, match="no collider of this scene"):
        simulator.rest_state(poses={"ball": RigidPose.identity(3), "bell": RigidPose.identity(3)})
    with pytest.raises(SoftprintError, match="time step must be"):
        DynamicsSettings(time_step=0.0)
    with pytest.raises(SoftprintError, match="only frames have a rotation"):
        HandleSpring(0, 1.0, KeyframedPath([0.0], [[0.0, 0.0, 0.0]]), rotation_stiffness=1.0)


def test_slips_are_refused_in_a_sentence(jelly_body, dim):
    """Each says what is wrong, and none is noticed only in a later step."""
    law, ball = PenaltyContact(1e10), PlacedCollider("ball", Sphere(0.02, dim, "ball"))

    def made(colliders=(ball,), **other):
        return Simulator(jelly_body, colliders, **{"contact": law, **other})

    for slip, sentence in (
        ({"colliders": [ball.collider]}, "a collider must be a PlacedCollider, not a Sphere"),
        ({"contact": 1e10}, "contact must be a PenaltyContact, not a float"),
        ({"kinematic": ["base"]}, "a kinematic handle must be a KinematicHandle, not a str"),
        ({"friction": 0.3}, "friction must be a CoulombFriction, not a float"),
        ({"mechanics": "mechanics.safetensors"}, "mechanics must be a BodyMechanics, not a str"),
        ({"settings": 0.01}, "settings must be a DynamicsSettings, not a float"),
    ):
        with pytest.raises(SoftprintError, match=sentence):
            made(**slip)
    simulator, above = made(), RigidPose(np.eye(dim), 0.2 * np.eye(dim)[-1])
    with pytest.raises(SoftprintError, match="a pose was given for bal, which is no collider"):
        simulator.rest_state(poses={"bal": above})
    with pytest.raises(SoftprintError, match="must be a RigidPose, not a ndarray"):
        simulator.rest_state(poses={"ball": above.translation})
    flat = RigidPose(np.eye(5 - dim), np.zeros(5 - dim))
    with pytest.raises(SoftprintError, match=f"is {5 - dim}D, and the collider is {dim}D"):
        simulator.rest_state(poses={"ball": flat})
    with pytest.raises(SoftprintError, match=r"other colliders \(ball in one of the two\)"):
        simulator.step(made([]).rest_state(), {"ball": above})
    result = simulator.step(simulator.rest_state(poses={"ball": above}), {"ball": above})
    with pytest.raises(SoftprintError, match="the state must be a ReducedState, not a StepResult"):
        simulator.step(result, {"ball": above})
