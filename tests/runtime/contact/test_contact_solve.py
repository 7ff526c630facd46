"""The contact solve: known roots, and the conditions of balance where there are none."""

import numpy as np
import pytest
import scipy.linalg

from softprint.runtime.arrays import Array
from softprint.runtime.colliders import Box, RigidPose, Sphere
from softprint.runtime.contact.solver.candidates import PosedCollider
from softprint.runtime.contact.solver.contact_solve import ContactProblem, ContactSolution
from softprint.runtime.contact.solver.negative_curvature import modified_newton_change
from softprint.runtime.mechanics.compliance.surface_compliance_kernels import NodalCompliance

A, STIFFNESS, RADIUS = 2e-3, 5e5, 0.02
# Of one node.
SAME_ALL_WAYS = NodalCompliance.at_nodes(A * np.eye(3), 3)


def single(depth: float) -> ContactProblem:
    """One node with the compliance A in all directions, `depth` inside a ball whose centre lies straight below."""
    ball = PosedCollider(Sphere(RADIUS, 3, "ball"), RigidPose.identity(3))
    position = np.array([[0.0, 0.0, RADIUS - depth]])
    return ContactProblem(SAME_ALL_WAYS, np.eye(3)[None], np.array([STIFFNESS]), position, depth, ball)


def descended(problem: ContactProblem) -> ContactSolution:
    """By the line search that Newton's method falls back on."""
    return problem.descend(None)


@pytest.mark.parametrize("solve", [ContactProblem.solve, descended], ids=["newton", "descent"])
def test_penetration_of_one_node_is_the_known_root(solve):
    """e + A k a e^2 = d has the root e = (sqrt(1 + 4 A k a d) - 1) / (2 A k a)."""
    depth, product = 4e-3, A * STIFFNESS
    solution = solve(single(depth))
    root = (np.sqrt(1 + 4 * product * depth) - 1) / (2 * product)
    assert solution.converged
    # Solved to 1e-5 of the depth, of which the energy feels the square.
    assert solution.penetration[0] == pytest.approx(root, rel=1e-5)
    assert solution.displacement[0, 2] == pytest.approx(depth - root, rel=1e-5)
    penalty = STIFFNESS * root**3 / 3
    dent = (depth - root) ** 2 / (2 * A)
    assert solution.energy == pytest.approx(penalty + dent, rel=1e-6)


def block(dim: int, seed: int = 0) -> ContactProblem:
    """Fifteen nodes of a strained body with a random symmetric compliance, pushed into a tilted ball."""
    rng = np.random.default_rng(seed)
    m = 15
    root = rng.normal(size=(m * dim, m * dim)) / np.sqrt(m * dim)
    G = 1e-3 * (root @ root.T + 0.1 * np.eye(m * dim))
    position = np.append(np.zeros(dim - 1), RADIUS) + 3e-3 * rng.uniform(-1, 1, size=(m, dim))
    ball = PosedCollider(
        Sphere(RADIUS, dim, "ball"),
        RigidPose.from_rotation_vector([0.4] if dim == 2 else [0.4, 0.1, 0], np.zeros(dim)),
    )
    F = np.eye(dim) + 0.2 * rng.normal(size=(m, dim, dim))
    compliance = NodalCompliance.at_nodes(G, dim)
    return ContactProblem(
        compliance, F, np.full(m, STIFFNESS), position, -float(ball(position).value.min()), ball
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_forces_and_displacements_are_in_balance(dim):
    problem = block(dim)
    found = problem.solve()
    assert found.converged
    distance = problem.distance(problem.position + found.displacement)
    pressure = problem.stiffness * np.maximum(0.0, -distance.value) ** 2
    force = pressure[:, None] * distance.gradient
    rest_force = np.einsum("jab,ja->jb", problem.carriers, force)
    v = (problem.compliance.among_nodes @ rest_force.ravel()).reshape(force.shape)
    displacement = np.einsum("jab,jb->ja", problem.carriers, v)
    scale = np.abs(found.displacement).max()
    # Solved to 1e-5 of the deepest penetration; pressure, quadratic in what remains of it, amplifies that.
    assert np.abs(displacement - found.displacement).max() < 1e-5 * scale
    assert np.abs(force - found.force).max() < 1e-4 * np.abs(force).max()
    assert found.iterations <= 8


@pytest.mark.parametrize("dim", [2, 3])
def test_newton_and_descent_find_the_same(dim):
    problem = block(dim)
    newton, descent = problem.solve(), descended(problem)
    assert descent.converged
    # Both solved to 1e-5 of the depth, which pressure amplifies.
    assert np.abs(newton.force - descent.force).max() < 1e-4 * np.abs(newton.force).max()
    assert newton.energy == pytest.approx(descent.energy, rel=1e-6)


def test_warm_start_takes_fewer_iterations():
    nearby, problem = block(3), block(3)
    nearby.position[:, 2] -= 2e-5
    before = nearby.solve()
    cold, warm = problem.solve(), problem.solve((before.penetration, before.normal))
    assert warm.iterations < cold.iterations
    assert np.abs(warm.force - cold.force).max() < 1e-5 * np.abs(cold.force).max()


def test_a_node_stays_on_the_side_that_it_came_from():
    """In a slab a node beyond the middle may leave on either side; the one next to the state before is a motion."""
    slab = PosedCollider(Box([0.02, 0.02, 2e-3], name="slab"), RigidPose.identity(3))
    past_the_middle = np.array([[0.0, 0.0, -4e-4]])
    problem = ContactProblem(
        SAME_ALL_WAYS, np.eye(3)[None], np.array([STIFFNESS]), past_the_middle, 1.6e-3, slab
    )
    up = np.array([1.4e-3]), np.array([[0.0, 0.0, 1.0]])
    assert problem.solve(up).displacement[0, 2] > 0.0 > problem.solve().displacement[0, 2]


@pytest.mark.parametrize("dim", [2, 3])
def test_nodes_that_join_start_without_pressure(dim):
    """The solve of more nodes goes on from that of fewer, and comes to what it comes to from the start."""
    problem, every_other = block(dim), np.arange(15) % 2 == 0
    fewer = ContactProblem(
        problem.compliance.taken(np.flatnonzero(every_other), dim),
        problem.carriers[every_other],
        problem.stiffness[every_other],
        problem.position[every_other],
        problem.depth,
        problem.distance,
    )
    before = fewer.solve()
    penetration, normal = before.extended(every_other)
    np.testing.assert_array_equal(penetration[every_other], before.penetration)
    np.testing.assert_array_equal(normal[every_other], before.normal)
    assert (penetration[~every_other] == -np.inf).all()
    joined, expected = problem.solve((penetration, normal)), problem.solve()
    # Both solved to 1e-5 of the depth, which pressure amplifies.
    assert np.abs(joined.force - expected.force).max() < 1e-4 * np.abs(expected.force).max()


def imbalance(dim: int, curved: float) -> tuple[Array, Array, Array, Array, Array]:
    """G, F, a contact stiffness D with tangential stiffness -curved, and forces phi that do not balance `balanced`."""
    rng = np.random.default_rng(5)
    m = 12
    root = rng.normal(size=(m * dim, m * dim)) / np.sqrt(m * dim)
    G = root @ root.T + 0.1 * np.eye(m * dim)
    normal = rng.normal(size=(m, dim))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    along = normal[:, :, None] * normal[:, None, :]
    D = 3.0 * along - curved * (np.eye(dim) - along)
    F = np.eye(dim) + 0.1 * rng.normal(size=(m, dim, dim))
    return G, F, D, rng.normal(size=(m, dim)), rng.normal(size=(m, dim))


def displaced_by(G: Array):
    """The product with G of forces (m, dim)."""
    return lambda forces: (G @ forces.ravel()).reshape(forces.shape)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_modified_step_is_newtons_where_the_energy_is_convex(dim):
    G, F, D, phi, balanced = imbalance(dim, curved=0.0)
    change = modified_newton_change(displaced_by(G), F, D, phi - balanced)
    at_rest = scipy.linalg.block_diag(*np.einsum("jab,jac,jcd->jbd", F, D, F))
    newton = np.linalg.solve(np.eye(len(G)) + at_rest @ G, (balanced - phi).ravel())
    # Conjugate gradients end at 1e-4 of the imbalance.
    np.testing.assert_allclose(change.ravel(), newton, atol=1e-3 * np.abs(newton).max())


@pytest.mark.parametrize("dim", [2, 3])
def test_a_modified_step_descends_where_the_energy_is_not_convex(dim):
    G, F, D, phi, balanced = imbalance(dim, curved=3.0)
    at_rest = scipy.linalg.block_diag(*np.einsum("jab,jac,jcd->jbd", F, D, F))
    assert np.linalg.eigvalsh(G + G @ at_rest @ G).min() < 0.0
    slope = G @ (phi - balanced).ravel()
    newton = np.linalg.solve(np.eye(len(G)) + at_rest @ G, (balanced - phi).ravel())
    change = modified_newton_change(displaced_by(G), F, D, phi - balanced).ravel()
    assert slope @ change < 0.0
    assert slope @ change < slope @ newton


def test_a_point_that_slides_off_a_tip_is_followed_down():
    """A surface that yields four times as much sideways: in the middle of a tip a point is in an unstable balance. Next
    to it the energy is nearly flat, and its way down is sideways."""
    tip = PosedCollider(Sphere(2e-3, 3, "tip"), RigidPose.identity(3))
    compliance = NodalCompliance.at_nodes(5e-3 * np.diag([4.0, 1.0, 1.0]), 3)
    position = np.array([[1e-5, 0.0, -1e-3]])
    problem = ContactProblem(compliance, np.eye(3)[None], np.array([3e6]), position, 1e-3, tip)
    penetration = 2.1e-4  # of the unstable balance: e + 5e-3 * 3e6 e^2 = 1 mm
    found = problem.descend((np.array([penetration]), np.array([[1e-4, 0.0, -1.0]])))
    assert found.converged
    assert found.displacement[0, 0] > 1e-3
    assert found.iterations <= 12  # 10; without the curvature of the tip where it does not descend: 17
