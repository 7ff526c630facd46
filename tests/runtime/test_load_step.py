"""The compiled linear systems of loads, against the same in dense matrices."""

import numpy as np
import pytest

from runtime.contact.condensed import contact_solve_kernels
from runtime.contact.condensed.contact_solve import ContactProblem, ContactSolution
from runtime.contact.condensed.woodbury import WoodburyFactor

M = 9


@pytest.fixture(params=[2, 3])
def pressed(request):
    """A problem and something like its solution: some loads bear pressure, the distance is curved any way it likes."""
    dim = request.param
    rng = np.random.default_rng(dim)
    root = rng.normal(size=(M * dim, M * dim)) / np.sqrt(M * dim)
    G = 1e-3 * (root @ root.T + 0.1 * np.eye(M * dim))
    F = np.eye(dim) + 0.2 * rng.normal(size=(M, dim, dim))
    normal = rng.normal(size=(M, dim))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    curvature = 10.0 * rng.normal(size=(M, dim, dim))
    curvature += curvature.transpose(0, 2, 1)
    k, left = np.full(M, 5e5), 1e-2 * rng.uniform(-1, 1, M)
    pressure = k * np.maximum(left, 0.0) ** 2
    given = 1e-3 * rng.normal(size=(M, dim))
    moved = np.einsum("jab,jb->ja", F, given)
    problem = ContactProblem(G, F, k, rng.normal(size=(M, dim)), 1e-2, lambda x: None)
    return problem, ContactSolution(left, normal, curvature, pressure, given, moved, 1.0, True, 1, 0.0)


def dense(problem, solution):
    """G_w = F G F^T and D (k*dim, k*dim) among the loads that bear pressure."""
    b, dim = solution.bearing, problem.position.shape[1]
    F, D = (np.zeros((len(b), dim, len(b), dim)) for _ in range(2))
    for at, j in enumerate(b):
        n = solution.normal[j]
        F[at, :, at] = problem.F[j]
        D[at, :, at] = (
            2 * problem.stiffness[j] * solution.left[j] * np.outer(n, n)
            - solution.pressure[j] * solution.curvature[j]
        )
    size = len(b) * dim
    F, D = F.reshape(size, size), D.reshape(size, size)
    rows = (b[:, None] * dim + np.arange(dim)).ravel()
    return F @ problem.compliance[np.ix_(rows, rows)] @ F.T, D


def test_the_factor_is_the_inverse_of_the_dense_matrix(pressed):
    problem, solution = pressed
    factor, (G, D) = WoodburyFactor(problem, solution), dense(problem, solution)
    c = np.random.default_rng(1).normal(size=(len(G), 4))
    softened = np.linalg.solve(np.eye(len(G)) + G @ D, c)
    # Directions of a share below 1e-9 are left out, of systems with condition numbers of a hundred.
    np.testing.assert_allclose(factor.soften(c), softened, atol=1e-6 * np.abs(softened).max())
    np.testing.assert_allclose(factor.stiffen(c), D @ softened, atol=1e-6 * np.abs(D @ softened).max())
    energy = c.T @ D @ softened
    np.testing.assert_allclose(factor.curvature(c), energy, atol=1e-6 * np.abs(energy).max())
    np.testing.assert_allclose(factor.carried(factor.given(factor.carried_back(c))), G @ c, atol=1e-12)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_a_step_solves_the_linearised_balance(pressed, kind, monkeypatch):
    problem, solution = pressed
    G, k, (m, dim) = problem.compliance.astype(kind), problem.stiffness, problem.position.shape
    e, pressure, v = solution.left, solution.pressure, solution.given
    value, lag = -e + 1e-4, 1e-4 * np.random.default_rng(2).normal(size=(m, dim))
    at = value, solution.normal, solution.curvature
    load, stiff, w, rest = contact_solve_kernels.directions(
        G, problem.F, solution.bearing, k, e, pressure, *at[1:], 1e-12
    )
    for j in solution.bearing:
        mine = load == j
        D = (w[mine].T * stiff[mine]) @ w[mine]
        expected = 2 * k[j] * e[j] * np.outer(at[1][j], at[1][j]) - pressure[j] * at[2][j]
        np.testing.assert_allclose(D, expected, atol=1e-9 * np.abs(expected).max())
        np.testing.assert_allclose(rest[mine], w[mine] @ problem.F[j], atol=1e-14)
    found, left = contact_solve_kernels.step(G, problem.F, k, e, pressure, v, lag, *at)
    # What is left of dv + lag - G (S n de + p F^T H F dv), n = F^T g, e having changed by de.
    b, dv = solution.bearing, found - v
    moved = np.einsum("jab,jb->ja", problem.F, dv)
    de = -(e + value) - (at[1] * moved).sum(axis=1)
    np.testing.assert_allclose(left[b], (e + de)[b], atol=1e-12)
    force = np.zeros((m, dim))
    force[b] = (2 * k * e * de)[b, None] * at[1][b]
    force[b] += pressure[b, None] * np.einsum("jab,jb->ja", at[2][b], moved[b])
    pulled = np.einsum("jab,ja->jb", problem.F, force)
    missed = dv + lag - (G.astype(float) @ pulled.ravel()).reshape(m, dim)
    # Directions that change less than that share are left out of the system.
    assert np.abs(missed).max() < contact_solve_kernels._SLIGHT * np.abs(dv).max()


def test_products(pressed):
    problem, solution = pressed
    phi = solution.given
    expected = (problem.compliance @ phi.ravel()).reshape(phi.shape)
    np.testing.assert_allclose(
        contact_solve_kernels.product(problem.compliance, phi), expected, rtol=1e-10, atol=1e-20
    )
    weight = np.arange(1.0, M + 1)
    expected = np.einsum("j,jab,ja->jb", weight, problem.F, phi)
    np.testing.assert_allclose(
        contact_solve_kernels.pulled_back(problem.F, weight, phi), expected, rtol=1e-12
    )
    expected = np.einsum("jab,jb->ja", problem.F, phi)
    np.testing.assert_allclose(contact_solve_kernels.moved_by(problem.F, phi), expected, rtol=1e-12)
