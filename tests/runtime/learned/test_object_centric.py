"""Object-centric corrections: inputs and Jacobians against finite differences, invariance, superposition, sizes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from softprint.runtime.arrays import Array
from softprint.runtime.body import ReducedBody, assemble_body, place_handles
from softprint.runtime.body.node_gradients import basis_gradient_at_nodes
from softprint.runtime.colliders import Box, RigidPose, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics import KinematicHandle, PlacedCollider, Simulator
from softprint.runtime.dynamics.corrected_points import CorrectedPoints
from softprint.runtime.dynamics.timings import Timings
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.correction import FieldCorrection
from softprint.runtime.learned.correction_file import load_correction, read_correction, save_correction
from softprint.runtime.learned.internal.correction import InternalCorrection, unmapped
from softprint.runtime.learned.thesis4.correction import ObjectCentricCorrection
from softprint.runtime.learned.thesis4.inputs import InteractionState
from softprint.runtime.learned.thesis4.model import ObjectCentricModel, ObjectCentricOptions, unit_shape
from softprint.runtime.mesh import box_mesh
from tests.runtime.learned.test_internal_correction import close, differences, made_model, moved, rotation

RADIUS = 0.02
# The Jacobian of r is in single precision: 1e-7 of sums of some terms.
SINGLE = 1e-5


def model_for(
    body: ReducedBody, parameters: tuple[str, ...] = (), sizes: tuple[float, float] = (RADIUS, RADIUS)
) -> ObjectCentricModel:
    """Random weights, smooth components, and corrections of about a millimetre; none in the frames."""
    n_inputs = InteractionState.of(body).n_inputs(len(parameters))
    options = ObjectCentricOptions(
        widths=(12, 12),
        components=4,
        n_inputs=n_inputs,
        n_nodes=body.n_nodes,
        parameters=parameters,
        target="contact",
        added_to="",
        fade="saturating",
        fade_depth=1e-3,
    )
    model = ObjectCentricModel(options, body.dim, body.n_rows)
    generator = torch.Generator().manual_seed(2)
    for parameter in model.parameters():
        parameter.data = 0.4 * torch.randn(parameter.shape, generator=generator)
    waves = np.array([np.sin((40.0 + 10.0 * k) * body.mesh.points) for k in range(4)])
    waves[:, body.handles.frame_nodes] = 0.0
    model.modes.copy_(torch.from_numpy(waves))
    model.coefficient_scale.fill_(1e-3)
    model.input_mean.fill_(0.01)
    model.input_scale.fill_(0.05)
    model.shape.copy_(torch.from_numpy(unit_shape(Sphere(RADIUS, body.dim))))
    model.sizes.copy_(torch.tensor(sizes))
    return model


def correction_of(body: ReducedBody, name: str = "ball") -> ObjectCentricCorrection:
    return ObjectCentricCorrection("thesis4", model_for(body), body, Sphere(RADIUS, body.dim, name=name))


def pressed(body: ReducedBody, along: float = 0.004, depth: float = 0.006) -> RigidPose:
    """The ball of 2 cm inside the top of the block."""
    centre = np.full(body.dim, along)
    centre[-1] = body.mesh.points[:, -1].max() + RADIUS - depth
    return RigidPose.from_rotation_vector([0.7] if body.dim == 2 else [0.3, -0.5, 0.4], centre)


def bent(body: ReducedBody) -> Array:
    """Points moved, and the frame turned a little."""
    handles, rng = body.handles, np.random.default_rng(3)
    return handles.retract(body.rest_rows, 0.002 * handles.units(0.05) * rng.normal(size=handles.n_dofs))


def without_frames(dim: int) -> ReducedBody:
    mesh = box_mesh([0.0] * dim, [0.08] + [0.03] * (dim - 1), [8] + [3] * (dim - 1))
    return assemble_body(mesh, place_handles(mesh, 6, []), make_material("stable_neo_hookean", 2e4, 0.4), 1e3)


@pytest.fixture(params=["with a frame", "without frames"])
def any_body(request, jelly_body, dim):
    return jelly_body if request.param == "with a frame" else without_frames(dim)


def test_inputs_know_their_derivatives(any_body):
    rows, rng = bent(any_body), np.random.default_rng(1)
    seen = InteractionState.of(any_body).seen(pressed(any_body), np.array([0.02]))
    at = seen.at(rows)
    a = rng.normal(size=len(at.value))
    slope = differences(seen, rows).reshape(len(at.value), -1)
    close(at.derivative, slope)
    close(at.pulled_back(a), a @ slope)
    bending = differences(lambda own: seen.at(own).pulled_back(a), rows).reshape(rows.size, rows.size)
    close(at.curvature(a), bending)
    assert at.value[-1] == 0.02


def test_inputs_are_relative_to_the_body(any_body, dim):
    """A rigid motion of both is not seen, one of the collider alone is."""
    rows, pose, read = bent(any_body), pressed(any_body), InteractionState.of(any_body)
    motion = RigidPose(rotation(dim, 0.8), np.linspace(0.3, -0.1, dim))
    before = read.seen(pose, np.empty(0))(rows)
    both = read.seen(motion.compose(pose), np.empty(0))(moved(any_body, rows, 0.8, motion.translation))
    np.testing.assert_allclose(both, before, atol=1e-13)
    assert np.abs(read.seen(motion.compose(pose), np.empty(0))(rows) - before).max() > 0.1


def test_the_network_in_numpy_is_that_in_torch(jelly_body):
    model = model_for(jelly_body)
    z = np.random.default_rng(0).normal(size=model.options.n_inputs)
    with torch.no_grad():
        deep = torch.tensor([1e6], dtype=torch.float64)  # m: nothing is faded
        expected = model.double()(torch.from_numpy(z)[None], deep)[0].numpy()
    np.testing.assert_allclose(model.as_arrays().value(z), expected, rtol=1e-9)


def test_the_jacobian_of_the_kinematics_is_their_derivative(jelly_body):
    """With the fade, whose depth changes too; and forces are pulled back by it."""
    body, rows, pose = jelly_body, bent(jelly_body), pressed(jelly_body)
    bound = correction_of(body).bind(body.node_points())
    field = bound.linearise(rows, pose)
    np.testing.assert_allclose(field.displacement, bound.displacement(rows, pose), atol=1e-16)
    assert np.abs(field.displacement).max() > 1e-4
    expected = differences(lambda at: bound.displacement(at, pose), rows)
    np.testing.assert_allclose(field.jacobian, expected, atol=SINGLE * np.abs(expected).max())
    rng = np.random.default_rng(4)
    f, directions = rng.normal(size=field.displacement.shape), rng.normal(size=(rows.size, 3))
    pulled = np.tensordot(f, expected, axes=2)
    np.testing.assert_allclose(field.pulled_back(f), pulled, atol=1e-6 * np.abs(pulled).max())
    along = expected.reshape(f.size, -1) @ directions
    np.testing.assert_allclose(field.along(directions), along, atol=SINGLE * np.abs(along).max())


def test_the_curvature_is_the_derivative_of_what_is_pulled_back(jelly_body):
    """Where the fade is saturated; its second derivative is left out."""
    body, rows, pose = jelly_body, bent(jelly_body), pressed(jelly_body)
    correction = correction_of(body)
    correction.model.fade = replace(correction.model.fade, depth=1e-9)
    bound = correction.bind(body.node_points())
    f = np.random.default_rng(4).normal(size=(body.n_nodes, body.dim))
    found = bound.linearise(rows, pose).curvature(f, None)
    expected = differences(lambda at: bound.linearise(at, pose).pulled_back(f), rows).reshape(found.shape)
    np.testing.assert_allclose(found, expected, atol=SINGLE * np.abs(expected).max())


def test_a_rigid_motion_of_everything_moves_everything(jelly_body, dim):
    rows, pose = bent(jelly_body), pressed(jelly_body)
    bound = correction_of(jelly_body).bind(jelly_body.node_points())
    motion = RigidPose(rotation(dim, 0.8), np.full(dim, 0.3))
    turned = bound.displacement(moved(jelly_body, rows, 0.8, motion.translation), motion.compose(pose))
    # Round-off of coordinates of decimetres.
    np.testing.assert_allclose(turned, motion.rotate(bound.displacement(rows, pose)), atol=1e-13)


def test_undoing_the_mapping_gives_the_components_back(jelly_body):
    """F^-1 u of a correction is a combination of its components, whatever the state."""
    body, rows = jelly_body, bent(jelly_body)
    correction = correction_of(body)
    u = correction.bind(body.node_points()).displacement(rows, pressed(body))
    r = unmapped(basis_gradient_at_nodes(body), rows, u).ravel()
    modes = correction.model.modes.double().numpy().reshape(4, -1)
    left = r - np.linalg.lstsq(modes.T, r, rcond=None)[0] @ modes
    assert np.linalg.norm(left) < 1e-10 * np.linalg.norm(r)


def test_there_is_none_without_contact_and_it_fades_in(jelly_body):
    body = jelly_body
    bound = correction_of(body).bind(body.node_points())
    # Exactly below the lowest place of the ball, a node of the body: contact is felt at nodes here.
    node = body.mesh.points[body.surface.nodes][np.argmax(body.mesh.points[body.surface.nodes, -1])]

    def size(depth: float) -> float:
        pose = pressed(body, depth=depth)
        above = RigidPose(pose.rotation, np.append(node[:-1], pose.translation[-1]))
        return float(np.abs(bound.displacement(body.rest_rows, above)).max())

    deep, shallow = size(6e-3), size(1e-5)
    assert 0.0 < shallow < 1e-2 * deep
    away = pressed(body, depth=-0.05)
    assert not bound.displacement(body.rest_rows, away).any()
    assert not len(bound.linearise(body.rest_rows, away).index)


def test_corrections_of_several_colliders_and_of_the_body_add_up(jelly_body):
    """x = U q + F (r_int + sum_c r_ext(z_c)), eq. 4.7, with all derivatives."""
    body, rows = jelly_body, bent(jelly_body)
    sides = {"left": pressed(body, -0.03), "right": pressed(body, 0.03)}
    fields = {name: correction_of(body, name) for name in sides}
    internal = InternalCorrection(made_model(body), body)
    points = CorrectedPoints(body, list(fields.items()), internal=internal)
    phase, count = Timings().correction, points.count
    total = points.linearise(rows, sides, phase)
    every = points.displacement(rows, sides, phase)
    np.testing.assert_allclose(points.scatter(total), every, atol=1e-16)
    alone = [CorrectedPoints(body, [pair]) for pair in fields.items()]
    alone.append(CorrectedPoints(body, [], internal=internal))
    parts = [own.linearise(rows, sides, phase) for own in alone]
    assert all(len(part.index) == count and np.abs(part.displacement).max() > 1e-4 for part in parts)
    rng = np.random.default_rng(2)
    f, directions = rng.normal(size=(count, body.dim)), rng.normal(size=(rows.size, 3))
    for value in (
        lambda field: field.displacement,
        lambda field: field.jacobian,
        lambda field: field.pulled_back(f),
        lambda field: field.along(directions),
        lambda field: field.curvature(f, directions),
    ):
        expected = sum(value(part) for part in parts)
        np.testing.assert_allclose(value(total), expected, atol=1e-6 * np.abs(expected).max())


def test_a_simulation_runs_with_two_colliders(jelly_body):
    """It comes to rest, with both corrections in all positions."""
    body = jelly_body
    sides = {"left": pressed(body, -0.03, 0.002), "right": pressed(body, 0.03, 0.002)}
    corrections = {name: correction_of(body, name) for name in sides}
    for correction in corrections.values():
        correction.model.coefficient_scale.fill_(2e-5)  # random ones are rough
    placed = [
        PlacedCollider(name, Sphere(RADIUS, body.dim, name=name), correction=correction)
        for name, correction in corrections.items()
    ]
    simulator = Simulator(body, placed, contact=PenaltyContact(1e9), kinematic=[KinematicHandle("base")])
    state = simulator.rest_state(poses=sides)
    for _ in range(10):
        result = simulator.step(state, sides)
        assert result.converged
        state = result.state
    assert all(contact.points for contact in result.contacts.values())
    added = [
        correction.bind(body.node_points()).displacement(state.rows, sides[name])
        for name, correction in corrections.items()
    ]
    expected = body.reduced_positions(state.rows) + sum(added)
    np.testing.assert_allclose(simulator.positions(state), expected, atol=1e-15)


def test_a_file_gives_the_same_correction(jelly2d_body, tmp_path):
    body, ball, path = jelly2d_body, Sphere(RADIUS, 2, name="ball"), tmp_path / "thesis4.safetensors"
    model = model_for(body)
    save_correction(path, "thesis4", model, body, "ball", "0" * 64, 0.5, {})
    loaded = load_correction(path, body, ball)
    assert isinstance(loaded, ObjectCentricCorrection)
    assert loaded.model.options == model.options
    rows, pose = bent(body), pressed(body)
    before, after = (
        each.bind(body.node_points()).displacement(rows, pose) for each in (correction_of(body), loaded)
    )
    np.testing.assert_array_equal(before, after)


def test_one_model_is_for_all_sizes_in_its_range(jelly_body, dim, tmp_path):
    """And the size is seen. Other sizes and shapes are refused in a sentence."""
    body, path = jelly_body, tmp_path / "sizes.safetensors"
    model = model_for(body, ("size",), (0.01, 0.03))
    save_correction(path, "sizes", model, body, "any", "0" * 64, 0.5, {})
    trained = read_correction(path, body)
    rows, found = bent(body), []
    for radius in (0.01, 0.02, 0.03):
        correction = trained.on(Sphere(radius, dim, name="own"))
        assert isinstance(correction, ObjectCentricCorrection)
        found.append(correction.parameters[0])
    assert found == [0.01, 0.02, 0.03]
    field: FieldCorrection = trained.on(Sphere(0.025, dim, name="own"))
    near = field.bind(body.node_points()).displacement(rows, pressed(body))
    other = trained.on(Sphere(RADIUS, dim, name="own"))
    assert np.abs(near - other.bind(body.node_points()).displacement(rows, pressed(body))).max() > 1e-6
    for radius in (0.009, 0.031):
        with pytest.raises(SoftprintError, match=r"of size 0.01 to 0.03 m, and 'own' has"):
            trained.on(Sphere(radius, dim, name="own"))
    with pytest.raises(SoftprintError, match="another shape"):
        trained.on(Box(np.full(dim, 0.02), name="own"))


def test_what_does_not_fit_is_refused(jelly2d_body, jelly3d_body):
    flat, solid = jelly2d_body, jelly3d_body
    with pytest.raises(SoftprintError, match="train it for this body"):
        ObjectCentricCorrection("x", model_for(flat), solid, Sphere(RADIUS, 3))
    points = flat.node_points()
    between = replace(points, rest=points.rest + 1e-4)
    with pytest.raises(SoftprintError, match="at the nodes of its body only"):
        correction_of(flat).bind(between)
