"""Dynamics with static condensation: statics against full space, invariance, and stability in free flight."""

from dataclasses import replace
from multiprocessing.reduction import ForkingPickler

import numpy as np
import pytest

from softprint.runtime.body import assemble_body, frame_in_box, place_handles
from softprint.runtime.body.cubature import Cubature, elastic_cells
from softprint.runtime.body.rotations import rotation_exponential
from softprint.runtime.colliders import KeyframedPath, RigidPose, Sphere
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.dynamics import (
    DynamicsSettings,
    KinematicHandle,
    NewtonSettings,
    PlacedCollider,
    Simulator,
)
from softprint.runtime.dynamics.state import ReducedState
from softprint.runtime.dynamics.terms.weight import Weight
from softprint.runtime.elasticity import make_material
from softprint.runtime.elasticity.elastic_energy import elastic_energy, elastic_gradient, element_hessians
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.force.correction import ForceCorrection
from softprint.runtime.learned.force.model import ForceModel, ForceModelOptions
from softprint.runtime.mechanics.body_mechanics import BodyMechanics, compute_mechanics
from softprint.runtime.mechanics.compliance.null_space_compliance import NullSpaceCompliance
from softprint.runtime.mechanics.corotation import local_gradients, mean_gradients
from softprint.runtime.mechanics.joint_settling import Joints, JointSettling
from softprint.runtime.mechanics.static_condensation import compute_static_condensation
from softprint.runtime.mesh import box_mesh

TIGHT = NewtonSettings(max_iterations=50, tolerance=1e-9)
CONTACT = PenaltyContact(1e8)


def make_body(dim, frames=True, young=2e4, divisions=(8, 4, 4)):
    mesh = box_mesh([0.0] * dim, [0.1, 0.05, 0.05][:dim], divisions[:dim])
    regions = [frame_in_box(mesh, "base", [[-1.0] * dim, [0.015] + [1.0] * (dim - 1)])] if frames else []
    handles = place_handles(mesh, 6, regions)
    return assemble_body(mesh, handles, make_material("stable_neo_hookean", young, 0.4), 1000.0, name="bar")


def down(dim):
    return np.array([0.0] * (dim - 1) + [-9.81])


def condensed(body, gradients=None):
    """Mechanics with static condensation and penalty contact; gradients: of its rotations, its own by default."""
    found = compute_static_condensation(body, None, NullSpaceCompliance(body))
    return BodyMechanics(
        None, found if gradients is None else replace(found, rotation_gradients=gradients(body))
    )


def linearise(elastic, rows, frame_rows):
    """Energy, gradient and Hessian."""
    found = elastic.in_frame(frame_rows).evaluate(rows, None)
    return found.energy, *found.linearise(None)


def full_space_statics(body, gravity):
    """Nodes (n_nodes, dim) in static equilibrium under gravity, frames held: Newton with dense matrices."""
    mesh, dim = body.mesh, body.dim
    free = np.setdiff1d(np.arange(body.n_nodes), body.handles.frame_nodes)
    unknowns = (free[:, None] * dim + np.arange(dim)).ravel()
    dofs = (mesh.cells[:, :, None] * dim + np.arange(dim)).reshape(mesh.n_cells, -1)
    x = mesh.points.copy()
    for _ in range(20):
        residual = elastic_gradient(mesh, body.material, x) - body.node_mass[:, None] * gravity
        tangent = body.material.tangent(mesh.deformation_gradients(x))
        hessian = np.zeros((x.size, x.size))
        blocks = element_hessians(tangent, mesh.cell_gradients, mesh.cell_volumes)
        np.add.at(hessian, (dofs[:, :, None], dofs[:, None, :]), blocks)
        step = np.linalg.solve(hessian[np.ix_(unknowns, unknowns)], residual[free].ravel())
        x[free] -= step.reshape(-1, dim)
        if np.abs(step).max() < 1e-12:
            return x
    raise AssertionError("full space found no equilibrium")


def sag_error(simulator, exact):
    settled = simulator.settle(newton=NewtonSettings(max_iterations=50, tolerance=1e-7))
    assert settled.converged
    x = simulator.positions(settled.state)
    return np.linalg.norm(x - exact) / np.linalg.norm(exact - simulator.body.mesh.points)


def test_a_clamped_bar_sags_as_in_full_space(dim):
    body = make_body(dim)
    options = {"contact": CONTACT, "gravity": down(dim), "kinematic": [KinematicHandle("base")]}
    exact = full_space_statics(body, down(dim))
    bare = sag_error(Simulator(body, **options), exact)
    settled = sag_error(Simulator(body, **options, mechanics=condensed(body)), exact)
    # The sag is a few per cent of the length; what is left is of second order in it.
    assert settled < 0.1 * bare


def test_small_sag_is_exact_whatever_the_cubature(dim):
    """To first order in strain static condensation is full space, and what cubature misses is made up for."""
    body = make_body(dim, young=1e7, divisions=(16, 8, 4))
    gravity = down(dim)
    simulator = Simulator(
        body,
        contact=CONTACT,
        gravity=gravity,
        kinematic=[KinematicHandle("base")],
        mechanics=condensed(body),
    )
    assert len(body.cubature.cells) < len(elastic_cells(body.mesh, body.handles))
    # Strains of 1e-4: that much of the sag is of second order. Measured: 4e-5 and 5e-5; without it, a quarter.
    assert sag_error(simulator, full_space_statics(body, gravity)) < 1e-4


def all_cells(body):
    """With every cell in the cubature, so that there is nothing to make up for, at any deformation."""
    cells = elastic_cells(body.mesh, body.handles)
    return replace(body, cubature=Cubature(cells, body.mesh.cell_volumes[cells], 0.0, 0.0))


def strained(body, seed=0, scale=4e-3):
    way = np.random.default_rng(seed).normal(size=body.n_dofs)
    return body.handles.retract(body.rest_rows, scale * way)


def test_elastic_energy_is_that_of_the_positions(dim):
    """Where all of the body has one rotation, any one."""
    body = all_cells(make_body(dim))
    mechanics = condensed(body, mean_gradients)
    simulator = Simulator(body, contact=CONTACT, gravity=down(dim), mechanics=mechanics)
    rows, frame_rows = strained(body), strained(body, seed=1, scale=0.03)
    state = replace(simulator.rest_state(), rows=rows, frame_rows=frame_rows)
    found = simulator._terms.elastic.in_frame(frame_rows).evaluate(rows, None).energy
    # float32 of the displacements of all nodes.
    expected = elastic_energy(body.mesh, body.material, simulator.positions(state))
    assert found == pytest.approx(expected, rel=1e-6)
    field = simulator.deformation_gradients(state, np.array([5]))
    np.testing.assert_allclose(field, body.mesh.deformation_gradients(simulator.positions(state))[[5]])


def test_elastic_energy_of_a_cell_is_as_seen_from_it(dim):
    """Its corners are where they would be, had they rotated with the cell."""
    body = all_cells(make_body(dim))
    rows, frame_rows = strained(body), strained(body, seed=1)
    mechanics = condensed(body, local_gradients)
    simulator = Simulator(body, contact=CONTACT, gravity=down(dim), mechanics=mechanics)
    condensation = simulator.mechanics.condensation
    corners = body.mesh.cells[body.cubature.cells]
    gradients = condensation.rotation_gradients[corners].mean(axis=1).repeat(dim + 1, axis=0)
    at_corners = replace(condensation.at(corners.ravel()), rotation_gradients=gradients).corotated(frame_rows)
    x = body.basis[corners.ravel()] @ rows + at_corners.displacement(rows)
    assert np.abs(at_corners.rotations - at_corners.rotations[0]).max() > 0.01
    F = np.einsum(
        "cai,caj->cij", x.reshape(*corners.shape, dim), body.mesh.cell_gradients[body.cubature.cells]
    )
    expected = body.cubature.weights @ body.material.at(body.cubature.cells).energy_density(F)
    found = simulator._terms.elastic.in_frame(frame_rows).evaluate(rows, None).energy
    assert found == pytest.approx(expected, rel=1e-6)  # float32


def test_derivatives_of_the_elastic_energy(dim):
    """With frame rows far from the rows, in single precision for the Hessian only."""
    body = make_body(dim, divisions=(16, 8, 4))
    assert len(body.cubature.cells) < len(elastic_cells(body.mesh, body.handles))
    mechanics = condensed(body, local_gradients)
    elastic = Simulator(body, contact=CONTACT, gravity=down(dim), mechanics=mechanics)._terms.elastic
    rows, frame_rows = strained(body), strained(body, seed=1, scale=0.02)
    _, gradient, hessian = linearise(elastic, rows, frame_rows)
    way, h = np.random.default_rng(2).normal(size=rows.shape), 1e-6
    ahead, behind = (linearise(elastic, rows + side * h * way, frame_rows) for side in (1, -1))
    # Central differences: h^2 = 1e-12 over the square of a strain of some per cent, and round-off.
    assert (ahead[0] - behind[0]) / (2 * h) == pytest.approx(np.vdot(gradient, way), rel=1e-6)
    change = (ahead[1] - behind[1]).ravel() / (2 * h)
    assert np.abs(hessian() @ way.ravel() - change).max() < 1e-5 * np.abs(change).max()
    along = np.random.default_rng(3).normal(size=(rows.size, 3))
    np.testing.assert_allclose(
        hessian(along), along.T @ hessian() @ along, rtol=1e-4, atol=1e-5 * np.abs(hessian(along)).max()
    )


def test_the_cubature_residual_rotates_by_regions(dim):
    """Expanded about the frame rows, it is the sum over regions of what each of them sees."""
    body = make_body(dim, divisions=(16, 8, 4))
    mechanics = condensed(body, local_gradients)
    simulator = Simulator(body, contact=CONTACT, gravity=down(dim), mechanics=mechanics)
    condensation = simulator.mechanics.condensation
    residual = simulator._terms.elastic._residual
    rows, frame_rows = strained(body), strained(body, seed=1, scale=0.02)
    value, slope, stiffness = residual.about(frame_rows)
    change = (rows - frame_rows).ravel()
    expected, n, rotations = 0.0, body.n_rows + 1, residual._corotation.rotations(frame_rows)
    # One frame is felt everywhere; stored over (row, axis, axis, row).
    by_region = residual._blocks.reshape(-1, n, dim, dim, n).transpose(0, 1, 2, 4, 3)
    for M, R in zip(by_region, rotations, strict=True):
        z = np.vstack(
            [condensation.centred(rows) @ R - condensation.centred_rest_rows, condensation.gravity @ R]
        ).ravel()
        expected += 0.5 * z @ M.reshape(z.size, z.size) @ z
    found = value + slope @ change + 0.5 * change @ stiffness @ change
    # float32 of the modes, which annihilate translations.
    assert found == pytest.approx(expected, rel=1e-6)
    assert len(rotations) == body.handles.n_points + 1


def test_the_weight_is_that_of_the_positions(dim):
    """Region by region, which is the same where all of the body has one rotation."""
    body = make_body(dim)
    condensation = condensed(body, mean_gradients).condensation.under(down(dim))
    rows, frame_rows = strained(body), strained(body, seed=1, scale=0.03)
    force, height = Weight(body, down(dim), condensation).form(frame_rows)
    x = body.basis @ rows + condensation.corotated(frame_rows).displacement(rows)
    # float32 of the condensation.
    assert height - np.vdot(force, rows) == pytest.approx(-body.node_mass @ x @ down(dim), rel=1e-6)


def test_settled_is_left_alone(dim):
    body = make_body(dim)
    simulator = Simulator(
        body,
        contact=CONTACT,
        gravity=down(dim),
        kinematic=[KinematicHandle("base")],
        mechanics=condensed(body),
    )
    settled = simulator.settle()
    assert simulator.step(settled.state).iterations == 0


def test_a_rotated_scene_gives_the_rotated_motion(dim):
    """Body, gravity and collider rotated by a right angle and more; a ball rubs against the body."""
    angle = np.array([0.5 * np.pi] if dim == 2 else [0.5 * np.pi, 0.2, -0.4])
    rotation = rotation_exponential(angle)
    body = make_body(dim)
    base = body.handles.frames[0]
    ball = PlacedCollider("ball", Sphere(0.03, dim, "ball"))
    where = np.array([0.08, 0.072, 0.03])[:dim]

    def play(angle):
        rotation = rotation_exponential(angle)
        gravity = rotation @ down(dim)
        held = KinematicHandle("base", KeyframedPath([0.0], [rotation @ base.pivot - base.pivot], [angle]))
        simulator = Simulator(
            body,
            [ball],
            contact=CONTACT,
            friction=CoulombFriction(0.3, 0.05),
            gravity=gravity,
            kinematic=[held],
            settings=DynamicsSettings(0.01, TIGHT),
            mechanics=condensed(body),
        )
        rows = body.rest_rows @ rotation.T
        state = ReducedState(0.0, rows, np.zeros_like(rows), {"ball": RigidPose(rotation, rotation @ where)})
        for k in range(1, 4):
            pose = RigidPose(rotation, rotation @ (where - 0.002 * k * np.eye(dim)[1]))
            result = simulator.step(state, {"ball": pose})
            state = result.state
        return simulator.positions(state), result.contacts["ball"].force

    (x, force), (there, force_there) = play(0.0 * angle), play(angle)
    assert np.linalg.norm(force) > 0.01
    # The residual of Newton's method and the float32 of the surface.
    np.testing.assert_allclose(there, x @ rotation.T, atol=1e-8)
    np.testing.assert_allclose(force_there, rotation @ force, atol=1e-5 * np.linalg.norm(force))


@pytest.mark.parametrize("frames", [True, False], ids=["frame", "free"])
def test_a_body_in_free_flight_keeps_its_momentum_and_gains_no_energy(dim, frames):
    body = make_body(dim, frames)
    simulator = Simulator(
        body,
        contact=CONTACT,
        settings=DynamicsSettings(0.005, NewtonSettings(50, 1e-7)),
        mechanics=condensed(body),
    )
    rest = simulator.rest_state()
    # A spin of 10 rad/s about the corner, so that it flies as well as rotates, for 1 s.
    spin = rotation_exponential(np.array([1e-6] if dim == 2 else [2e-7, 9e-7, 4e-7]))
    velocity = 1e7 * (rest.rows @ (spin - np.eye(dim)).T)
    state = ReducedState(0.0, rest.rows, velocity, {})
    mass = body.basis.T @ body.node_mass
    momentum, energy = mass @ velocity, np.inf
    for _ in range(200):
        result = simulator.step(state)
        assert result.converged
        state = result.state
        now = result.energies["kinetic"] + result.energies["elastic"]
        # Newton's tolerance, and the rotation that lags behind by a step.
        assert now < energy * (1 + 1e-5)
        energy = now
    assert np.abs(body.reduced_positions(state.rows) - body.mesh.points).max() > 0.1
    # 200 residuals of 1e-7 of some newtons for 5 ms.
    np.testing.assert_allclose(mass @ state.rows_velocity, momentum, atol=1e-6)


def test_a_condensation_of_some_nodes_is_refused():
    body = make_body(2)
    condensation = condensed(body).condensation
    with pytest.raises(SoftprintError, match="all of them"):
        Simulator(body, contact=CONTACT, mechanics=BodyMechanics(None, condensation.at(np.arange(3))))


STIFFNESS, TOP = 1e9, 0.06  # N/m^4; m, of the block


def corrected(body, dim):
    """A ball with an untrained correction of the forces on it."""
    mechanics = compute_mechanics(body, 200, condensation=True, gravity=down(dim))
    model = ForceModel(ForceModelOptions((8,), "silu", 5e-4, 2e-3, STIFFNESS), dim, body.n_rows)
    ball = Sphere(0.02, dim, "ball")
    return PlacedCollider("ball", ball, correction=ForceCorrection("untrained", model, body, ball, mechanics))


def with_joints_that_settle(mechanics, body):
    """The same, and what is learned of bent joints, of which this body has none."""
    joints = Joints.of(body)
    weights = np.ones((body.n_nodes, body.dim, 1))
    settling = JointSettling(joints, np.zeros((1, len(joints.pairs), 2 * body.dim - 3)), weights)
    return mechanics._replace(condensation=replace(mechanics.condensation, settling=settling))


def poses_above(dim, *depths):
    """Of the ball over a node of the mesh, pressed so far [m] into the top of the block."""
    aside = np.full(dim - 1, 0.01)
    return [{"ball": RigidPose(np.eye(dim), np.append(aside, TOP + 0.02 - depth))} for depth in depths]


def pressed(body, dim, colliders, mechanics, **options):
    """A simulator of the block, held by its base."""
    return Simulator(
        body,
        colliders,
        contact=PenaltyContact(STIFFNESS),
        mechanics=mechanics,
        gravity=down(dim),
        kinematic=[KinematicHandle("base")],
        **options,
    )


def test_a_correction_needs_the_mechanics_and_the_stiffness_it_was_trained_with(jelly_body, dim):
    ball = corrected(jelly_body, dim)
    mechanics = ball.correction.mechanics
    fewer = compute_mechanics(jelly_body, 20, condensation=False)
    for other in (None, BodyMechanics(None, mechanics.condensation), fewer):
        with pytest.raises(SoftprintError, match=r"those that it was trained with, `correction\.mechanics`"):
            pressed(jelly_body, dim, [ball], other)
    with pytest.raises(
        SoftprintError, match=r"was trained for a contact stiffness of 1e\+09 N/m\^4, not for 2e"
    ):
        Simulator(jelly_body, [ball], contact=PenaltyContact(2e9), mechanics=mechanics)
    assert pressed(jelly_body, dim, [ball], mechanics).mechanics.compliance is mechanics.compliance


def test_a_correction_needs_joints_that_settle_as_in_its_training(jelly_body, dim):
    ball = corrected(jelly_body, dim)
    plain = ball.correction.mechanics
    settled = with_joints_that_settle(plain, jelly_body)
    own = ForceCorrection("untrained", ball.correction.model, jelly_body, ball.collider, settled)
    learned = replace(ball, correction=own)
    with pytest.raises(SoftprintError, match=r"those that it was trained with, `correction\.mechanics`"):
        pressed(jelly_body, dim, [learned], plain)
    pressed(jelly_body, dim, [learned], with_joints_that_settle(plain, jelly_body))  # equal, in arrays of its own
    pressed(jelly_body, dim, [ball], settled)  # it knows of no joints


def test_a_correction_is_refused_on_another_shape_of_its_name(jelly_body, dim):
    ball = corrected(jelly_body, dim)
    mechanics, radius = ball.correction.mechanics, ball.collider.radius
    larger = replace(ball, collider=Sphere(1.02 * radius, dim, ball.collider.name))
    with pytest.raises(
        SoftprintError, match="of another shape or size than the one that is placed: make it for"
    ):
        pressed(jelly_body, dim, [larger], mechanics)
    again = replace(ball, collider=Sphere(radius, dim, ball.collider.name))
    assert pressed(jelly_body, dim, [again], mechanics).colliders[0] is again


def test_the_gravity_of_mechanics_is_that_of_the_simulator(jelly_body, dim):
    ball = corrected(jelly_body, dim)
    mechanics, (poses,) = ball.correction.mechanics, poses_above(dim, 0.003)

    def settled(mechanics):
        simulator = pressed(jelly_body, dim, [ball], mechanics)
        result = simulator.settle(simulator.rest_state(poses=poses))
        assert result.contacts["ball"].points > 0
        return simulator.positions(result.state)

    weightless = mechanics.under(np.zeros(dim))
    np.testing.assert_array_equal(settled(weightless), settled(mechanics))


def test_a_step_is_a_function_of_its_arguments(jelly_body, dim):
    """Whatever else was stepped in between: the same bits; from a copy of the state in another simulator too."""
    ball = corrected(jelly_body, dim)
    poses, deeper, other = poses_above(dim, 0.003, 0.004, 0.0005)
    options = {"friction": CoulombFriction(0.3, 0.05), "settings": DynamicsSettings(0.01)}
    simulator, again = (
        pressed(jelly_body, dim, [ball], ball.correction.mechanics, **options) for _ in range(2)
    )
    begin = simulator.step(simulator.rest_state(poses=poses), poses).state
    assert begin.contact is not None
    once = simulator.step(begin, deeper)
    assert once.contacts["ball"].points > 0
    simulator.step(once.state, other)
    for same in (
        simulator.step(begin, deeper),
        again.step(ForkingPickler.loads(ForkingPickler.dumps(begin)), deeper),
    ):
        np.testing.assert_array_equal(same.state.rows, once.state.rows)
        np.testing.assert_array_equal(same.contacts["ball"].force, once.contacts["ball"].force)
