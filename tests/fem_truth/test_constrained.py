"""The constrained solve: constraint, stationarity, a dense KKT solve of the same problem, and correct
statuses."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.linalg import null_space as scipy_null_space

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.energy.potentials import Gravity
from softprint.fem_truth.linalg.null_space import NullSpace
from softprint.fem_truth.statics.constrained import ConstrainedProblem, InternalEnergy
from softprint.fem_truth.statics.newton import FullSpaceSettings, minimise
from softprint.fem_truth.statics.stability import smallest_ritz_value
from softprint.runtime.colliders import RigidPose, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.optimise import NewtonSettings, Status

GRAVITY = {2: np.array([0.0, -9.81]), 3: np.array([0.0, 0.0, -9.81])}
TIGHT = FullSpaceSettings(NewtonSettings(60, 1e-9), 1e-14, cg_tolerance_min=1e-8)
CONTACT = PenaltyContact(1e9, refinement=0)  # at nodes: simple enough to be written out here
both = pytest.mark.parametrize("dim", [2, 3])
however_held = pytest.mark.parametrize("hold", ["projection", "mass"])


@pytest.fixture(scope="session")
def problem(block):
    made = {}

    def make(dim, model="stable_neo_hookean", hold="projection"):
        if (dim, model, hold) not in made:
            body = replace(block(dim, model), hold=hold)
            problem = ConstrainedProblem(FullSpaceElasticity(body), GRAVITY[dim], CONTACT, body)
            made[dim, model, hold] = problem
        return made[dim, model, hold]

    return make


def moved_rows(body, amount=2e-3):
    rows = body.rest_rows.copy()
    count = body.handles.n_points
    rows[:count] += amount * np.random.default_rng(4).standard_normal((count, body.dim))
    return rows


def pressed(body, depth=0.006, radius=0.015):
    """A ball above the middle of the top, `depth` into the body at rest."""
    centre = np.zeros(body.dim)
    centre[-1] = 0.05 + radius - depth
    return Sphere(radius, body.dim), RigidPose(np.eye(body.dim), centre)


@both
@however_held
def test_internal_equilibrium_keeps_the_state_and_is_stationary(problem, dim, hold):
    problem = problem(dim, hold=hold)
    rows = moved_rows(problem.body)
    solution = problem.internal_equilibrium(rows)
    assert solution.converged, solution.reason
    assert solution.stable
    assert solution.min_eigenvalue > 0
    assert problem.violation(rows, solution.x) < 1e-10  # metres
    np.testing.assert_allclose(problem.body.project(solution.x), rows, atol=1e-10)
    frame = problem.body.handles.frame_nodes
    np.testing.assert_allclose(solution.x[frame], problem.body.reduced_positions(rows)[frame], atol=1e-15)
    elastic = problem.elasticity.gradient(solution.x)
    total = elastic - problem.body.node_mass[:, None] * GRAVITY[dim]
    # the tolerance of the solve is 1e-7 of the elastic force
    assert np.linalg.norm(problem.null_space.project(total)) < 1e-7 * np.linalg.norm(elastic)


@both
@pytest.mark.parametrize("model", ["stable_neo_hookean", "neo_hookean"])
def test_contact_solution_is_that_of_a_dense_kkt_newton(problem, dim, model):
    """Newton's method on the saddle-point system, with numpy and no preconditioner, no projection, no CG."""
    problem = problem(dim, model)
    body, rows = problem.body, moved_rows(problem.body)
    collider, pose = pressed(body)
    internal = problem.internal_equilibrium(rows).x
    solution = problem.solve(rows, collider, pose, internal, TIGHT, internal)
    assert solution.converged, solution.reason
    assert solution.max_depth > 1e-4
    assert problem.violation(rows, solution.x) < 1e-10

    free = np.setdiff1d(np.arange(body.n_nodes), body.handles.frame_nodes)
    unknowns = (free[:, None] * dim + np.arange(dim)).ravel()
    constraint = np.kron(body.constraint_basis[free], np.eye(dim))
    # The constrained minimiser is unique near here: Newton from a perturbed solution has to return to it.
    x = problem.constrained(
        rows, solution.x + 1e-5 * np.random.default_rng(5).standard_normal(solution.x.shape)
    )
    nodes, areas = body.mesh.surface_nodes, body.mesh.surface_areas
    for _ in range(12):
        terms = CONTACT.terms(x[nodes], areas, collider, pose)
        gradient = problem.elasticity.gradient(x) - body.node_mass[:, None] * GRAVITY[dim]
        gradient[nodes[terms.index]] += terms.gradient
        hessian = problem.elasticity.hessian(x)
        hessian.add_diagonal(nodes[terms.index], terms.hessian)
        stiffness = hessian.sparse().toarray()[np.ix_(unknowns, unknowns)]
        count = constraint.shape[1]
        kkt = np.block([[stiffness, constraint], [constraint.T, np.zeros((count, count))]])
        step = np.linalg.solve(kkt, np.concatenate([-gradient.ravel()[unknowns], np.zeros(count)]))
        x[free] += step[: len(unknowns)].reshape(-1, dim)
    displacement = np.abs(solution.x - internal).max()
    # a residual of 1e-9 times a condition number of about 100
    assert np.abs(x - solution.x).max() < 1e-7 * displacement


@both
@however_held
@pytest.mark.parametrize("frame", [False, True])
def test_the_handle_force_is_the_derivative_of_the_energy_of_equilibria(problem, dim, hold, frame):
    """Along a displacement of the point handles, and along a rigid motion of the frame."""
    problem = problem(dim, hold=hold)
    body, rows = problem.body, moved_rows(problem.body)
    collider, pose = pressed(body)
    x0 = problem.internal_equilibrium(rows).x

    def solved(at):
        solution = problem.solve(at, collider, pose, problem.constrained(at, x0), TIGHT, x0)
        assert solution.converged, solution.reason
        return solution

    count = body.handles.n_points
    direction = np.zeros_like(rows)
    if frame:  # rows R^T and the origin
        direction[count:-1], direction[-1] = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 0]])[:dim, :dim], 0.5
    else:
        direction[:count] = np.random.default_rng(6).standard_normal((count, dim))
    direction *= 1e-5 / np.abs(body.basis @ direction).max()  # 10 um
    expected = 0.5 * (solved(rows + direction).energy - solved(rows - direction).energy)
    force = solved(rows).handle_force
    # Central differences of energies that contact makes C2; two energies differ by 1e-4 of their value.
    assert np.vdot(force, direction) == pytest.approx(expected, rel=1e-5)


@both
def test_the_handle_forces_of_contact_sum_to_the_force_of_the_collider(problem, dim):
    problem = problem(dim)
    body, rows = problem.body, moved_rows(problem.body)
    collider, pose = pressed(body)
    internal = problem.internal_equilibrium(rows, TIGHT)
    solution = problem.solve(rows, collider, pose, internal.x, TIGHT)
    nodes, areas = body.mesh.surface_nodes, body.mesh.surface_areas
    push = CONTACT.terms(solution.x[nodes], areas, collider, pose).gradient.sum(axis=0)
    contact = solution.handle_force - internal.handle_force
    origins = np.r_[: body.handles.n_points, len(rows) - 1]  # and the translation of the frame
    # the solves are converged to 1e-9 of the contact force
    np.testing.assert_allclose(contact[origins].sum(axis=0), push, atol=1e-7 * np.linalg.norm(push))


@both
def test_without_columns_it_is_the_unconstrained_equilibrium(problem, dim):
    """With U empty and only the base fixed: forces balance on every free node and the base carries the weight."""
    body, elasticity = problem(dim).body, problem(dim).elasticity
    base = body.handles.frame_nodes
    null_space = NullSpace(np.zeros((body.n_nodes, 0)), base)
    gravity = Gravity(body.node_mass, GRAVITY[dim], body.mesh.points)
    result = minimise(InternalEnergy(elasticity, (gravity,), null_space), body.mesh.points, TIGHT)
    assert result.converged
    total = elasticity.gradient(result.x) + gravity.gradient(result.x)
    weight = body.node_mass.sum() * 9.81
    assert np.abs(np.delete(total, base, axis=0)).max() < 1e-8 * weight
    np.testing.assert_allclose(
        total[base].sum(axis=0), -body.node_mass.sum() * GRAVITY[dim], atol=1e-6 * weight
    )
    assert (result.x - body.mesh.points)[:, -1].min() < -1e-5  # it sags


@both
def test_statuses_are_correct(problem, dim):
    problem, rows = problem(dim), moved_rows(problem(dim).body)
    collider, pose = pressed(problem.body)
    internal = problem.internal_equilibrium(rows).x
    short = problem.solve(
        rows, collider, pose, internal, replace(TIGHT, newton=NewtonSettings(1, 1e-9)), internal
    )
    assert not short.converged
    assert short.status is Status.MAX_ITERATIONS
    assert "iterations ran out" in short.reason
    broken = problem.solve(rows, collider, pose, np.full_like(internal, np.nan), TIGHT, internal)
    assert broken.status is Status.NOT_FINITE
    assert not broken.converged
    apart = RigidPose(np.eye(dim), np.full(dim, 1.0))
    idle = problem.solve(rows, collider, apart, internal, internal=internal)
    assert idle.converged
    assert idle.max_depth == 0.0
    np.testing.assert_allclose(idle.x, internal, atol=1e-8)


@both
def test_default_tolerances_give_one_per_cent(problem, dim):
    problem, rows = problem(dim), moved_rows(problem(dim).body)
    collider, pose = pressed(problem.body)
    internal = problem.internal_equilibrium(rows).x
    loose = problem.solve(rows, collider, pose, internal, internal=internal)
    tight = problem.solve(rows, collider, pose, loose.x, TIGHT, internal)
    assert loose.converged
    assert tight.converged
    error = np.linalg.norm(loose.x - tight.x) / np.linalg.norm(tight.x - internal)
    assert error < 0.01


@both
def test_a_press_agrees_with_single_solves_and_is_reproducible(problem, dim):
    problem, rows = problem(dim), moved_rows(problem(dim).body)
    internal = problem.internal_equilibrium(rows).x
    runs = []
    for _ in range(2):
        press = problem.press(rows, pressed(problem.body)[0], internal)
        runs.append([press.solve(pressed(problem.body, depth)[1]) for depth in (0.003, 0.006)])
    for first, second in zip(*runs, strict=True):
        np.testing.assert_array_equal(first.x, second.x)
    single = problem.solve(rows, *pressed(problem.body), internal, TIGHT, internal)
    difference = np.abs(single.x - runs[0][1].x).max()
    assert difference < 0.01 * np.abs(single.x - internal).max()


@both
def test_linear_response_is_exact_for_a_linear_material(problem, dim):
    problem, rows = problem(dim, "linear"), moved_rows(problem(dim).body)
    collider, pose = pressed(problem.body)
    internal = problem.internal_equilibrium(rows).x
    full = problem.solve(rows, collider, pose, internal, TIGHT, internal)
    linear = problem.linear_response(rows, collider, pose, internal, TIGHT)
    np.testing.assert_allclose(linear.x, full.x, atol=1e-7 * np.abs(full.x - internal).max())


def test_linear_response_is_near_for_a_shallow_contact(problem):
    problem, rows = problem(3), moved_rows(problem(3).body)
    collider, pose = pressed(problem.body, 0.002)
    internal = problem.internal_equilibrium(rows).x
    full = problem.solve(rows, collider, pose, internal, TIGHT, internal).x - internal
    linear = problem.linear_response(rows, collider, pose, internal, TIGHT).x - internal
    assert np.linalg.norm(linear - full) < 0.15 * np.linalg.norm(full)  # measured 0.05 on the fine Jelly


@both
@pytest.mark.parametrize("squeeze", [0.0, 0.6])
def test_smallest_ritz_value_has_the_sign_of_the_lowest_eigenvalue(problem, dim, squeeze):
    """Compressing by 60 % makes the Hessian indefinite; at rest it is positive."""
    problem = problem(dim)
    body, null_space = problem.body, problem.null_space
    x = body.mesh.points * np.array([1.0] * (dim - 1) + [1.0 - squeeze])
    hessian = problem.elasticity.hessian(x)
    lowest = smallest_ritz_value(hessian, null_space)
    projector = np.kron(null_space.project(np.eye(body.n_nodes)), np.eye(dim))
    values = np.linalg.eigvalsh(projector @ hessian.sparse().toarray() @ projector)
    values = values[np.abs(values) > 1e-9 * np.abs(values).max()]  # without the directions that P removes
    assert np.sign(lowest) == np.sign(values[0])
    assert values[0] > 0 if squeeze == 0 else values[0] < 0


@both
def test_smallest_ritz_value_of_a_whole_krylov_space_is_the_lowest_eigenvalue(problem, dim):
    """Of S H S on the scaled null space, by a dense solver. More steps than the space has dimensions: no ghosts."""
    null_space, hessian = (
        problem(dim).null_space,
        problem(dim).elasticity.hessian(problem(dim).body.mesh.points),
    )
    values, vectors = np.linalg.eigh(hessian.diagonal_blocks())
    roots = (vectors / np.sqrt(values)[:, None, :]) @ vectors.transpose(0, 2, 1)
    scaling = block_diag(*roots)
    held = np.eye(hessian.n_nodes * dim)[np.repeat(~null_space.free, dim)]
    allowed = scipy_null_space(
        np.vstack([np.kron(null_space.orthonormal_basis.T, np.eye(dim)) @ scaling, held])
    )
    lowest = np.linalg.eigvalsh(allowed.T @ scaling @ hessian.sparse().toarray() @ scaling @ allowed)[0]
    assert smallest_ritz_value(hessian, null_space, steps=400) == pytest.approx(lowest, rel=1e-9)
