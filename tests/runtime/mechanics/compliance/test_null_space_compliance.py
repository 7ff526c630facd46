"""G of the rest body compared with a direct solve of the constrained problem, for fixed and floating bodies, of one
material and of two."""

import numpy as np
import pytest
import scipy.linalg as sl
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from softprint.runtime.body import assemble_body, frame_in_box, place_handles
from softprint.runtime.elasticity import make_material
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mechanics.compliance.null_space_compliance import (
    NullSpaceCompliance,
    rest_stiffness,
    supports,
)
from softprint.runtime.mesh import box_mesh

# Round-off of float64, 1e-16, in K u, which is the difference of numbers up to 1e6 times the forces in bars that bend
# and have two materials, times ten for its sum over a row and over the elimination.
ROUND_OFF = 1e-9
# Lengths and cells of a square or cube, and of a bar that is ten and more times as long as wide.
SHAPES = {
    (2, "square"): ([0.1, 0.1], [16, 16]),
    (2, "bar"): ([0.3, 0.02], [60, 4]),
    (3, "square"): ([0.1, 0.1, 0.1], [6, 6, 6]),
    (3, "bar"): ([0.2, 0.02, 0.02], [30, 3, 3]),
}


@pytest.mark.parametrize("held", [True, False])
def test_it_solves_the_constrained_problem(dim, held):
    mesh = box_mesh([0.0] * dim, [0.1, 0.05, 0.05][:dim], [6, 3, 3][:dim])
    regions = [frame_in_box(mesh, "base", [[-1.0] * dim, [0.02] + [1.0] * (dim - 1)])] if held else []
    handles = place_handles(mesh, 6, regions)
    body = assemble_body(mesh, handles, make_material("stable_neo_hookean", 2e4, 0.4), 1000.0)
    check(body)


def test_a_body_with_frames_only_is_unconstrained(dim):
    mesh = box_mesh([0.0] * dim, [0.1, 0.05, 0.05][:dim], [6, 3, 3][:dim])
    ends = [[[-1.0] * dim, [0.02] + [1.0] * (dim - 1)], [[0.08] + [-1.0] * (dim - 1), [1.0] * dim]]
    handles = place_handles(mesh, 0, [frame_in_box(mesh, f"end{k}", box) for k, box in enumerate(ends)])
    body = assemble_body(mesh, handles, make_material("stable_neo_hookean", 2e4, 0.4), 1000.0)
    check(body)


@pytest.mark.parametrize("contrast", [1.0, 30.0, 250.0])
@pytest.mark.parametrize("points", [4, 8])
@pytest.mark.parametrize("shape", ["square", "bar"])
def test_a_floating_body_of_two_materials_balances_its_forces(dim, shape, points, contrast):
    """Two fifths of it are stiffer than the rest; four points hold little more than the rigid motions, and all of the
    rest of the bar bends. Forces on the far corner, on the surface midway in the soft part, and inside."""
    body = two_materials(dim, shape, points, contrast)
    shares = np.array([[1.0, 1.0, 1.0], [0.7, 0.5, 1.0], [0.3, 0.5, 0.4]])[:, :dim]
    places = shares * SHAPES[dim, shape][0]
    nodes = [np.linalg.norm(body.mesh.points - place, axis=1).argmin() for place in places]
    forces = np.zeros((body.n_nodes, dim, 3))
    forces[nodes, -1, np.arange(3)] = 1.0
    found = NullSpaceCompliance(body).solve(forces).reshape(-1, 3)
    expected = of_the_multipliers(body, forces.reshape(-1, 3))
    error = np.linalg.norm(found - expected, axis=0) / np.linalg.norm(expected, axis=0)
    assert error.max() < ROUND_OFF


def test_a_stiffness_that_resists_rigid_motions_may_be_given(dim):
    """As that of a deformed body under load does. The supports are taken out of it as well."""
    body = two_materials(dim, "square", 4, 30.0)
    stiffness = rest_stiffness(body)
    grounded = stiffness + 0.1 * sp.diags(stiffness.diagonal())
    forces = np.random.default_rng(0).normal(size=(body.n_nodes, dim, 2))
    found = NullSpaceCompliance(body).with_stiffness(grounded).solve(forces).reshape(-1, 2)
    expected = of_the_multipliers(body, forces.reshape(-1, 2), grounded)
    assert np.abs(found - expected).max() < ROUND_OFF * np.abs(expected).max()


def test_forces_that_hold_the_state_displace_nothing(dim):
    """G C = 0: of them only the round-off of their projection is left, and that is solved as well."""
    body = two_materials(dim, "bar", 4, 250.0)
    held = np.einsum("np,ab->napb", body.constraint_basis, np.eye(dim)).reshape(body.n_nodes, dim, -1)
    response = NullSpaceCompliance(body)
    nearby = np.abs(response.solve(np.abs(held))).max()
    assert np.abs(response.solve(held)).max() < ROUND_OFF * nearby
    assert not response.solve(np.zeros((body.n_nodes, dim, 1))).any()


def test_what_round_off_leaves_unsolved_is_an_error():
    """A part 10^12 times as stiff as the rest: K u of its rigid motion has round-off of the size of the forces."""
    body = two_materials(3, "bar", 4, 1e12)
    with pytest.raises(SoftprintError, match="differ too much in stiffness"):
        NullSpaceCompliance(body).solve(np.random.default_rng(0).normal(size=(body.n_nodes, 3, 2)))


def test_supports_prevent_every_rigid_motion(dim):
    """Of a needle too, whose turn about itself moves points by no more than its width over its length."""
    needle = np.random.default_rng(0).uniform(size=(50, dim)) * ([1.0] + [0.01] * (dim - 1))
    rigid = [np.broadcast_to(axis, needle.shape) for axis in np.eye(dim)]
    for i in range(dim):
        for j in range(i):
            turn = np.zeros((dim, dim))
            turn[i, j], turn[j, i] = 1.0, -1.0
            rigid.append(needle @ turn)
    at = supports(needle)
    assert len(at) == len(rigid)
    motions = np.reshape(rigid, (len(rigid), -1))[:, at]
    # A tenth of that: the points are random, and none are at its corners.
    assert np.linalg.svd(motions, compute_uv=False).min() > 0.001


def two_materials(dim, shape, points, contrast):
    """A body without frames whose left two fifths are stiffer by the contrast."""
    size, cells = SHAPES[dim, shape]
    mesh = box_mesh([0.0] * dim, size, cells)
    young = np.where(mesh.cell_centroids[:, 0] < 0.4 * size[0], contrast * 2e4, 2e4)
    material = make_material("stable_neo_hookean", young, 0.4)
    return assemble_body(mesh, place_handles(mesh, points, []), material, 1000.0, name="two materials")


def of_the_multipliers(body, forces, stiffness=None):
    """u of [[K, C], [C^T, 0]] [u, lambda] = [f, 0], with C scaled as K is, by a sparse LU with pivoting."""
    K = rest_stiffness(body) if stiffness is None else stiffness
    columns = np.linalg.qr(body.constraint_basis)[0]
    C = sp.csr_matrix(K.diagonal().mean() * np.kron(columns, np.eye(body.dim)))
    whole = sp.bmat([[K, C], [C.T, None]]).tocsc()
    loads = np.vstack([forces, np.zeros((C.shape[1], forces.shape[1]))])
    return splu(whole).solve(loads)[: len(forces)]


def check(body):
    """Compare with null-space coordinates."""
    dim = body.dim
    free = np.setdiff1d(np.arange(body.n_nodes), body.handles.frame_nodes)
    unknowns = (free[:, None] * dim + np.arange(dim)).ravel()
    stiffness = rest_stiffness(body)[unknowns][:, unknowns].toarray()
    columns = body.constraint_basis[free]
    among = sl.null_space(columns.T) if columns.size else np.eye(len(free))
    null = np.kron(among, np.eye(dim))
    forces = np.random.default_rng(0).normal(size=(body.n_nodes, dim, 4))
    expected = null @ np.linalg.solve(null.T @ stiffness @ null, null.T @ forces[free].reshape(-1, 4))
    found = NullSpaceCompliance(body).solve(forces)
    # With twice the stiffness it gives half the response, and does not change.
    compliance = NullSpaceCompliance(body)
    half = compliance.with_stiffness(2.0 * rest_stiffness(body)).solve(forces)
    np.testing.assert_allclose(half, 0.5 * found, atol=ROUND_OFF * np.abs(found).max())
    np.testing.assert_array_equal(compliance.solve(forces), found)
    assert not found[body.handles.frame_nodes].any()
    error = np.abs(found[free].reshape(-1, 4) - expected).max()
    assert error < ROUND_OFF * np.abs(expected).max()
