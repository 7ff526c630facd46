"""The internal response: invariance, the constraint, and the exact internal equilibrium by a dense Newton solve."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as sl

from runtime.body import assemble_body, frame_in_box, place_handles
from runtime.body.rotations import nearest_rotation, rotation_exponential
from runtime.elasticity import make_material
from runtime.elasticity.elastic_energy import elastic_gradient, element_hessians
from runtime.mechanics.corotation import local_gradients, mean_gradients
from runtime.mechanics.null_space_compliance import NullSpaceCompliance
from runtime.mechanics.position_bounds import PositionBounds
from runtime.mechanics.static_condensation import (
    compute_static_condensation,
    condensation_arrays,
    take_condensation,
)
from runtime.mesh import box_mesh


def make_body(dim, frames):
    """A bar whose right half is five times as stiff and twice as dense, with or without a rigid end."""
    mesh = box_mesh([0.0] * dim, [0.1, 0.05, 0.05][:dim], [8, 4, 4][:dim])
    regions = [frame_in_box(mesh, "base", [[-1.0] * dim, [0.015] + [1.0] * (dim - 1)])] if frames else []
    right = mesh.cell_centroids[:, 0] > 0.05
    material = make_material("stable_neo_hookean", np.where(right, 1e5, 2e4), np.full(mesh.n_cells, 0.4))
    return assemble_body(
        mesh, place_handles(mesh, 5, regions), material, np.where(right, 2e3, 1e3), name="bar"
    )


@pytest.fixture(params=[True, False], ids=["frame", "free"])
def body(dim, request):
    return make_body(dim, request.param)


def gravity(dim):
    return np.array([1.0, -2.0, -9.0])[:dim]


@pytest.fixture
def response(body, dim):
    """Every part turned by itself; in float64, for differences and invariances to be seen to round-off."""
    found = compute_static_condensation(body, gravity(dim), NullSpaceCompliance(body))
    return replace(
        found,
        modes=found.modes.astype(float),
        weight=found.weight.astype(float),
        turning=local_gradients(body).astype(float),
    )


def turned_as_one(body, response):
    """With one rotation for the whole body, that of the mean over its nodes."""
    return replace(response, turning=mean_gradients(body))


def strained(body, scale):
    """Handle rows of a deformed body, frames rigid."""
    rng = np.random.default_rng(4)
    return body.handles.retract(body.rest_rows, scale * rng.normal(size=body.n_dofs))


def moved(body, rows, rotation, translation):
    """Handle rows after a rigid motion of everything: frames hold R^T and t."""
    placed = rows @ rotation.T
    is_position = np.ones(body.n_rows)
    n_points = body.handles.n_points
    is_position[n_points:] = np.tile(np.append(np.zeros(body.dim), 1.0), len(body.handles.frames))
    return placed + is_position[:, None] * translation


def test_it_turns_with_the_body(body, response, dim):
    rotation = rotation_exponential(np.array([2.0] if dim == 2 else [1.0, -2.0, 0.7]))
    rows = strained(body, 3e-3)
    there = moved(body, rows, rotation, np.array([0.3, -0.2, 0.5])[:dim])
    turned = replace(response, gravity=rotation @ response.gravity)
    turns, turns_there = response.turns(rows), turned.turns(there)
    assert np.abs(turns - turns[0]).max() > 1e-3  # every node has its own
    np.testing.assert_allclose(turns_there, rotation @ turns, atol=1e-12)
    here = response.displacement(rows, rows)
    np.testing.assert_allclose(
        turned.displacement(there, there), here @ rotation.T, atol=1e-11 * np.abs(rows).max()
    )


def test_a_rigid_motion_strains_nothing(body, response, dim):
    rotation = rotation_exponential(np.array([2.0] if dim == 2 else [1.0, -2.0, 0.7]))
    rows = moved(body, body.rest_rows, rotation, np.full(dim, 0.1))
    # float32 of what is turned by.
    np.testing.assert_allclose(response.turns(rows) - rotation, 0.0, atol=1e-7)
    weightless = replace(response, gravity=np.zeros(dim))
    # Round-off: the turn leaves no strain of the rows, and the mean translation is taken out.
    assert np.abs(weightless.displacement(rows, rows)).max() < 1e-12


def test_the_slightest_change_is_seen(body, response):
    """Modes are float32, but what they are given is not rounded: while the turn is held the response is affine in the
    rows, to the last nanometre of a line search."""
    single = replace(response, modes=response.modes.astype(np.float32))
    rows = strained(body, 3e-3)
    change = 1e-9 * np.random.default_rng(7).normal(size=rows.shape)
    gained = single.displacement(rows + change, rows) - single.displacement(rows, rows)
    expected = np.tensordot(single.derivative(rows), change, 2)
    # Round-off of float64, of displacements of a millimetre; in float32 it would be a tenth of a nanometre.
    np.testing.assert_allclose(gained, expected, rtol=0.0, atol=1e-16)
    assert np.abs(expected).max() > 1e-10


def test_without_two_frames_it_turns_as_one(body, dim):
    """As if every node had the rotation of the mean deformation gradient."""
    response = compute_static_condensation(body, gravity(dim), NullSpaceCompliance(body))
    rows = strained(body, 3e-3)
    assert response.turns_as_one
    volumes = body.mesh.cell_volumes
    F = np.tensordot(volumes, body.mesh.deformation_gradients(body.basis @ rows), 1) / volumes.sum()
    R = nearest_rotation(F)
    # float32 of what is turned by.
    np.testing.assert_allclose(response.turns(rows), np.broadcast_to(R, (len(response), dim, dim)), atol=1e-6)
    strain, hanging = response.centred(rows) @ R - response.centred(response.rest_rows), response.gravity @ R
    expected = np.tensordot(response.modes, strain, 2) + response.weight @ hanging
    found = response.displacement(rows, rows)
    np.testing.assert_allclose(found, expected @ R.T, atol=1e-5 * np.abs(found).max())  # float32


def felt(body, u):
    """What the reduced state would feel of u, as a share of it."""
    free = np.setdiff1d(np.arange(body.n_nodes), body.handles.frame_nodes)
    return np.abs(body.constraint_basis[free].T @ u[free]).max() / np.abs(u).sum()


def test_the_subspace_does_not_feel_it(body, response):
    """Turned as one; where every node has its own turn, to first order in strain."""
    rows = strained(body, 3e-3)
    one = turned_as_one(body, response).displacement(rows, rows)
    assert np.abs(one).max() > 1e-5
    assert felt(body, one) < 1e-5  # float32
    weightless = replace(response, gravity=np.zeros(body.dim))
    found = []
    for scale in (2e-3, 1e-3):
        rows = strained(body, scale)
        u = weightless.displacement(rows, rows)
        assert not u[body.handles.frame_nodes].any()
        found.append(felt(body, u))
    # u is of first order, what is felt of it of second.
    assert found[1] < 0.01
    assert found[0] / found[1] == pytest.approx(2.0, rel=0.3)


def test_turned_alike_it_is_one_rotation_of_the_response_at_rest(body, response, dim):
    rows, one = strained(body, 3e-3), turned_as_one(body, response)
    R = one.turns(rows)[0]
    d = rows @ R - body.rest_rows
    expected = (response.modes.reshape(-1, d.size) @ d.ravel()).reshape(-1, dim)
    expected += response.weight @ (response.gravity @ R)
    # float32 of modes that annihilate translations to 1e-7.
    np.testing.assert_allclose(one.displacement(rows, rows), expected @ R.T, atol=1e-9)


def test_derivative(body, response, dim):
    rng = np.random.default_rng(0)
    rows = strained(body, 3e-3)
    turn = moved(
        body,
        strained(body, 5e-3),
        rotation_exponential(np.array([0.4] if dim == 2 else [0.4, -0.3, 0.2])),
        0.1,
    )
    derivative = response.derivative(turn)
    way = rng.normal(size=rows.shape)
    ahead, behind = response.displacement(rows + way, turn), response.displacement(rows - way, turn)
    # Affine at a frozen turn: differences over any distance are exact.
    np.testing.assert_allclose(np.einsum("narb,rb->na", derivative, way), 0.5 * (ahead - behind), atol=1e-12)
    few = np.array([7, 3, 20])
    np.testing.assert_allclose(response.derivative(turn, few), derivative[few], atol=1e-15)
    forces = rng.normal(size=(len(few), dim))
    expected = np.einsum("na,narb->rb", forces, derivative[few])
    np.testing.assert_allclose(response.pulled_back(forces, turn, few), expected, atol=1e-13)
    part = response.at(few)
    np.testing.assert_allclose(
        part.displacement(rows, turn), response.displacement(rows, turn)[few], atol=1e-12
    )


def internal_equilibrium(body, rows, acceleration, start=0.0):
    """u (n_nodes, dim) with U_f^T u = 0 that minimises elastic energy less work of the weight: dense Newton."""
    mesh, dim = body.mesh, body.dim
    free = np.setdiff1d(np.arange(body.n_nodes), body.handles.frame_nodes)
    among = sl.null_space(body.constraint_basis[free].T) if body.handles.n_points else np.eye(len(free))
    null = np.kron(among, np.eye(dim))
    weight = body.node_mass[:, None] * acceleration
    dofs = (mesh.cells[:, :, None] * dim + np.arange(dim)).reshape(mesh.n_cells, -1)
    unknowns = (free[:, None] * dim + np.arange(dim)).ravel()
    u = np.zeros_like(mesh.points) + start
    for _ in range(20):
        x = body.basis @ rows + u
        residual = (elastic_gradient(mesh, body.material, x) - weight)[free].ravel()
        hessian = np.zeros((body.n_nodes * dim,) * 2)
        tangent = body.material.tangent(mesh.deformation_gradients(x))
        blocks = element_hessians(tangent, mesh.cell_gradients, mesh.cell_volumes)
        np.add.at(hessian, (dofs[:, :, None], dofs[:, None, :]), blocks)
        step = np.linalg.solve(null.T @ hessian[np.ix_(unknowns, unknowns)] @ null, null.T @ residual)
        u[free] -= (null @ step).reshape(-1, dim)
        if np.abs(step).max() < 1e-13:
            return u
    raise AssertionError("the internal equilibrium was not found")


def test_it_is_the_internal_equilibrium_to_first_order(body, response, dim):
    errors = []
    for scale in (4e-4, 2e-4):
        rows = strained(body, scale)
        acceleration = 1e3 * scale * response.gravity  # weight and strain vanish together
        scaled = replace(response, gravity=acceleration)
        exact = internal_equilibrium(body, rows, acceleration)
        error = np.linalg.norm(scaled.displacement(rows, rows) - exact)
        errors.append(error)
        assert error < 0.06 * np.linalg.norm(exact)
    # Halving the strain quarters the error.
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.2)


def test_arrays_of_a_file_give_it_back(body, response):
    arrays = {**condensation_arrays(response), "other": np.zeros(1)}
    again = take_condensation(arrays)
    assert list(arrays) == ["other"]
    np.testing.assert_array_equal(again.modes, response.modes)
    np.testing.assert_array_equal(again.rest_rows, response.rest_rows)
    assert take_condensation(arrays) is None


def test_no_node_is_farther_away_than_the_bound(body, response, dim):
    reach = PositionBounds(body.basis, response, body.handles)
    turn = strained(body, 3e-3)
    for scale in (0.0, 1e-4, 1e-3):
        rows = moved(body, turn, np.eye(dim), 0.3)
        rows = body.handles.retract(rows, scale * np.random.default_rng(1).normal(size=body.n_dofs))
        x, bound = reach(rows, turn)
        away = np.linalg.norm(body.basis @ rows + response.displacement(rows, turn) - x, axis=1)
        assert (away <= bound + 1e-7).all()  # float32 of the modes: at the turn both are nothing
        assert bound.max() < 10.0 * away.max() + 1e-7  # a bound, and not a useless one
