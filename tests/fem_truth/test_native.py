"""The compiled loops compared with numpy, dense algebra and the UFL forms."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.elasticity.native_elasticity import KERNELS
from softprint.fem_truth.linalg.block_kernels import BlockKernels, fitting_tile
from softprint.fem_truth.linalg.block_matrix import BlockMatrix, BlockPattern, UpperBlocks
from softprint.fem_truth.linalg.null_space import NullSpace
from softprint.fem_truth.linalg.projected_cg import NullSpaceSystem, projected_cg
from softprint.runtime.mesh import Mesh

N = 700  # more nodes than are summed in single precision at a time
both = pytest.mark.parametrize("dim", [2, 3])
# Sums of at most some hundred products of numbers of order one, relative to the largest.
ROUND_OFF = {np.float32: 2e-6, np.float64: 1e-14}
either = pytest.mark.parametrize("real", [np.float32, np.float64])


def random_matrix(dim, seed=0):
    """Symmetric and diagonally dominant, hence positive definite: four random neighbours per node."""
    rng = np.random.default_rng(seed)
    pairs = np.sort(rng.integers(N, size=(4 * N, 2)), axis=1)
    pattern, _ = BlockPattern.from_pairs(pairs[pairs[:, 0] < pairs[:, 1]], N)
    upper = rng.uniform(-1, 1, (len(pattern.columns) + 1, dim, dim))
    upper[-1] = 1e30  # values that a load reads behind the last block must not matter
    diagonal = rng.uniform(-1, 1, (N, dim, dim))
    diagonal += diagonal.transpose(0, 2, 1) + 60 * np.eye(dim)
    return BlockMatrix(UpperBlocks(pattern, upper), diagonal)


def null_space(rank, seed=1):
    return NullSpace(np.random.default_rng(seed).standard_normal((N, rank)), np.arange(30))


@both
@either
def test_product_is_that_of_the_whole_matrix(dim, real):
    matrix, v = random_matrix(dim), np.random.default_rng(2).standard_normal((N, dim))
    kernels = BlockKernels.of(dim, real)
    x = kernels.vector(v)
    y = np.empty_like(x)
    diagonal = matrix.diagonal.astype(real)
    pattern, upper = matrix.upper.pattern, matrix.upper.of_type(real)
    curvature = kernels.product(pattern.row_starts, pattern.columns, diagonal, upper, x, y)
    expected = matrix.sparse() @ v.ravel()
    np.testing.assert_allclose(y[:, :dim].ravel(), expected, atol=ROUND_OFF[real] * np.abs(expected).max())
    assert curvature == pytest.approx(float(v.ravel() @ expected), rel=10 * ROUND_OFF[real])
    assert not y[:, dim:].any()  # the padding stays zero


@both
def test_apply_and_diagonal_hold_the_springs(dim):
    matrix, rng = random_matrix(dim), np.random.default_rng(3)
    weights, v = rng.uniform(size=N), rng.standard_normal((N, dim))
    with_spring = matrix.copy()
    with_spring.add_low_rank(weights, 5.0)
    with_spring.add_diagonal(np.array([7]), np.full((1, 1, 1), 2.0))
    dense = matrix.sparse().toarray() + 5.0 * np.kron(np.outer(weights, weights), np.eye(dim))
    dense[7 * dim : 8 * dim, 7 * dim : 8 * dim] += 2.0 * np.eye(dim)
    np.testing.assert_allclose(with_spring.apply(v).ravel(), dense @ v.ravel(), rtol=1e-11)
    blocks = np.stack([dense[i * dim : (i + 1) * dim, i * dim : (i + 1) * dim] for i in range(N)])
    np.testing.assert_allclose(with_spring.diagonal_blocks(), blocks, rtol=1e-13)
    assert not matrix.low_rank  # a copy is a copy


@both
def test_every_product_holds_the_blocks_of_facets(dim):
    matrix, rng = random_matrix(dim), np.random.default_rng(8)
    nodes = np.array([[3, 7, 9], [7, 9, 30], [9, 3, 200]])[:, :dim]
    blocks = rng.standard_normal((3, dim, dim, dim, dim))
    blocks += blocks.transpose(0, 2, 1, 4, 3)  # symmetric as a whole
    v = rng.standard_normal((N, dim))
    dense = matrix.sparse().toarray()
    for own, block in zip(nodes, blocks, strict=True):
        for a, first in enumerate(own):
            for b, second in enumerate(own):
                dense[first * dim : (first + 1) * dim, second * dim : (second + 1) * dim] += block[a, b]
    touched = matrix.copy()
    touched.add_facets(nodes, blocks)
    expected = dense @ v.ravel()
    np.testing.assert_allclose(touched.sparse() @ v.ravel(), expected, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(touched.apply(v).ravel(), expected, rtol=1e-10, atol=1e-10)
    system = NullSpaceSystem(touched, null_space(0), np.float64)
    x = system.kernels.vector(v)
    y = np.empty_like(x)
    curvature = system.product(x, y)
    np.testing.assert_allclose(y[:, :dim].ravel(), expected, rtol=1e-10, atol=1e-10)
    assert curvature == pytest.approx(float(v.ravel() @ expected), rel=1e-10)
    assert not matrix.facets  # a copy is a copy


@both
@either
@pytest.mark.parametrize("rank", [0, 5])
def test_projection_of_the_kernels_is_that_of_the_null_space(dim, real, rank):
    space = null_space(rank)
    kernels, ((_, Q, free),) = space.for_kernels(dim, real)
    v = np.random.default_rng(4).standard_normal((N, dim)) * space.free[:, None]
    z, r = kernels.vector(v), kernels.vector(v)
    rho = kernels.deflate(Q, kernels.coordinates(Q, z), r, z)
    expected = space.project(v)
    np.testing.assert_allclose(z[:, :dim], expected, atol=10 * ROUND_OFF[real])
    assert rho == pytest.approx(float(np.vdot(v, expected)), rel=10 * ROUND_OFF[real])
    identity = np.broadcast_to(np.eye(dim, dtype=real), (N, dim, dim)).copy()
    r, z = kernels.vector(0 * v), np.empty_like(z)
    y = kernels.vector(v)
    square = kernels.descend(Q, kernels.coordinates(Q, y), free, identity, -2.0, y, r, z)
    np.testing.assert_allclose(r[:, :dim], 2.0 * expected, atol=20 * ROUND_OFF[real])
    np.testing.assert_array_equal(z, r)
    assert square == pytest.approx(4.0 * float(np.vdot(expected, expected)), rel=10 * ROUND_OFF[real])


def test_norm_of_a_local_vector_is_that_of_its_projection():
    space, rng = null_space(5), np.random.default_rng(5)
    nodes, v = np.array([3, 100, 400]), rng.standard_normal((3, 3))
    whole = np.zeros((N, 3))
    whole[nodes] = v
    assert space.projected_norm(nodes, v) == pytest.approx(np.linalg.norm(space.project(whole)), rel=1e-12)


def test_tiles_waste_little():
    assert [fitting_tile(rank) for rank in (0, 18, 24, 25, 29)] == [8, 6, 8, 5, 6]


@both
@either
def test_inverses_are_exact_or_of_absolute_eigenvalues(dim, real):
    blocks = random_matrix(dim).diagonal
    turn = np.linalg.qr(np.random.default_rng(6).standard_normal((dim, dim)))[0]
    blocks[40] = turn @ np.diag([-2.0, *[4.0] * (dim - 1)]) @ turn.T
    inverse = BlockKernels.of(dim, real).inverses(blocks)
    expected = np.linalg.inv(blocks)
    expected[40] = turn @ np.diag([0.5, *[0.25] * (dim - 1)]) @ turn.T
    np.testing.assert_allclose(inverse, expected, atol=ROUND_OFF[real])


@both
@pytest.mark.parametrize("tolerance", [1e-3, 1e-10])  # in single and in double precision
def test_projected_cg_solves_the_projected_system(dim, tolerance):
    matrix, space = random_matrix(dim), null_space(6)
    matrix.add_low_rank(np.random.default_rng(7).uniform(size=N), 0.3)
    gradient = 1e-5 * space.project(np.random.default_rng(8).standard_normal((N, dim)))
    result = projected_cg(matrix, gradient, space, tolerance, 200)
    left = np.linalg.norm(space.project(matrix.apply(result.step) + gradient)) / np.linalg.norm(gradient)
    # Single precision adds errors of about 1e-6.
    assert left < 1.01 * tolerance
    assert result.residual == pytest.approx(left, rel=0.01)
    assert result.slope == pytest.approx(float(np.vdot(gradient, result.step)))
    assert not result.negative_curvature
    assert space.violation(result.step) < 1e-15


@both
def test_projected_cg_reports_negative_curvature(dim):
    matrix, space = random_matrix(dim), null_space(6)
    matrix.diagonal[:] *= -1.0
    gradient = space.project(np.random.default_rng(9).standard_normal((N, dim)))
    result = projected_cg(matrix, gradient, space, 1e-3, 200)
    assert result.negative_curvature
    assert float(np.vdot(result.direction, matrix.apply(result.direction))) <= 0
    assert result.slope < 0


@both
@pytest.mark.parametrize("model", sorted(KERNELS))
def test_compiled_cells_are_the_form(block, dim, model):
    """With a number of cells that only half fills the last group of lanes."""
    body = block(dim, model)
    mesh = Mesh(body.mesh.points, body.mesh.cells[: len(body.mesh.cells) // 8 * 8 - 5])
    kept = np.unique(mesh.cells)
    mesh = Mesh(mesh.points[kept], np.searchsorted(kept, mesh.cells))
    body = replace(body, mesh=mesh, material=body.material.at(slice(mesh.n_cells)))
    ours, form = FullSpaceElasticity(body), FullSpaceElasticity(body, forms=True)
    assert type(ours._law) is not type(form._law)
    x = mesh.points + 1e-3 * np.random.default_rng(10).standard_normal(mesh.points.shape)
    energy, gradient = ours.energy_gradient(x)
    expected, slope = form.energy_gradient(x)
    # Sums of some thousand float64 products.
    assert energy == pytest.approx(expected, rel=1e-12)
    assert energy == ours.energy(x)
    np.testing.assert_allclose(gradient, slope, atol=1e-12 * np.abs(slope).max())
    matrix, hessian = ours.hessian(x).sparse().toarray(), form.hessian(x).sparse().toarray()
    np.testing.assert_allclose(matrix, hessian, atol=1e-12 * np.abs(hessian).max())
    assert ours.min_det_F(x) == pytest.approx(form.min_det_F(x), rel=1e-12)


def test_a_missing_compiler_gives_a_clear_error(tmp_path):
    program = (
        "from softprint.fem_truth.native.library import load_library\n"
        "from softprint.runtime.errors import SoftprintError\n"
        "try:\n    load_library('blocks.c', DIM=3, REAL='float', TILE=8)\n"
        "except SoftprintError as error:\n    print(error)\n"
    )
    environment = {**os.environ, "CC": "no-such-compiler", "XDG_CACHE_HOME": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert "no C compiler 'no-such-compiler'" in done.stdout
    assert not list(tmp_path.rglob("*.so*"))
