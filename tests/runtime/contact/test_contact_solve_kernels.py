"""The compiled kernels of the contact solve and of its nodes, and the linear systems made of them, against the same in
numpy."""

from dataclasses import replace

import numpy as np
import pytest

from softprint.runtime.colliders.collider import SdfDerivatives
from softprint.runtime.contact.solver import contact_point_kernels as point_kernels
from softprint.runtime.contact.solver import contact_solve_kernels as solve_kernels
from softprint.runtime.contact.solver.contact_solve import ContactProblem, ContactSolution
from softprint.runtime.contact.solver.woodbury import WoodburyFactor
from softprint.runtime.mechanics.compliance.surface_compliance_kernels import NodalCompliance

M, NODES = 9, 7
N_ROWS = 7
# The same sums of float64 in another order; of some ten terms of random sign.
RTOL, ATOL = 1e-11, 1e-12


def same(found, expected):
    """Up to the order of sums, relative to the largest entry."""
    np.testing.assert_allclose(found, expected, rtol=RTOL, atol=ATOL * np.abs(expected).max(initial=0.0))


@pytest.fixture(params=[2, 3])
def dim(request):
    return request.param


@pytest.fixture
def pressed(dim):
    """A problem and something like its solution: some points bear pressure, the distance is curved any way it likes."""
    rng = np.random.default_rng(dim)
    root = rng.normal(size=(NODES * dim, NODES * dim)) / np.sqrt(NODES * dim)
    corners = np.array([rng.permutation(NODES)[:dim] for _ in range(M)])
    shares = rng.dirichlet(np.ones(dim), M)
    G = NodalCompliance(1e-3 * (root @ root.T + 0.1 * np.eye(NODES * dim)), corners, shares)
    F = np.eye(dim) + 0.2 * rng.normal(size=(M, dim, dim))
    normal = rng.normal(size=(M, dim))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    curvature = 10.0 * rng.normal(size=(M, dim, dim))
    curvature += curvature.transpose(0, 2, 1)
    k, penetration = np.full(M, 5e5), 1e-2 * rng.uniform(-1, 1, M)
    pressure = k * np.maximum(penetration, 0.0) ** 2
    v = 1e-3 * rng.normal(size=(M, dim))
    problem = ContactProblem(G, F, k, rng.normal(size=(M, dim)), 1e-2, lambda x: None)
    u = np.einsum("jab,jb->ja", F, v)
    return problem, ContactSolution(penetration, normal, curvature, pressure, v, u, 1.0, True, 1, 0.0)


def on_nodes(problem):
    """N^T (NODES*dim, M*dim): what the nodes have of forces on points."""
    dim = problem.position.shape[1]
    N = np.zeros((M, NODES))
    N[np.arange(M)[:, None], problem.compliance.corners] = problem.compliance.shares
    return np.kron(N, np.eye(dim)).T


def among_points(problem):
    """N G N^T (M*dim, M*dim)."""
    shared = on_nodes(problem)
    return shared.T @ problem.compliance.among_nodes.astype(float) @ shared


def in_precision(problem, kind):
    return problem.compliance._replace(among_nodes=problem.compliance.among_nodes.astype(kind))


def dense(problem, solution):
    """G_w = F G F^T and D (k*dim, k*dim) among the active nodes."""
    b, dim = solution.active, problem.position.shape[1]
    F, D = (np.zeros((len(b), dim, len(b), dim)) for _ in range(2))
    for at, j in enumerate(b):
        F[at, :, at], D[at, :, at] = problem.carriers[j], contact_stiffness(problem, solution)[j]
    size = len(b) * dim
    F, D = F.reshape(size, size), D.reshape(size, size)
    rows = (b[:, None] * dim + np.arange(dim)).ravel()
    return F @ among_points(problem)[np.ix_(rows, rows)] @ F.T, D


def contact_stiffness(problem, solution):
    """D_j = 2 k e g g^T - p H (m, dim, dim)."""
    along = np.einsum("ja,jb->jab", solution.normal, solution.normal)
    stiffness = 2.0 * problem.stiffness * solution.penetration
    return stiffness[:, None, None] * along - solution.pressure[:, None, None] * solution.curvature


def test_the_factor_is_the_inverse_of_the_dense_matrix(pressed):
    problem, solution = pressed
    factor = WoodburyFactor(problem.compliance, problem.carriers, problem.stiffness, solution)
    G, D = dense(problem, solution)
    c = np.random.default_rng(1).normal(size=(len(G), 4))
    relaxed = np.linalg.solve(np.eye(len(G)) + G @ D, c)
    # Directions of a share below 1e-9 are left out, of systems with condition numbers of a hundred.
    np.testing.assert_allclose(factor.relaxed(c), relaxed, atol=1e-6 * np.abs(relaxed).max())
    np.testing.assert_allclose(
        factor.effective_stiffness(c), D @ relaxed, atol=1e-6 * np.abs(D @ relaxed).max()
    )
    np.testing.assert_allclose(
        factor.to_world(factor.rest_displacement(factor.to_rest(c))), G @ c, atol=1e-12
    )


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_a_newton_step_solves_the_linearised_balance(pressed, kind):
    problem, solution = pressed
    problem = replace(problem, compliance=in_precision(problem, kind))
    G, k, (m, dim) = problem.compliance, problem.stiffness, problem.position.shape
    e, pressure, v = solution.penetration, solution.pressure, solution.rest_displacement
    at = SdfDerivatives(-e + 1e-4, solution.normal, solution.curvature)
    lag = 1e-4 * np.random.default_rng(2).normal(size=(m, dim))
    A = problem.carriers
    right, *directions, K, projected = solve_kernels.newton_system(G, A, k, e, pressure, lag, *at)
    y = np.linalg.solve(K, projected)
    found, penetration = solve_kernels.newton_step(G, A, e, v, at.value, at.gradient, right, *directions, y)
    # What is left of dv + lag - G (S n de + p F^T H F dv), n = F^T g, e having changed by de.
    b, dv = solution.active, found - v
    moved = np.einsum("jab,jb->ja", problem.carriers, dv)
    de = -(e + at.value) - (at.gradient * moved).sum(axis=1)
    np.testing.assert_allclose(penetration[b], (e + de)[b], atol=1e-12)
    force = np.zeros((m, dim))
    force[b] = (2 * k * e * de)[b, None] * at.gradient[b]
    force[b] += pressure[b, None] * np.einsum("jab,jb->ja", at.hessian[b], moved[b])
    rest_force = np.einsum("jab,ja->jb", problem.carriers, force)
    missed = dv + lag - (among_points(problem) @ rest_force.ravel()).reshape(m, dim)
    # Directions that change less than that share are left out of the system.
    assert np.abs(missed).max() < solve_kernels._SLIGHT * np.abs(dv).max()


def test_the_linear_system_gives_the_newton_step_of_the_energy(pressed, dim):
    """With D cut off at the nodes without pressure, A^T D (I + G_w D)^-1 A (-lag)."""
    problem, solution = pressed
    rng, active = np.random.default_rng(4), solution.active
    lag = 1e-4 * rng.normal(size=(M, dim))
    flat = replace(solution, curvature=np.zeros_like(solution.curvature))  # D >= 0, of one direction a node
    state = problem.stiffness, solution.penetration, solution.pressure, solution.normal, flat.curvature
    *directions, K, projected = solve_kernels.linear_system(
        problem.compliance, problem.carriers, *state, -lag
    )
    found = solve_kernels.expanded(*directions, np.linalg.solve(K, projected), M)
    G, D = dense(problem, flat)
    world = np.einsum("jab,jb->ja", problem.carriers, -lag)[active].ravel()
    force = (D @ np.linalg.solve(np.eye(len(G)) + G @ D, world)).reshape(-1, dim)
    reacting = np.zeros((M, dim))
    reacting[active] = np.einsum("jab,ja->jb", problem.carriers[active], force)
    # Directions that change what they meet by less than that share are left out of the system.
    np.testing.assert_allclose(found, reacting, atol=solve_kernels._SLIGHT * np.abs(reacting).max())


def test_stiffness_directions_make_up_the_contact_stiffness(pressed):
    problem, solution = pressed
    node, stiff, w, v = solve_kernels.stiffness_directions(
        problem.compliance,
        problem.carriers,
        solution.active,
        problem.stiffness,
        solution.penetration,
        solution.pressure,
        solution.normal,
        solution.curvature,
        1e-12,
    )
    for j, D in enumerate(contact_stiffness(problem, solution)):
        mine = node == j
        if j not in solution.active:
            assert not mine.any()
            continue
        found = np.einsum("c,ca,cb->ab", stiff[mine], w[mine], w[mine])
        np.testing.assert_allclose(found, D, atol=1e-9 * np.abs(D).max())
    np.testing.assert_allclose(v, np.einsum("rab,ra->rb", problem.carriers[node], w), atol=1e-14)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_woodbury_matrix(pressed, dim, kind):
    """Displacements of the nodes by some directions V, two of them at one point, and L^-1 + V^T G V."""
    rng = np.random.default_rng(5)
    node = np.array([0, 3, 3, M - 1])
    stiff, v = rng.normal(size=4) * 1e4, rng.normal(size=(4, dim)).astype(kind)
    problem = pressed[0]
    G = in_precision(problem, kind)
    given, K = solve_kernels.displacements_along(G, node, v), solve_kernels.woodbury_matrix(G, node, stiff, v)
    V = np.zeros((M, dim, 4))
    V[node, :, np.arange(4)] = v
    V = V.reshape(M * dim, 4)
    moved = (on_nodes(problem) @ V).T @ problem.compliance.among_nodes
    expected = np.diag(1.0 / stiff) + V.T @ among_points(problem) @ V
    eps = 20 * np.finfo(kind).eps  # sums of some ten terms
    assert given.dtype == K.dtype == kind
    np.testing.assert_allclose(given, moved, rtol=0, atol=eps * np.abs(moved).max())
    np.testing.assert_allclose(K, expected, rtol=0, atol=eps * np.abs(expected).max())


def test_balance(pressed, dim):
    """e of nodes without pressure follows the distance; p = k e^2, lag = v - G F^T p g, and the largest of |F lag| and
    |e + s|."""
    problem, solution = pressed
    F, k, v, e = problem.carriers, problem.stiffness, solution.rest_displacement, solution.penetration
    value = 1e-2 * np.random.default_rng(6).uniform(-1, 1, M)
    found = solve_kernels.balance(problem.compliance, F, k, e, v, value, solution.normal)
    followed = np.where(e > 0.0, e, -value)
    pressure = k * np.maximum(followed, 0.0) ** 2
    phi = np.einsum("j,jab,ja->jb", pressure, F, solution.normal)
    lag = v - (among_points(problem) @ phi.ravel()).reshape(M, dim)
    residual = max(np.abs(e + value)[e > 0.0].max(), np.abs(np.einsum("jab,jb->ja", F, lag)).max())
    for own, expected in zip(found, (followed, pressure, lag, residual), strict=True):
        same(own, expected)


def test_balance_of_a_node_at_infinity_is_none(pressed):
    problem, solution = pressed
    value = np.full(M, np.nan)
    state = solution.penetration, solution.rest_displacement, value, value[:, None] * solution.normal
    residual = solve_kernels.balance(problem.compliance, problem.carriers, problem.stiffness, *state)[3]
    assert residual == np.inf


def test_products(pressed, dim):
    problem, solution = pressed
    v, F, weight = solution.rest_displacement, problem.carriers, np.arange(1.0, M + 1)
    some = v * (np.arange(M) % 2)[:, None]  # most points bear no force
    G = among_points(problem)
    for forces in (v, some):
        same(solve_kernels.product(problem.compliance, forces), (G @ forces.ravel()).reshape(v.shape))
    same(solve_kernels.pulled_back(F, weight, v), np.einsum("j,jab,ja->jb", weight, F, v))
    same(solve_kernels.to_world(F, v), np.einsum("jab,jb->ja", F, v))


def test_energy(pressed):
    problem, solution = pressed
    v, e, k = solution.rest_displacement, solution.penetration, problem.stiffness
    phi = np.random.default_rng(8).normal(size=v.shape)
    expected = 0.5 * np.vdot(phi, v) + (k * np.maximum(e, 0.0) ** 3).sum() / 3.0
    assert solve_kernels.energy(k, phi, v, e) == pytest.approx(expected, rel=RTOL)


def test_near_box(dim):
    rng = np.random.default_rng(9)
    x, reach = rng.normal(size=(200, dim)), rng.uniform(0, 0.3, 200)
    rotation, translation = np.linalg.qr(rng.normal(size=(dim, dim)))[0], rng.normal(size=dim)
    lower, upper = -rng.uniform(0.2, 1.0, dim), rng.uniform(0.2, 1.0, dim)
    z = (x - translation) @ rotation
    inside = ((z >= lower - reach[:, None]) & (z <= upper + reach[:, None])).all(axis=1)
    assert 0 < inside.sum() < 200
    found = point_kernels.near_box(x, rotation, translation, lower, upper, reach)
    np.testing.assert_array_equal(found, np.flatnonzero(inside))


@pytest.mark.parametrize(
    ("nodes", "among"),
    [
        ([1, 4, 6, 9], [0, 1, 2, 6, 7, 9]),
        ([1, 4], [9, 12]),
        ([9, 12], [1, 4]),
        ([], [1, 4]),
        ([1, 4], []),
    ],
)
def test_places(nodes, among):
    nodes, among = np.array(nodes, dtype=np.int64), np.array(among, dtype=np.int64)
    expected = [np.flatnonzero(among == node)[0] if node in among else -1 for node in nodes]
    np.testing.assert_array_equal(point_kernels.places(nodes, among), expected)
    np.testing.assert_array_equal(point_kernels.are_among(nodes, among), np.isin(nodes, among))


def test_largest_norm(dim):
    u, active = np.random.default_rng(10).normal(size=(M, dim)), np.array([2, 5, 6])
    expected = np.linalg.norm(u[active], axis=1).max()
    assert point_kernels.largest_norm(u, active) == pytest.approx(expected, rel=RTOL)
    assert point_kernels.largest_norm(u, active[:0]) == 0.0


def test_blocks_to_world(dim):
    rng = np.random.default_rng(12)
    F, c = rng.normal(size=(M, dim, dim)), rng.normal(size=(M * dim, 4))
    expected = np.einsum("iab,ibn->ian", F, c.reshape(M, dim, 4)).reshape(M * dim, 4)
    same(point_kernels.blocks_to_world(F, c), expected)


def test_projected_and_expanded_are_transposes(dim):
    """W^T c and W y, with the directions w of some nodes as the columns of W, two of them at one node."""
    rng = np.random.default_rng(13)
    node, w = np.array([0, 3, 3, M - 1]), rng.normal(size=(4, dim))
    W = np.zeros((M, dim, 4))
    W[node, :, np.arange(4)] = w
    W = W.reshape(M * dim, 4)
    c, y = rng.normal(size=(M * dim, 5)), rng.normal(size=(4, 5))
    same(point_kernels.projected(node, w, c), W.T @ c)
    same(point_kernels.expanded(node, w, y, M * dim), W @ y)


def test_add_basis(dim):
    rng = np.random.default_rng(15)
    basis, index = rng.normal(size=(M, N_ROWS)), np.array([1, 4, 5])
    before = rng.normal(size=(3, dim, N_ROWS, dim))
    moved = before.copy()
    point_kernels.add_basis(basis, index, moved)
    same(moved, before + np.einsum("kr,ab->karb", basis[index], np.eye(dim)))


def test_handle_forces(dim):
    """sum_j U_j (x) f_j + grad U_j S_j^T: of f the transpose of the position Jacobian without static condensation."""
    rng, index = np.random.default_rng(16), np.array([1, 4, 5])
    basis, gradient = rng.normal(size=(M, N_ROWS)), rng.normal(size=(M, N_ROWS, dim))
    f, S = rng.normal(size=(3, dim)), rng.normal(size=(3, dim, dim))
    gradients = np.ascontiguousarray(gradient.transpose(0, 2, 1))
    found = point_kernels.handle_forces(basis, gradients, index, f, S)
    by_strain = np.einsum("jad,jrd->ra", S, gradient[index])
    same(found, np.einsum("jr,ja->ra", basis[index], f) + by_strain)
    position = np.zeros((len(index), dim, N_ROWS, dim))
    point_kernels.add_basis(basis, index, position)
    same((found - by_strain).ravel(), f.ravel() @ position.reshape(3 * dim, -1))
