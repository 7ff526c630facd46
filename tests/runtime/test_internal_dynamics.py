"""Dynamics with the internal response: statics against full space, invariance, and stability in free flight."""

from dataclasses import replace

import numpy as np
import pytest

from runtime.body import assemble_body, frame_in_box, place_handles
from runtime.body.cubature import Cubature, elastic_cells
from runtime.body.rotations import rotation_exponential
from runtime.colliders import KeyframedPath, RigidPose, Sphere
from runtime.contact import CoulombFriction, PenaltyContact
from runtime.dynamics import DynamicsSettings, KinematicHandle, NewtonSettings, PlacedCollider, Simulator
from runtime.dynamics.state import ReducedState
from runtime.dynamics.terms.weight import Weight
from runtime.elasticity import make_material
from runtime.elasticity.elastic_energy import elastic_energy, elastic_gradient, element_hessians
from runtime.errors import SoftprintError
from runtime.learned.force.correction import ForceCorrection
from runtime.learned.force.model import ForceModel, ForceModelOptions
from runtime.mechanics.body_mechanics import compute_mechanics
from runtime.mechanics.corotation import local_gradients, mean_gradients
from runtime.mechanics.null_space_compliance import NullSpaceCompliance
from runtime.mechanics.static_condensation import compute_static_condensation
from runtime.mesh import box_mesh

TIGHT = NewtonSettings(max_iterations=50, tolerance=1e-9)
CONTACT = PenaltyContact(1e8)


def make_body(dim, frames=True, young=2e4, divisions=(8, 4, 4)):
    mesh = box_mesh([0.0] * dim, [0.1, 0.05, 0.05][:dim], divisions[:dim])
    regions = [frame_in_box(mesh, "base", [[-1.0] * dim, [0.015] + [1.0] * (dim - 1)])] if frames else []
    handles = place_handles(mesh, 6, regions)
    return assemble_body(mesh, handles, make_material("stable_neo_hookean", young, 0.4), 1000.0, name="bar")


def down(dim):
    return np.array([0.0] * (dim - 1) + [-9.81])


def respond(body, gravity):
    return compute_static_condensation(body, gravity, NullSpaceCompliance(body))


def respond_by_parts(body, gravity):
    """Each turned by itself, as where a body has several frames."""
    return replace(respond(body, gravity), turning=local_gradients(body))


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
    internal = sag_error(Simulator(body, **options, internal=respond(body, down(dim))), exact)
    # The sag is a few per cent of the length; what is left is of second order in it.
    assert internal < 0.1 * bare


def test_small_sag_is_exact_whatever_the_cubature(dim):
    """To first order in strain static condensation is full space, and what cubature misses is made up for."""
    body = make_body(dim, young=1e7, divisions=(16, 8, 4))
    gravity = down(dim)
    simulator = Simulator(
        body,
        contact=CONTACT,
        gravity=gravity,
        kinematic=[KinematicHandle("base")],
        internal=respond(body, gravity),
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
    """Where all of the body turns as one, by any rotation."""
    body = all_cells(make_body(dim))
    internal = replace(respond(body, down(dim)), turning=mean_gradients(body))
    simulator = Simulator(body, contact=CONTACT, gravity=down(dim), internal=internal)
    rows, turn = strained(body), strained(body, seed=1, scale=0.03)
    state = replace(simulator.rest_state(), rows=rows, turn=turn)
    found = simulator._elastic.energy(rows, turn, None)
    # float32 of the displacements of all nodes.
    expected = elastic_energy(body.mesh, body.material, simulator.positions(state))
    assert found == pytest.approx(expected, rel=1e-6)
    field = simulator.deformation_gradients(state, np.array([5]))
    np.testing.assert_allclose(field, body.mesh.deformation_gradients(simulator.positions(state))[[5]])


def test_elastic_energy_of_a_cell_is_as_seen_from_it(dim):
    """Its corners are where they would be, had they turned with the cell."""
    body = all_cells(make_body(dim))
    internal = respond_by_parts(body, down(dim))
    rows, turn = strained(body), strained(body, seed=1)
    simulator = Simulator(body, contact=CONTACT, gravity=down(dim), internal=internal)
    corners = body.mesh.cells[body.cubature.cells]
    turning = internal.turning[corners].mean(axis=1).repeat(dim + 1, axis=0)
    at_corners = replace(internal.at(corners.ravel()), turning=turning)
    x = body.basis[corners.ravel()] @ rows + at_corners.displacement(rows, turn)
    turns = at_corners.turns(turn)
    assert np.abs(turns - turns[0]).max() > 0.01
    F = np.einsum(
        "cai,caj->cij", x.reshape(*corners.shape, dim), body.mesh.cell_gradients[body.cubature.cells]
    )
    expected = body.cubature.weights @ body.material.at(body.cubature.cells).energy_density(F)
    assert simulator._elastic.energy(rows, turn, None) == pytest.approx(expected, rel=1e-6)  # float32


def test_derivatives_of_the_elastic_energy(dim):
    """With a turn far from the rows, in single precision for the Hessian only."""
    body = make_body(dim, divisions=(16, 8, 4))
    assert len(body.cubature.cells) < len(elastic_cells(body.mesh, body.handles))
    elastic = Simulator(
        body, contact=CONTACT, gravity=down(dim), internal=respond_by_parts(body, down(dim))
    )._elastic
    rows, turn = strained(body), strained(body, seed=1, scale=0.02)
    _, gradient, hessian = elastic.linearise(rows, turn, None)
    way, h = np.random.default_rng(2).normal(size=rows.shape), 1e-6
    ahead, behind = (elastic.linearise(rows + side * h * way, turn, None) for side in (1, -1))
    # Central differences: h^2 = 1e-12 over the square of a strain of some per cent, and round-off.
    assert (ahead[0] - behind[0]) / (2 * h) == pytest.approx(np.vdot(gradient, way), rel=1e-6)
    change = (ahead[1] - behind[1]).ravel() / (2 * h)
    assert np.abs(hessian() @ way.ravel() - change).max() < 1e-5 * np.abs(change).max()
    along = np.random.default_rng(3).normal(size=(rows.size, 3))
    np.testing.assert_allclose(
        hessian(along), along.T @ hessian() @ along, rtol=1e-4, atol=1e-5 * np.abs(hessian(along)).max()
    )


def test_what_the_cubature_misses_turns_along_by_regions(dim):
    """Expanded about the turn, it is the sum over regions of what each of them sees."""
    body = make_body(dim, divisions=(16, 8, 4))
    internal = respond_by_parts(body, down(dim))
    simulator = Simulator(body, contact=CONTACT, gravity=down(dim), internal=internal)
    missed = simulator._elastic._missed
    rows, turn = strained(body), strained(body, seed=1, scale=0.02)
    value, slope, stiffness = missed.about(turn)
    change = (rows - turn).ravel()
    expected, n, rotations = 0.0, body.n_rows + 1, missed._turning.rotations(turn)
    # One frame is felt everywhere; stored over (row, axis, axis, row).
    by_region = missed._missed.reshape(-1, n, dim, dim, n).transpose(0, 1, 2, 4, 3)
    for M, R in zip(by_region, rotations, strict=True):
        z = np.vstack(
            [internal.centred(rows) @ R - internal.centred(internal.rest_rows), internal.gravity @ R]
        ).ravel()
        expected += 0.5 * z @ M.reshape(z.size, z.size) @ z
    found = value + slope @ change + 0.5 * change @ stiffness @ change
    # float32 of the modes, which annihilate translations.
    assert found == pytest.approx(expected, rel=1e-6)
    assert len(rotations) == body.handles.n_points + 1


def test_the_weight_is_that_of_the_positions(dim):
    """Region by region, which is the same where all of the body turns as one."""
    body = make_body(dim)
    internal = replace(respond(body, down(dim)), turning=mean_gradients(body))
    rows, turn = strained(body), strained(body, seed=1, scale=0.03)
    force, height = Weight(body, down(dim), internal).form(turn)
    x = body.basis @ rows + internal.displacement(rows, turn)
    # float32 of the response.
    assert height - np.vdot(force, rows) == pytest.approx(-body.node_mass @ x @ down(dim), rel=1e-6)


def test_settled_is_left_alone(dim):
    body = make_body(dim)
    simulator = Simulator(
        body,
        contact=CONTACT,
        gravity=down(dim),
        kinematic=[KinematicHandle("base")],
        internal=respond(body, down(dim)),
    )
    settled = simulator.settle()
    assert simulator.step(settled.state).iterations == 0


def test_a_turned_scene_gives_the_turned_motion(dim):
    """Body, gravity and collider turned by a right angle and more; a ball rubs against the body."""
    angle = np.array([0.5 * np.pi] if dim == 2 else [0.5 * np.pi, 0.2, -0.4])
    turn = rotation_exponential(angle)
    body = make_body(dim)
    base = body.handles.frames[0]
    ball = PlacedCollider("ball", Sphere(0.03, dim, "ball"))
    where = np.array([0.08, 0.072, 0.03])[:dim]

    def play(angle):
        turn = rotation_exponential(angle)
        gravity = turn @ down(dim)
        held = KinematicHandle("base", KeyframedPath([0.0], [turn @ base.pivot - base.pivot], [angle]))
        simulator = Simulator(
            body,
            [ball],
            contact=CONTACT,
            friction=CoulombFriction(0.3, 0.05),
            gravity=gravity,
            kinematic=[held],
            settings=DynamicsSettings(0.01, TIGHT),
            internal=respond(body, gravity),
        )
        rows = body.rest_rows @ turn.T
        state = ReducedState(0.0, rows, np.zeros_like(rows), {"ball": RigidPose(turn, turn @ where)})
        for k in range(1, 4):
            pose = RigidPose(turn, turn @ (where - 0.002 * k * np.eye(dim)[1]))
            result = simulator.step(state, {"ball": pose})
            state = result.state
        return simulator.positions(state), result.contacts["ball"].force

    (x, force), (there, force_there) = play(0.0 * angle), play(angle)
    assert np.linalg.norm(force) > 0.01
    # The residual of Newton's method and the float32 of the surface.
    np.testing.assert_allclose(there, x @ turn.T, atol=1e-8)
    np.testing.assert_allclose(force_there, turn @ force, atol=1e-5 * np.linalg.norm(force))


@pytest.mark.parametrize("frames", [True, False], ids=["frame", "free"])
def test_a_body_in_free_flight_keeps_its_momentum_and_gains_no_energy(dim, frames):
    body = make_body(dim, frames)
    simulator = Simulator(
        body,
        contact=CONTACT,
        settings=DynamicsSettings(0.005, NewtonSettings(50, 1e-7)),
        internal=respond(body, np.zeros(dim)),
    )
    rest = simulator.rest_state()
    # A turn of 10 rad/s about the corner, so that it flies as well as turns, for 1 s.
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
        # Newton's tolerance, and the turn that lags behind by a step.
        assert now < energy * (1 + 1e-5)
        energy = now
    assert np.abs(body.reduced_positions(state.rows) - body.mesh.points).max() > 0.1
    # 200 residuals of 1e-7 of some newtons for 5 ms.
    np.testing.assert_allclose(mass @ state.rows_velocity, momentum, atol=1e-6)


def test_another_gravity_or_body_is_refused():
    body = make_body(2)
    internal = respond(body, down(2))
    with pytest.raises(SoftprintError, match="gravity"):
        Simulator(body, contact=CONTACT, internal=internal)
    Simulator(body, contact=CONTACT, internal=internal.under(np.zeros(2)))
    with pytest.raises(SoftprintError, match="all of them"):
        Simulator(body, contact=CONTACT, gravity=down(2), internal=internal.at(np.arange(3)))


def test_a_correction_brings_its_internal_response(jelly_body, dim):
    """What was trained on a settled body is used on one, whether or not the caller thinks of it."""
    gravity = np.append(np.zeros(dim - 1), -9.81)
    mechanics = compute_mechanics(jelly_body, 200, internal=True, gravity=gravity)
    ball = Sphere(0.02, dim, "ball")
    model = ForceModel(ForceModelOptions((8,), "silu", 5e-4, 2e-3, 1e9), dim, jelly_body.n_rows)
    correction = ForceCorrection("untrained", model, jelly_body, ball, mechanics)
    poses = {"ball": RigidPose(np.eye(dim), np.append(np.zeros(dim - 1), 0.06 + 0.02 - 0.003))}

    def settled(**given):
        simulator = Simulator(
            jelly_body,
            [PlacedCollider("ball", ball, correction=correction)],
            contact=PenaltyContact(1e9),
            gravity=gravity,
            kinematic=[KinematicHandle("base")],
            **given,
        )
        return simulator.positions(simulator.settle(simulator.rest_state(poses=poses)).state)

    # Newton and the loads are solved to 1e-6 and 1e-8, from where the last solve left them.
    np.testing.assert_allclose(settled(), settled(internal=mechanics.internal), rtol=0, atol=1e-8)
