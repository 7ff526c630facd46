"""Regions that move rigidly in full space: their kinematics, the projected linear systems, and what the body does."""

from dataclasses import replace

import numpy as np
import pytest

from softprint.fem_truth.dynamics.full_space_simulator import FullSpaceSimulator
from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.linalg.null_space import NullSpace
from softprint.fem_truth.linalg.projected_cg import projected_cg
from softprint.fem_truth.linalg.rigid_regions import RigidRegions
from softprint.fem_truth.statics.constrained import ConstrainedProblem
from softprint.runtime.body.rotations import rotation_dofs, rotation_exponential
from softprint.runtime.colliders import KeyframedPath, RigidPose, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics import (
    DynamicsSettings,
    HandleSpring,
    KinematicHandle,
    NewtonSettings,
    PlacedCollider,
)
from softprint.runtime.rigid.free_collider import free_collider
from softprint.runtime.rigid.twist import generators

both = pytest.mark.parametrize("dim", [2, 3])
CONTACT = PenaltyContact(1e9, refinement=0)  # at nodes: simple enough to be written out here
STEP = 0.01
TIGHT = DynamicsSettings(STEP, NewtonSettings(50, 1e-10))
GRAVITY = {dim: np.array([0.0] * (dim - 1) + [-9.81]) for dim in (2, 3)}


def turn(dim, size, seed=0):
    return rotation_exponential(size * np.random.default_rng(seed).standard_normal(rotation_dofs(dim)))


@pytest.fixture(params=[2, 3])
def regions(request):
    """Regions of 9, 5 and 1 nodes, one of 3 on a line, and free nodes between them."""
    rest = np.random.default_rng(1).standard_normal((30, request.param))
    rest[15:18] = rest[15] + np.arange(3)[:, None] * rest[16]
    parts = [np.arange(9), np.array([20, 22, 24, 26, 28]), np.array([12]), np.arange(15, 18)]
    return rest, parts, RigidRegions(rest, parts)


def rigid_error(rest, x, parts):
    """The largest change of a distance within a region."""
    apart = lambda v: np.linalg.norm(v[:, None] - v[None], axis=2)  # noqa: E731
    return max(np.abs(apart(rest[nodes]) - apart(x[nodes])).max() for nodes in parts)


def test_the_nearest_rigid_place(regions):
    rest, parts, rigid = regions
    dim, rng = rest.shape[1], np.random.default_rng(2)
    x = rest + 0.1 * rng.standard_normal(rest.shape)
    placed = rigid.place(x)
    assert rigid_error(rest, placed, parts) < 1e-12
    others = np.setdiff1d(np.arange(len(rest)), rigid.nodes)
    np.testing.assert_array_equal(placed[others], x[others])
    # No rigid place nearby is nearer.
    for nodes in parts:
        least = np.square(placed[nodes] - x[nodes]).sum()
        for seed in range(20):
            centre = placed[nodes].mean(axis=0)
            near = (
                (placed[nodes] - centre) @ turn(dim, 1e-3, seed).T + centre + 1e-3 * rng.standard_normal(dim)
            )
            assert np.square(near - x[nodes]).sum() >= least - 1e-12
    # A rigid motion of all carries the places along.
    R, t = turn(dim, 1.0), rng.standard_normal(dim)
    np.testing.assert_allclose(rigid.place(x @ R.T + t), placed @ R.T + t, atol=1e-12)
    # Where it is rigid already, nothing changes.
    np.testing.assert_allclose(rigid.place(placed), placed, atol=1e-13)


def test_first_and_second_order_of_motions(regions):
    """Along steps of `moved`, T and K are the derivatives of the work of constant forces."""
    rest, parts, rigid = regions
    dim, rng = rest.shape[1], np.random.default_rng(3)
    x = rigid.place(rest @ turn(dim, 0.8).T + 0.05 * rng.standard_normal(rest.shape))
    forces = rng.standard_normal(rest.shape)
    tangent = rigid.tangent(x, forces)
    spin = rotation_dofs(dim)
    assert tangent.modes.shape[1] == 2 * (dim + spin) + dim + (dim + (1 if dim == 2 else 2))
    identity = (tangent.modes.T @ tangent.modes).toarray()
    np.testing.assert_allclose(identity, np.eye(len(identity)), atol=1e-13)
    for _ in range(5):
        c = rng.standard_normal(len(identity))
        step = np.zeros_like(x)
        step[rigid.nodes] = tangent.displacement(c)

        def work(length, step=step):
            moved = rigid.moved(x, length * step)
            assert rigid_error(rest, moved, parts) < 1e-12
            return float(np.vdot(forces, moved - x))

        h = 1e-3
        slope = tangent.coordinates(forces) @ c
        assert (work(h) - work(-h)) / (2 * h) == pytest.approx(slope, abs=1e-4)  # h^2 and |c| of about 4
        assert (work(h) + work(-h)) / h**2 == pytest.approx(c @ tangent.stiffness @ c, abs=1e-4)
    convex = rigid.tangent(x, forces, convex=True).stiffness
    assert np.linalg.eigvalsh(convex).min() > -1e-12


def dense_tangent(null_space, n, dim, basis, rigid):
    """Columns that span the displacements of first order, without the projector."""
    free = np.setdiff1d(np.flatnonzero(null_space.free), rigid.nodes)
    columns = np.zeros((n * dim, len(free) * dim + rigid.modes.shape[1]))
    flat = (free[:, None] * dim + np.arange(dim)).ravel()
    columns[flat, np.arange(len(flat))] = 1.0
    at = (rigid.nodes[:, None] * dim + np.arange(dim)).ravel()
    columns[at, len(flat) :] = rigid.modes.toarray()
    constraint = np.kron(basis.T, np.eye(dim)) @ columns
    _, values, rows = np.linalg.svd(constraint)
    return columns @ rows[(values > 1e-10).sum() :].T


@pytest.mark.parametrize("constrained", [False, True], ids=["regions alone", "with held points"])
@both
def test_projector_and_conjugate_gradients_against_dense_algebra(block, dim, constrained):
    body = block(dim)
    n, rng = body.n_nodes, np.random.default_rng(4)
    order = rng.permutation(n)
    regions = RigidRegions(body.mesh.points, [order[:6], order[6:13]])
    x = regions.place(body.mesh.points @ turn(dim, 0.5).T + 2e-4 * rng.standard_normal((n, dim)))
    basis = rng.standard_normal((n, 3)) if constrained else np.zeros((n, 0))
    fixed = np.concatenate([regions.nodes, order[-4:]])
    hessian = FullSpaceElasticity(body).hessian(x)
    weights = rng.standard_normal(n) / n
    hessian.add_low_rank(weights, 40.0)
    forces = rng.standard_normal((n, dim))
    rigid = regions.tangent(x, 1e-2 * forces)
    null_space = NullSpace(basis, fixed).with_rigid(rigid)
    span = dense_tangent(null_space, n, dim, basis, rigid)
    expected = span @ (span.T @ forces.ravel())
    gradient = null_space.project(forces)
    np.testing.assert_allclose(gradient.ravel(), expected, atol=1e-11)
    matrix = hessian.sparse().toarray() + 40.0 * np.kron(np.outer(weights, weights), np.eye(dim))
    spread = np.zeros((n * dim, rigid.modes.shape[1]))
    spread[(rigid.nodes[:, None] * dim + np.arange(dim)).ravel()] = rigid.modes.toarray()
    matrix += spread @ rigid.stiffness @ spread.T
    small = span.T @ matrix @ span
    assert np.linalg.eigvalsh(small).min() > 0.0  # otherwise there is no minimum to compare with
    exact = (span @ np.linalg.solve(small, -span.T @ forces.ravel())).reshape(n, dim)
    found = projected_cg(hessian, gradient, null_space, 1e-10, 2000)
    assert not found.negative_curvature
    # The tolerance of the residual times the condition number of the block, about 1e4.
    np.testing.assert_allclose(found.step, exact, atol=1e-6 * np.abs(exact).max())
    assert found.iterations < 300


@both
@pytest.mark.parametrize("led", [False, True], ids=["a spring", "and a kinematic point"])
def test_a_free_frame_settles_as_the_truth_does(block, dim, led):
    """Pulled by springs, a frame is rigid, and the body is in the equilibrium of the truth at its state."""
    body = block(dim)
    target = RigidPose(turn(dim, 0.3), body.handles.frames[0].pivot + 0.004)
    pull = HandleSpring("base", 200.0, KeyframedPath.constant(target), rotation_stiffness=0.5)
    held = [KinematicHandle(0, KeyframedPath([0.0], [np.full(dim, 0.006)]))] if led else []
    simulator = FullSpaceSimulator(
        body, contact=CONTACT, gravity=GRAVITY[dim], springs=[pull], kinematic=held, settings=TIGHT
    )
    result = simulator.settle()
    assert result.converged, result.reason
    x, rest = result.state.x, body.mesh.points
    assert rigid_error(rest, x, [frame.nodes for frame in body.handles.frames]) < 1e-12
    rows = body.project(x)
    problem = ConstrainedProblem(FullSpaceElasticity(body), GRAVITY[dim], CONTACT, body)
    # Both are solved to 1e-7 of their forces or better.
    assert np.abs(problem.internal_equilibrium(rows).x - x).max() < 1e-5 * np.abs(x - rest).max()
    if led:
        np.testing.assert_allclose(rows[0] - body.rest_rows[0], 0.006, atol=1e-12)


@both
@pytest.mark.parametrize("free", [False, True], ids=["led", "free"])
def test_steps_with_a_frame_that_moves_freely(block, dim, free):
    """The momentum of the body changes by its weight and by what it presses with, while its frame turns and stays
    rigid."""
    body = block(dim)
    mass = body.node_mass.sum()
    sphere, fall = Sphere(0.015, dim), np.append(np.zeros(dim - 1), -0.3)
    start = np.array([0.02] + [0.0] * (dim - 2) + [0.062])
    if free:
        own = free_collider(sphere, RigidPose(np.eye(dim), start), mass=0.1, velocity=fall)
        placed = PlacedCollider("ball", sphere, free=own)
    else:
        placed = PlacedCollider("ball", sphere, KeyframedPath([0.0, 1.0], [start, start + fall]))
    simulator = FullSpaceSimulator(body, [placed], contact=CONTACT, gravity=GRAVITY[dim], settings=TIGHT)
    state = simulator.rest_state()
    spin = rotation_dofs(dim)
    about = 2.0 * np.random.default_rng(5).standard_normal(spin)
    arms = body.mesh.points - body.mesh.points.mean(axis=0)
    velocity = np.einsum("kij,nj,k->ni", generators(dim), arms, about)
    state = replace(state, velocity=velocity)
    pressed = 0.0
    for _ in range(12):
        result = simulator.step(state)
        assert result.converged, result.reason
        before, after = (body.node_mass @ s.velocity for s in (state, result.state))
        gained = (after - before) / STEP - mass * GRAVITY[dim]
        contact = result.contacts["ball"].force
        # The residual of a step is 1e-10 of its forces.
        np.testing.assert_allclose(gained, -contact, atol=1e-7 * mass * 9.81)
        state, pressed = result.state, max(pressed, float(np.linalg.norm(contact)))
        assert rigid_error(body.mesh.points, state.x, [f.nodes for f in body.handles.frames]) < 1e-12
    assert pressed > 1.0  # N
