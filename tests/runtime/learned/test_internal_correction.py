"""Internal corrections: the mapping and its Jacobians against finite differences, invariance, and their forces."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from softprint.runtime.arrays import Array
from softprint.runtime.body import ReducedBody
from softprint.runtime.body.node_gradients import basis_gradient_at_nodes, least_squares_weights
from softprint.runtime.body.rotations import rotation_dofs, rotation_exponential
from softprint.runtime.colliders import KeyframedPath, RigidPose, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics import KinematicHandle, Simulator
from softprint.runtime.dynamics.corrected_points import CorrectedPoints
from softprint.runtime.dynamics.terms.elastic import ElasticEnergy
from softprint.runtime.dynamics.terms.surface_contact import SurfaceContactEnergy, SurfaceContactEvaluation
from softprint.runtime.dynamics.timings import Phase, Timings
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.internal.correction import (
    JACOBIANS,
    InternalCorrection,
    deformation,
    mapped,
    unmapped,
)
from softprint.runtime.learned.internal.inputs import RigidFreeRows
from softprint.runtime.mechanics.body_mechanics import BodyMechanics, compute_mechanics
from tests.internal_model import made_model

# Central differences in float64 with a step of 1e-6 leave about (1e-6)^2 of curvature over millimetres and
# 1e-16 / 1e-6 of round-off: 1e-6 relative covers both.
DIFFERENCES = 1e-6
STEP = 1e-6
CONTACT = PenaltyContact(1e9)


def bent(body: ReducedBody, seed: int = 5) -> Array:
    """Handle rows of a body that is moved, turned and strained."""
    handles, rng = body.handles, np.random.default_rng(seed)
    rows = handles.retract(body.rest_rows, 0.004 * handles.units(0.02) * rng.normal(size=handles.n_dofs))
    return moved(body, rows, 0.7, np.linspace(0.2, -0.1, body.dim))


def rotation(dim: int, angle: float) -> Array:
    return rotation_exponential(angle * np.linspace(1.0, 0.4, rotation_dofs(dim)))


def moved(body: ReducedBody, rows: Array, angle: float, by: Array) -> Array:
    """The rows after the rigid motion x -> Q x + by."""
    return rows @ rotation(body.dim, angle).T + np.outer(body.handles.affine_part, by)


def differences(value, rows: Array) -> Array:
    """Derivative of value(rows) by the rows, with the shape of both after each other."""
    columns = []
    for index in np.ndindex(rows.shape):
        step = np.zeros_like(rows)
        step[index] = STEP
        columns.append((value(rows + step) - value(rows - step)) / (2 * STEP))
    return np.moveaxis(np.array(columns), 0, -1).reshape(*columns[0].shape, *rows.shape)


def close(found: Array, expected: Array) -> None:
    np.testing.assert_allclose(found, expected, atol=DIFFERENCES * np.abs(expected).max())


def test_least_squares_are_exact_for_affine_fields(jelly_body, dim):
    """Boundary nodes included, where the mean of the cells is not."""
    mesh = jelly_body.mesh
    weights = least_squares_weights(mesh)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-12)
    slope = np.arange(1.0, 1.0 + dim)
    # A corner with one cell, or with cells in a plane, cannot know the slope across.
    around = np.bincount(mesh.cells.ravel(), minlength=mesh.n_nodes)
    known = around >= 2 * dim + 2
    assert known.mean() > 0.7
    at_nodes = weights @ (mesh.cell_centroids @ slope)
    np.testing.assert_allclose(at_nodes[known], (mesh.points @ slope)[known], atol=1e-12)


def test_gradients_at_nodes_reproduce_affine_motions(jelly_body, dim):
    gradient = basis_gradient_at_nodes(jelly_body)
    rows = moved(jelly_body, jelly_body.rest_rows, 0.9, np.ones(dim))
    expected = np.broadcast_to(rotation(dim, 0.9), (jelly_body.n_nodes, dim, dim))
    np.testing.assert_allclose(deformation(gradient, rows), expected, atol=1e-10)


def test_inputs_do_not_see_rigid_motion_and_know_their_derivative(jelly_body, dim):
    encode, rows = RigidFreeRows.of(jelly_body), bent(jelly_body)
    np.testing.assert_allclose(encode(jelly_body.rest_rows), 0.0, atol=1e-15)
    again = encode(moved(jelly_body, rows, -1.2, np.full(dim, 3.0)))
    np.testing.assert_allclose(again, encode(rows), atol=1e-13)
    close(encode.derivative(rows), differences(encode, rows).reshape(rows.size, rows.size))


def test_the_network_in_numpy_is_that_in_torch_and_knows_its_derivatives(jelly_body):
    model = made_model(jelly_body)
    network, rng = model.as_arrays(), np.random.default_rng(3)
    z, a = 0.01 * rng.normal(size=jelly_body.rest_rows.size), rng.normal(size=4)
    with torch.no_grad():
        expected = model.double()(torch.from_numpy(z)).numpy()
    np.testing.assert_allclose(network.value(z), expected, atol=1e-12 * np.abs(expected).max())
    at = network.at(z)
    np.testing.assert_allclose(at.value, network.value(z), atol=1e-18)
    close(at.slope, differences(network.value, z))
    close(at.curvature(a), differences(lambda own: a @ network.at(own).slope, z))
    directions = rng.normal(size=(len(z), 3))
    along = at.moved(directions)
    for found, whole in (
        (along.slope, at.slope @ directions),
        (along.curvature(a), directions.T @ at.curvature(a) @ directions),
    ):
        np.testing.assert_allclose(found, whole, atol=1e-12 * np.abs(whole).max())


def test_the_network_in_torch_knows_its_derivatives_along_directions(jelly_body):
    model = made_model(jelly_body)
    rng = np.random.default_rng(4)
    z = 0.01 * rng.normal(size=(3, jelly_body.rest_rows.size)).astype(np.float32)
    directions = rng.normal(size=(3, 2, z.shape[1])).astype(np.float32)
    with torch.no_grad():
        value, slope = model.along(torch.from_numpy(z), torch.from_numpy(directions))
        np.testing.assert_array_equal(value, model(torch.from_numpy(z)))
    network = model.as_arrays()
    for own, along, found in zip(z, directions, slope.numpy(), strict=True):
        expected = along @ network.at(own.astype(np.float64)).slope.T
        np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())  # single precision


@pytest.mark.parametrize("gravity", [False, True])
def test_inputs_know_their_second_derivative(jelly_body, dim, gravity):
    """The rotation turns twice: as part of z, and with the strain of the body."""
    encode = RigidFreeRows.of(jelly_body, np.linspace(1.0, -9.0, dim) if gravity else ())
    rows = bent(jelly_body)
    a = np.random.default_rng(3).normal(size=encode.n_inputs)
    pulled = differences(lambda at: a @ encode(at), rows).ravel()
    close(encode.at(rows).pulled_back(a), pulled)
    close(a @ encode.derivative(rows), pulled)
    slope = differences(lambda at: a @ encode.derivative(at), rows).reshape(rows.size, rows.size)
    close(encode.at(rows).curvature(a), slope)


def test_under_gravity_inputs_know_how_the_body_lies(jelly_body, dim):
    """A rigid motion of body and gravity is not seen, one of the body alone is."""
    down, rows = np.linspace(1.0, -9.0, dim), bent(jelly_body)
    before = RigidFreeRows.of(jelly_body, down)(rows)
    tilted = moved(jelly_body, rows, 0.8, np.zeros(dim))
    both = RigidFreeRows.of(jelly_body, rotation(dim, 0.8) @ down)(tilted)
    np.testing.assert_allclose(both, before, atol=1e-13)
    alone = RigidFreeRows.of(jelly_body, down)(tilted)
    np.testing.assert_allclose(alone[: rows.size], before[: rows.size], atol=1e-13)
    assert np.abs(alone[rows.size :] - before[rows.size :]).max() > 0.1


@pytest.mark.parametrize("jacobian", JACOBIANS)
def test_forces_are_pulled_back_by_the_jacobian(jelly_body, dim, jacobian):
    """Without forming it; and along directions it is the Jacobian times them."""
    body, rows, rng = jelly_body, bent(jelly_body), np.random.default_rng(4)
    field = InternalCorrection(made_model(body), body, jacobian).bind().linearise(rows)
    f, directions = rng.normal(size=(body.n_nodes, dim)), rng.normal(size=(rows.size, 3))
    J = field.jacobian.reshape(f.size, rows.size)
    expected = (f.ravel() @ J).reshape(rows.shape)
    # The Jacobian is in single precision, what is pulled back is not.
    single = 1e-5 * max(np.abs(expected).max(), 1e-6)
    np.testing.assert_allclose(field.pulled_back(f), expected, atol=single)
    np.testing.assert_allclose(
        field.along(directions), J @ directions, atol=1e-5 * max(np.abs(J).max(), 1e-6)
    )


def test_the_curvature_is_the_derivative_of_what_is_pulled_back(jelly_body, dim):
    body, rows, rng = jelly_body, bent(jelly_body), np.random.default_rng(4)
    bound = InternalCorrection(made_model(body), body).bind()
    f, directions = rng.normal(size=(body.n_nodes, dim)), rng.normal(size=(rows.size, 3))
    found = bound.linearise(rows).curvature(f, None)
    expected = differences(lambda at: bound.linearise(at).pulled_back(f), rows).reshape(found.shape)
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())  # single precision
    along = bound.linearise(rows).curvature(f, directions)
    np.testing.assert_allclose(along, directions.T @ expected @ directions, atol=1e-5 * np.abs(along).max())
    assert (
        InternalCorrection(made_model(body), body, "linear").bind().linearise(rows).curvature(f, None) is None
    )


@pytest.mark.parametrize("jacobian", JACOBIANS)
def test_jacobians_are_the_derivatives_they_say(jelly_body, jacobian):
    """The full one of the positions, the second with F held, the last none: J = U."""
    body, rows = jelly_body, bent(jelly_body)
    bound = InternalCorrection(made_model(body), body, jacobian).bind()
    field = bound.linearise(rows)
    np.testing.assert_allclose(field.displacement, bound.displacement(rows), atol=1e-15)
    assert np.abs(field.displacement).max() > 1e-4  # m: there is something to differentiate
    if jacobian == "linear":
        assert not field.jacobian.any()
        return
    gradient = basis_gradient_at_nodes(body)
    held = deformation(gradient, rows)

    def displacement(at: Array) -> Array:
        if jacobian == "full":
            return bound.displacement(at)
        return np.einsum("naj,nj->na", held, unmapped(gradient, at, bound.displacement(at)))

    expected = differences(displacement, rows)
    # In single precision.
    np.testing.assert_allclose(field.jacobian, expected, atol=1e-5 * np.abs(expected).max())
    full = InternalCorrection(made_model(body), body, "full").bind().linearise(rows)
    if jacobian != "full":  # and they differ
        assert np.abs(full.jacobian - field.jacobian).max() > 1e-3 * np.abs(full.jacobian).max()


def test_some_nodes_are_corrected_like_all(jelly_body):
    nodes, rows = np.array([3, 40, 7]), bent(jelly_body)
    correction = InternalCorrection(made_model(jelly_body), jelly_body)
    some, every = correction.bind(nodes).linearise(rows), correction.bind().linearise(rows)
    np.testing.assert_allclose(some.displacement, every.displacement[nodes], atol=1e-17)
    single = 1e-6 * np.abs(every.jacobian).max()
    np.testing.assert_allclose(some.jacobian, every.jacobian[nodes], atol=single)


def test_undoing_the_mapping_and_mapping_is_the_identity(jelly_body, dim):
    """To round-off of a solve with a well-conditioned F."""
    gradient, rows = basis_gradient_at_nodes(jelly_body), bent(jelly_body)
    u = np.random.default_rng(1).normal(size=(jelly_body.n_nodes, dim))
    np.testing.assert_allclose(mapped(gradient, rows, unmapped(gradient, rows, u)), u, atol=1e-13)
    mirrored = jelly_body.rest_rows * np.append(np.ones(dim - 1), -1.0)
    with pytest.raises(SoftprintError, match="inverts the body"):
        unmapped(gradient, mirrored, u)


def test_a_rigid_motion_of_everything_moves_everything(jelly_body, dim):
    rows, by = bent(jelly_body), np.full(dim, 0.3)
    bound, Q = InternalCorrection(made_model(jelly_body), jelly_body).bind(), rotation(dim, -1.1)
    turned = bound.displacement(moved(jelly_body, rows, -1.1, by))
    np.testing.assert_allclose(turned, bound.displacement(rows) @ Q.T, atol=1e-14)


def test_it_is_zero_at_rest(jelly_body):
    bound = InternalCorrection(made_model(jelly_body), jelly_body).bind()
    np.testing.assert_allclose(bound.displacement(jelly_body.rest_rows), 0.0, atol=1e-15)


def test_elastic_forces_and_stiffness_are_the_derivatives_of_the_energy(jelly_body):
    """J^T f with the full Jacobian, and J^T H J with the curvature of the correction, on the cubature cells."""
    body, rows = jelly_body, bent(jelly_body)
    points = CorrectedPoints(body, [], internal=InternalCorrection(made_model(body), body))
    assert points.corrected
    term, phase = ElasticEnergy(body, points), Timings().correction
    assert isinstance(phase, Phase)

    def energy(at: Array) -> Array:
        return np.array(term.evaluate(at, points.displacement(at, {}, phase)).energy)

    def gradient(at: Array) -> Array:
        field = points.linearise(at, {}, phase)
        return term.evaluate(at, points.scatter(field)).linearise(field)[0]

    close(gradient(rows), differences(energy, rows))
    field = points.linearise(rows, {}, phase)
    hessian = term.evaluate(rows, points.scatter(field)).linearise(field)[1]()
    slope = differences(gradient, rows).reshape(hessian.shape)
    np.testing.assert_allclose(hessian, slope, atol=1e-5 * np.abs(slope).max())  # single precision
    assert energy(rows) != pytest.approx(term.evaluate(rows, None).energy, rel=0.01)


@pytest.mark.parametrize("condensed", [False, True])
def test_a_simulation_runs_on_corrected_positions(jelly_body, dim, condensed):
    """It settles where the energy of the corrected body is least, and all positions have the correction in them."""
    body = jelly_body
    mechanics = BodyMechanics(None, compute_mechanics(body, 50, True).condensation) if condensed else None
    correction = InternalCorrection(made_model(body, condensed, 4e-4), body)
    shifted = np.zeros(dim)
    shifted[0] = 0.004
    led = KinematicHandle("base", KeyframedPath([0.0], [shifted], np.full((1, rotation_dofs(dim)), 0.2)))
    arguments = {"contact": CONTACT, "kinematic": [led, KinematicHandle(0)], "mechanics": mechanics}
    simulator = Simulator(body, internal=correction, **arguments)
    result = simulator.settle()
    assert result.converged
    rows = result.state.rows
    plain = Simulator(body, **arguments)
    expected = plain.positions(result.state) + correction.bind().displacement(rows)
    np.testing.assert_allclose(simulator.positions(result.state), expected, atol=1e-14)
    # At least as low as from where the uncorrected body settles.
    other = simulator.settle(plain.settle().state)
    assert other.converged
    assert other.energies["elastic"] == pytest.approx(result.energies["elastic"], rel=1e-5)
    stepped = simulator.step(result.state)
    assert stepped.converged
    np.testing.assert_allclose(stepped.state.rows, rows, atol=1e-6)  # m: an equilibrium stays


def test_what_does_not_fit_is_refused(jelly2d_body, jelly3d_body):
    flat, solid = jelly2d_body, jelly3d_body
    with pytest.raises(SoftprintError, match="train it for this body"):
        InternalCorrection(made_model(flat), solid)
    with pytest.raises(SoftprintError, match="is not known"):
        InternalCorrection(made_model(flat), flat, "some")  # type: ignore[arg-type]
    alone = BodyMechanics(None, compute_mechanics(flat, 50, True).condensation)
    plain, condensed = (InternalCorrection(made_model(flat, on), flat) for on in (False, True))
    heavy = InternalCorrection(made_model(flat, gravity=(0.0, -9.81)), flat)
    for internal, given, message in (
        (plain, alone, "subspace alone"),
        (condensed, None, "give the mechanics"),
        (heavy, None, r"under a gravity of \[0.0, -9.81\] m/s\^2, not of \[0.0, 0.0\]"),
    ):
        with pytest.raises(SoftprintError, match=message):
            Simulator(flat, contact=CONTACT, mechanics=given, internal=internal)


@pytest.mark.parametrize("under", [False, True])
def test_the_weight_of_a_correction_is_that_of_its_displacements(jelly_body, dim, under):
    """Without a sum over nodes; its gradient and Hessian are the derivatives. Learned without gravity, and under it."""
    body, rows, gravity = jelly_body, bent(jelly_body), np.linspace(1.0, -9.0, dim)
    correction = InternalCorrection(made_model(body, gravity=tuple(gravity) if under else ()), body)
    weight, bound = correction.weight(body.node_mass, gravity), correction.bind()

    def energy(at: Array) -> Array:
        return np.array(-(body.node_mass @ (bound.displacement(at) @ gravity)))

    at = weight.at(rows)
    assert at.energy == pytest.approx(float(energy(rows)), rel=1e-12)
    close(at.gradient, differences(energy, rows))
    slope = differences(lambda own: weight.at(own).gradient, rows).reshape(rows.size, rows.size)
    single = 1e-5 * np.abs(slope).max()  # single precision
    np.testing.assert_allclose(at.hessian(), slope, atol=single)
    directions = np.random.default_rng(2).normal(size=(rows.size, 3))
    np.testing.assert_allclose(
        at.hessian(directions), directions.T @ slope @ directions, atol=10.0 * single * rows.size
    )


@pytest.mark.parametrize("condensed", [False, True])
def test_a_corrected_body_hangs_where_its_whole_energy_is_least(jelly_body, dim, condensed):
    """The energy of the step is elasticity and the height of all nodes, and its gradient vanishes."""
    body, gravity = jelly_body, np.zeros(dim)
    gravity[-1] = -9.81
    mechanics = (
        BodyMechanics(None, compute_mechanics(body, 50, True, gravity).condensation) if condensed else None
    )
    correction = InternalCorrection(made_model(body, condensed, 4e-4), body)
    simulator = Simulator(
        body,
        contact=CONTACT,
        mechanics=mechanics,
        internal=correction,
        gravity=gravity,
        kinematic=[KinematicHandle("base")],
    )
    result = simulator.settle()
    assert result.converged
    height = -float(body.node_mass @ (simulator.positions(result.state) @ gravity))
    assert result.energies["gravity"] == pytest.approx(height, rel=1e-6)
    # A step from there stays, although its Hessian, gradient and line search all know the weight.
    stepped = simulator.step(result.state)
    assert stepped.converged
    np.testing.assert_allclose(stepped.state.rows, result.state.rows, atol=1e-6)  # m


@pytest.mark.parametrize("refinement", [0, 2])
def test_contact_of_a_corrected_surface_knows_its_derivatives(jelly_body, dim, refinement):
    """At nodes and on facets: J^T f, and J^T H J with the curvature of the correction."""
    body, rows = jelly_body, bent(jelly_body)
    law = PenaltyContact(1e9, refinement=refinement, reduced_refinement=1 if refinement == 0 else 2)
    points = CorrectedPoints(body, [], internal=InternalCorrection(made_model(body), body))
    x = body.reduced_positions(rows)
    # Deep enough that several points touch, and still do a step of the differences away.
    ball = Sphere(0.02, dim=dim)
    top = x[np.argmax(x[:, -1])]
    poses = {"ball": RigidPose.from_rotation_vector(np.zeros(rotation_dofs(dim)), top)}
    term = SurfaceContactEnergy(body, points, {"ball": ball}, law, None)
    frame, phase = term.in_frame(rows), Timings().correction

    def at(own: Array) -> SurfaceContactEvaluation:
        u = points.displacement(own, poses, phase)
        return frame.evaluate(frame.positions(own, u), poses, own, u)

    def gradient(own: Array) -> Array:
        return at(own).linearise(points.linearise(own, poses, phase), None, {}, len(own))[0]

    expected = differences(lambda own: np.array(at(own).energy), rows)
    found, hessian, _ = at(rows).linearise(points.linearise(rows, poses, phase), None, {}, len(rows))
    assert np.abs(expected).max() > 0.0
    # The Jacobian is in single precision.
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())
    slope = differences(gradient, rows).reshape(rows.size, rows.size)
    assert hessian is not None
    # So is what it multiplies: 1.4e-4 on some processors.
    np.testing.assert_allclose(hessian, slope, atol=3e-4 * np.abs(slope).max())
