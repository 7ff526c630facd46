"""UFL energies compared with the runtime's formulas, finite differences and the invariances of elasticity."""

from dataclasses import replace

import numpy as np
import pytest

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.runtime.elasticity import MATERIALS
from softprint.runtime.elasticity.elastic_energy import elastic_energy, elastic_gradient, element_hessians

DIMS = (2, 3)
ROUND_OFF = 1e-12  # sums of some thousand float64 products
both = pytest.mark.parametrize("dim", DIMS)
every_model = pytest.mark.parametrize("model", MATERIALS)


def deformed(body, amount=2e-3, seed=0):
    return body.mesh.points + amount * np.random.default_rng(seed).standard_normal(body.mesh.points.shape)


def dense(matrix):
    return matrix.sparse().toarray()


@both
@every_model
def test_energy_gradient_and_hessian_are_the_runtimes(block, dim, model):
    body = block(dim, model)
    mesh, material, x = body.mesh, body.material, deformed(body)
    elasticity = FullSpaceElasticity(body)
    assert elasticity.energy(x) == pytest.approx(elastic_energy(mesh, material, x), rel=ROUND_OFF)
    gradient = elastic_gradient(mesh, material, x)
    np.testing.assert_allclose(elasticity.gradient(x), gradient, atol=ROUND_OFF * np.abs(gradient).max())

    n = (dim + 1) * dim
    cells = element_hessians(
        material.tangent(mesh.deformation_gradients(x)), mesh.cell_gradients, mesh.cell_volumes
    )
    unknowns = (mesh.cells[:, :, None] * dim + np.arange(dim)).reshape(mesh.n_cells, n)
    expected = np.zeros((mesh.n_nodes * dim,) * 2)
    np.add.at(expected, (unknowns[:, :, None], unknowns[:, None, :]), cells)
    np.testing.assert_allclose(
        dense(elasticity.hessian(x)), expected, atol=ROUND_OFF * np.abs(expected).max()
    )


@both
@pytest.mark.parametrize("model", [name for name, kind in MATERIALS.items() if kind.finite_if_inverted])
def test_crushed_and_inverted_cells_have_the_runtimes_energy(block, dim, model):
    body = block(dim, model)
    mesh, material, x = body.mesh, body.material, deformed(body)
    x[:, -1] *= 1.0 - 1.5 * x[:, 0] / x[:, 0].max()  # its height falls to less than nothing along it
    volumes = np.linalg.det(mesh.deformation_gradients(x))
    assert volumes.min() < 0.0
    assert ((volumes > 0.0) & (volumes < 0.3)).any()
    elasticity = FullSpaceElasticity(body)
    assert elasticity.energy(x) == pytest.approx(elastic_energy(mesh, material, x), rel=ROUND_OFF)
    gradient = elastic_gradient(mesh, material, x)
    np.testing.assert_allclose(elasticity.gradient(x), gradient, atol=ROUND_OFF * np.abs(gradient).max())


@both
@every_model
def test_derivatives_against_finite_differences(block, dim, model):
    body = block(dim, model)
    elasticity, x = FullSpaceElasticity(body), deformed(block(dim, model), 1e-3)
    v = np.random.default_rng(1).standard_normal(x.shape)
    h = 1e-7  # metres; central differences then err by h^2 from truncation and 1e-16/h from round-off
    slope = (elasticity.energy(x + h * v) - elasticity.energy(x - h * v)) / (2 * h)
    assert np.vdot(elasticity.gradient(x), v) == pytest.approx(slope, rel=1e-6)
    change = (elasticity.gradient(x + h * v) - elasticity.gradient(x - h * v)) / (2 * h)
    product = elasticity.hessian(x).apply(v)
    np.testing.assert_allclose(product, change, atol=1e-6 * np.abs(change).max())


@both
@pytest.mark.parametrize("model", [name for name, kind in MATERIALS.items() if kind.rotation_invariant])
def test_rigid_motions_cost_no_energy_and_rotate_the_forces(block, dim, model):
    body = block(dim, model)
    elasticity, x = FullSpaceElasticity(body), deformed(body)
    turn = np.linalg.qr(np.random.default_rng(2).standard_normal((dim, dim)))[0]
    turn[0] *= np.sign(np.linalg.det(turn))
    moved = x @ turn.T + 0.3
    assert elasticity.energy(moved) == pytest.approx(
        elasticity.energy(x), rel=1e-9
    )  # u of 0.3 m costs digits
    gradient = elasticity.gradient(x) @ turn.T
    np.testing.assert_allclose(elasticity.gradient(moved), gradient, atol=1e-9 * np.abs(gradient).max())
    assert elasticity.energy(body.mesh.points) == pytest.approx(0.0, abs=1e-15 * elasticity.unit_energy)


@both
@every_model
def test_an_affine_patch_has_no_forces_inside(block, dim, model):
    """A homogeneous deformation of a homogeneous body puts no force on interior nodes."""
    body = block(dim, model)
    soft = body.material.at(
        np.zeros(body.mesh.n_cells, dtype=np.int64)
    )  # the first cell's material everywhere
    body = replace(body, material=soft)
    F = np.eye(dim) + 0.1 * np.random.default_rng(3).standard_normal((dim, dim))
    x = body.mesh.points @ F.T
    elasticity = FullSpaceElasticity(body)
    inside = np.setdiff1d(np.arange(body.n_nodes), body.mesh.surface_nodes)
    gradient = elasticity.gradient(x)
    assert np.abs(gradient[inside]).max() < 1e-12 * np.abs(gradient).max()
    density = soft.energy_density(np.broadcast_to(F, (body.mesh.n_cells, dim, dim)))
    assert elasticity.energy(x) == pytest.approx(float(density @ body.mesh.cell_volumes), rel=ROUND_OFF)


@both
def test_hessian_is_not_overwritten_by_the_next(block, dim):
    body = block(dim)
    elasticity = FullSpaceElasticity(body)
    first = elasticity.hessian(body.mesh.points)
    kept = dense(first)
    elasticity.hessian(deformed(body))
    np.testing.assert_array_equal(dense(first), kept)


@pytest.mark.parametrize("model", [name for name, kind in MATERIALS.items() if not kind.finite_if_inverted])
def test_no_energy_inverted(block, model):
    body = block(2, model)
    assert not np.isfinite(FullSpaceElasticity(body).energy(body.mesh.points * [1.0, -1.0]))
