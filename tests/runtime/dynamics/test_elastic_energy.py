"""Elastic energy of meshes and reduced bodies: finite differences, patch test, rigid motions."""

import numpy as np
import pytest

from softprint.runtime.body import assemble_body, frame_in_box, place_handles
from softprint.runtime.dynamics.corrected_points import CorrectedPoints
from softprint.runtime.dynamics.terms.elastic import ElasticEnergy
from softprint.runtime.elasticity import make_material
from softprint.runtime.elasticity.displacement_field import CorrectionField
from softprint.runtime.elasticity.elastic_energy import elastic_energy, elastic_gradient, element_hessians
from softprint.runtime.elasticity.reduced_elasticity import ReducedElasticity
from softprint.runtime.mesh import box_mesh

STEP = 1e-6  # m on a body of 1 m: central differences err by about 1e-9 relative
DIFFERENCE = 1e-7


@pytest.fixture(params=[2, 3])
def body(request):
    """A small box with two materials and one frame."""
    dim = request.param
    mesh = box_mesh([0.0] * dim, [1.0] * dim, [4, 3, 3][:dim])
    handles = place_handles(mesh, 5, [frame_in_box(mesh, "base", [[-1.0] * dim, [0.3] + [2.0] * (dim - 1)])])
    young = np.where(mesh.cell_centroids[:, 0] > 0.5, 3.0, 1.0)
    return assemble_body(
        mesh, handles, make_material("stable_neo_hookean", young, 0.4), 1.0, points_per_row=3
    )


def bent(body, rng):
    return body.rest_rows + 0.1 * rng.normal(size=body.rest_rows.shape)


def differences(function, x):
    """d function / dx by central differences, x's axes last."""
    columns = []
    for index in range(x.size):
        step = np.zeros(x.size)
        step[index] = STEP
        step = step.reshape(x.shape)
        columns.append((np.asarray(function(x + step)) - np.asarray(function(x - step))) / (2 * STEP))
    stacked = np.stack(columns, axis=-1)
    return stacked.reshape(*stacked.shape[:-1], *x.shape)


def relative(a, b):
    return np.abs(a - b).max() / np.abs(b).max()


def assemble(mesh, material, x):
    size = mesh.n_nodes * mesh.dim
    blocks = element_hessians(
        material.tangent(mesh.deformation_gradients(x)), mesh.cell_gradients, mesh.cell_volumes
    )
    dofs = (mesh.cells[:, :, None] * mesh.dim + np.arange(mesh.dim)).reshape(mesh.n_cells, -1)
    full = np.zeros((size, size))
    np.add.at(full, (dofs[:, :, None], dofs[:, None, :]), blocks)
    return full


def test_nodal_gradient_and_hessian_are_derivatives(body):
    mesh, material = body.mesh, body.material
    x = body.reduced_positions(bent(body, np.random.default_rng(0)))
    gradient = elastic_gradient(mesh, material, x)
    assert relative(gradient, differences(lambda y: elastic_energy(mesh, material, y), x)) < DIFFERENCE
    hessian = differences(lambda y: elastic_gradient(mesh, material, y), x).reshape(x.size, x.size)
    assert relative(assemble(mesh, material, x), hessian) < DIFFERENCE


def test_rigid_motion_costs_no_energy(body):
    dim = body.dim
    rotation = np.linalg.qr(np.random.default_rng(2).normal(size=(dim, dim)))[0]
    rotation[0] *= np.sign(np.linalg.det(rotation))
    x = body.mesh.points @ rotation.T + 1.0
    assert abs(elastic_energy(body.mesh, body.material, x)) < 1e-13
    assert np.abs(elastic_gradient(body.mesh, body.material, x)).max() < 1e-13


def test_full_cubature_is_the_mesh_energy(body):
    mesh = body.mesh
    full = ReducedElasticity.on_cells(
        mesh, body.basis, body.material, np.arange(mesh.n_cells), mesh.cell_volumes
    )
    rows = bent(body, np.random.default_rng(3))
    x, F = body.reduced_positions(rows), full.deformation_gradients(rows)
    np.testing.assert_allclose(F, mesh.deformation_gradients(x), atol=1e-12)
    assert full.energy(F) == pytest.approx(elastic_energy(mesh, body.material, x), rel=1e-12)
    assert relative(full.gradient(F), body.basis.T @ elastic_gradient(mesh, body.material, x)) < 1e-12
    lift = np.kron(body.basis, np.eye(body.dim))
    assert relative(full.hessian(F), lift.T @ assemble(mesh, body.material, x) @ lift) < 1e-12


def test_reduced_gradient_and_hessian_are_derivatives(body):
    elasticity = body.reduced_elasticity
    rows = bent(body, np.random.default_rng(4))
    F = elasticity.deformation_gradients(rows)
    energy = differences(lambda r: elasticity.energy(elasticity.deformation_gradients(r)), rows)
    assert relative(elasticity.gradient(F), energy) < DIFFERENCE
    slope = differences(lambda r: elasticity.gradient(elasticity.deformation_gradients(r)), rows)
    assert relative(elasticity.hessian(F), slope.reshape(rows.size, rows.size)) < DIFFERENCE


@pytest.mark.parametrize("share", [1.0, 0.3])
def test_corrections_of_corners_add_to_the_basis(body, share):
    """With one that is linear in the rows, x = (U + C) rows, all is that of the basis U + C; C is zero at some."""
    rng = np.random.default_rng(5)
    rows = bent(body, rng)
    points = CorrectedPoints(body, [])
    term = ElasticEnergy(body, points)
    elasticity, dim = body.reduced_elasticity, body.dim
    F = elasticity.deformation_gradients(rows)
    stress = elasticity.weights[:, None, None] * elasticity.material.first_piola(F)
    assert relative(elasticity.gradient_of(stress), elasticity.gradient(F)) < 1e-12
    directions = rng.normal(size=(rows.size, 5))
    whole = elasticity.basis_along(None)
    assert relative(elasticity.basis_along(directions), whole @ directions) < 1e-6  # single precision

    nodes = np.union1d(body.mesh.cells[body.cubature.cells], body.surface.nodes)
    active = np.flatnonzero(rng.random(len(nodes)) < share)
    added = np.zeros(body.basis.shape)
    added[nodes[active]] = 0.05 * rng.normal(size=(len(active), body.n_rows))
    field = CorrectionField(
        active, added[nodes[active]] @ rows, np.einsum("nr,ik->nirk", added[nodes[active]], np.eye(dim))
    )
    moved = ReducedElasticity.on_cells(
        body.mesh, body.basis + added, body.material, body.cubature.cells, body.cubature.weights
    )
    found = term.evaluate(rows, points.scatter(field))
    np.testing.assert_allclose(found.F, moved.deformation_gradients(rows), atol=1e-12)
    gradient, hessian = found.linearise(field)
    assert relative(gradient, moved.gradient(found.F)) < 1e-12
    # In single precision.
    expected = moved.hessian(found.F)
    assert relative(hessian(), expected) < 1e-5
    assert relative(hessian(directions), directions.T @ expected @ directions) < 1e-5


def test_taking_cells_splits_the_sum(body):
    elasticity = body.reduced_elasticity
    F = elasticity.deformation_gradients(bent(body, np.random.default_rng(6)))
    even = np.arange(elasticity.n_cells) % 2 == 0
    parts = [elasticity.take(which).hessian(F[which]) for which in (even, ~even)]
    assert relative(sum(parts), elasticity.hessian(F)) < 1e-12
