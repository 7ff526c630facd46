"""Static condensation: invariance, the constraint, and the exact internal equilibrium by a dense Newton solve."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as sl

from softprint.runtime.body import assemble_body, frame_in_box, place_handles
from softprint.runtime.body.rotations import nearest_rotation, rotation_exponential
from softprint.runtime.elasticity import make_material
from softprint.runtime.elasticity.elastic_energy import elastic_gradient, element_hessians
from softprint.runtime.mechanics.compliance.null_space_compliance import NullSpaceCompliance
from softprint.runtime.mechanics.corotation import local_gradients, mean_gradients
from softprint.runtime.mechanics.position_bounds import PositionBounds
from softprint.runtime.mechanics.static_condensation import (
    compute_static_condensation,
    condensation_arrays,
    take_condensation,
)
from softprint.runtime.mesh import box_mesh


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
def condensation(body, dim):
    """Every part with its own rotation; in float64, so that differences and invariances are accurate to round-off."""
    found = compute_static_condensation(body, gravity(dim), NullSpaceCompliance(body))
    return replace(
        found,
        modes=found.modes.astype(float),
        weight=found.weight.astype(float),
        rotation_gradients=local_gradients(body).astype(float),
    )


def with_one_rotation(body, condensation):
    """The condensation with one rotation for the whole body, the mean over its nodes."""
    return replace(condensation, rotation_gradients=mean_gradients(body))


def displacement(condensation, rows, frame_rows=None):
    """u, with the rotations of the rows themselves by default."""
    return condensation.corotated(rows if frame_rows is None else frame_rows).displacement(rows)


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


def test_it_rotates_with_the_body(body, condensation, dim):
    rotation = rotation_exponential(np.array([2.0] if dim == 2 else [1.0, -2.0, 0.7]))
    rows = strained(body, 3e-3)
    there = moved(body, rows, rotation, np.array([0.3, -0.2, 0.5])[:dim])
    rotated = replace(condensation, gravity=rotation @ condensation.gravity)
    rotations, rotations_there = condensation.corotated(rows).rotations, rotated.corotated(there).rotations
    assert np.abs(rotations - rotations[0]).max() > 1e-3  # every node has its own
    np.testing.assert_allclose(rotations_there, rotation @ rotations, atol=1e-12)
    expected = displacement(condensation, rows) @ rotation.T
    np.testing.assert_allclose(displacement(rotated, there), expected, atol=1e-11 * np.abs(rows).max())


def test_a_rigid_motion_causes_no_strain(body, condensation, dim):
    rotation = rotation_exponential(np.array([2.0] if dim == 2 else [1.0, -2.0, 0.7]))
    rows = moved(body, body.rest_rows, rotation, np.full(dim, 0.1))
    # float32 of the rotation gradients.
    np.testing.assert_allclose(condensation.corotated(rows).rotations - rotation, 0.0, atol=1e-7)
    weightless = replace(condensation, gravity=np.zeros(dim))
    # Round-off: the rotation leaves no strain of the rows, and the mean translation is taken out.
    assert np.abs(displacement(weightless, rows)).max() < 1e-12


def test_tiny_changes_are_resolved(body, condensation):
    """Modes are float32, but their coefficients are not rounded: with fixed rotations u is affine in the rows, down to
    the nanometres of a line search."""
    single = replace(condensation, modes=condensation.modes.astype(np.float32))
    rows = strained(body, 3e-3)
    change = 1e-9 * np.random.default_rng(7).normal(size=rows.shape)
    corotated = single.corotated(rows)
    gained = corotated.displacement(rows + change) - corotated.displacement(rows)
    expected = np.tensordot(corotated.jacobian(), change, 2)
    # Round-off of float64, of displacements of a millimetre; in float32 it would be a tenth of a nanometre.
    np.testing.assert_allclose(gained, expected, rtol=0.0, atol=1e-16)
    assert np.abs(expected).max() > 1e-10


def test_without_two_frames_it_has_one_rotation(body, dim):
    """As if every node had the rotation of the mean deformation gradient."""
    condensation = compute_static_condensation(body, gravity(dim), NullSpaceCompliance(body))
    rows = strained(body, 3e-3)
    assert condensation.corotation.uniform
    volumes = body.mesh.cell_volumes
    F = np.tensordot(volumes, body.mesh.deformation_gradients(body.basis @ rows), 1) / volumes.sum()
    R = nearest_rotation(F)
    corotated = condensation.corotated(rows)
    # float32 of the rotation gradients.
    np.testing.assert_allclose(
        corotated.rotations, np.broadcast_to(R, (len(condensation), dim, dim)), atol=1e-6
    )
    strain = condensation.centred(rows) @ R - condensation.centred_rest_rows
    hanging = condensation.gravity @ R
    expected = np.tensordot(condensation.modes, strain, 2) + condensation.weight @ hanging
    found = corotated.displacement(rows)
    np.testing.assert_allclose(found, expected @ R.T, atol=1e-5 * np.abs(found).max())  # float32


def felt(body, u):
    """The projection of u to the reduced state, relative to u."""
    free = np.setdiff1d(np.arange(body.n_nodes), body.handles.frame_nodes)
    return np.abs(body.constraint_basis[free].T @ u[free]).max() / np.abs(u).sum()


def test_it_does_not_change_the_reduced_state(body, condensation):
    """With one rotation; where every node has its own, to first order in strain."""
    rows = strained(body, 3e-3)
    one = displacement(with_one_rotation(body, condensation), rows)
    assert np.abs(one).max() > 1e-5
    assert felt(body, one) < 1e-5  # float32
    weightless = replace(condensation, gravity=np.zeros(body.dim))
    found = []
    for scale in (2e-3, 1e-3):
        rows = strained(body, scale)
        u = displacement(weightless, rows)
        assert not u[body.handles.frame_nodes].any()
        found.append(felt(body, u))
    # u is of first order, its projection of second order.
    assert found[1] < 0.01
    assert found[0] / found[1] == pytest.approx(2.0, rel=0.3)


def test_with_one_rotation_it_is_the_rotated_condensation_at_rest(body, condensation, dim):
    rows = strained(body, 3e-3)
    one = with_one_rotation(body, condensation).corotated(rows)
    R = one.rotations[0]
    d = rows @ R - body.rest_rows
    expected = (condensation.modes.reshape(-1, d.size) @ d.ravel()).reshape(-1, dim)
    expected += condensation.weight @ (condensation.gravity @ R)
    # float32 of modes that annihilate translations to 1e-7.
    np.testing.assert_allclose(one.displacement(rows), expected @ R.T, atol=1e-9)


def test_jacobian(body, condensation, dim):
    rng = np.random.default_rng(0)
    rows = strained(body, 3e-3)
    frame_rows = moved(
        body,
        strained(body, 5e-3),
        rotation_exponential(np.array([0.4] if dim == 2 else [0.4, -0.3, 0.2])),
        0.1,
    )
    corotated = condensation.corotated(frame_rows)
    jacobian = corotated.jacobian()
    way = rng.normal(size=rows.shape)
    ahead, behind = corotated.displacement(rows + way), corotated.displacement(rows - way)
    # Affine with fixed rotations: differences over any distance are exact.
    np.testing.assert_allclose(np.einsum("narb,rb->na", jacobian, way), 0.5 * (ahead - behind), atol=1e-12)
    few = np.array([7, 3, 20])
    np.testing.assert_allclose(corotated.jacobian(few), jacobian[few], atol=1e-15)
    forces = rng.normal(size=(len(few), dim))
    expected = np.einsum("na,narb->rb", forces, jacobian[few])
    np.testing.assert_allclose(corotated.pulled_back(forces, few), expected, atol=1e-13)
    u = corotated.displacement(rows)[few]
    np.testing.assert_allclose(corotated.displacement(rows, few), u, atol=1e-12)
    np.testing.assert_allclose(displacement(condensation.at(few), rows, frame_rows), u, atol=1e-12)


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


def test_it_is_the_internal_equilibrium_to_first_order(body, condensation, dim):
    errors = []
    for scale in (4e-4, 2e-4):
        rows = strained(body, scale)
        acceleration = 1e3 * scale * condensation.gravity  # weight and strain vanish together
        scaled = replace(condensation, gravity=acceleration)
        exact = internal_equilibrium(body, rows, acceleration)
        error = np.linalg.norm(displacement(scaled, rows) - exact)
        errors.append(error)
        assert error < 0.06 * np.linalg.norm(exact)
    # Halving the strain quarters the error.
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.2)


def test_array_round_trip(body, condensation):
    arrays = {**condensation_arrays(condensation), "other": np.zeros(1)}
    again = take_condensation(arrays)
    assert list(arrays) == ["other"]
    np.testing.assert_array_equal(again.modes, condensation.modes)
    np.testing.assert_array_equal(again.rest_rows, condensation.rest_rows)
    assert take_condensation(arrays) is None


def test_no_node_is_farther_away_than_the_bound(body, condensation, dim):
    frame_rows = strained(body, 3e-3)
    corotated = condensation.corotated(frame_rows)
    condensed = corotated.displacement(frame_rows)
    bounded = PositionBounds(body.basis, condensation, body.handles).about(frame_rows, condensed)
    for scale in (0.0, 1e-4, 1e-3):
        rows = moved(body, frame_rows, np.eye(dim), 0.3)
        rows = body.handles.retract(rows, scale * np.random.default_rng(1).normal(size=body.n_dofs))
        x, bound = bounded(rows)
        away = np.linalg.norm(body.basis @ rows + corotated.displacement(rows) - x, axis=1)
        assert (away <= bound + 1e-7).all()  # float32 of the modes: at the frame rows both are nothing
        assert bound.max() < 10.0 * away.max() + 1e-7  # a bound, and not a useless one
