"""Friction in series with the compliance of the surface: the minimum, its derivatives, and its two limits."""

from dataclasses import replace

import numpy as np
import pytest

from softprint.runtime.colliders import RigidPose
from softprint.runtime.contact import CoulombFriction
from softprint.runtime.contact.condensed.compliant_friction import CompliantPoints, settle
from softprint.runtime.contact.friction import LaggedContact
from softprint.runtime.mechanics.compliance.surface_compliance_kernels import NodalCompliance

K, NODES, TIME_STEP = 5, 4, 0.01
FORCE = 2.0  # N, on each point
# eps = slip_velocity h is 0.1 mm.
LAW = CoulombFriction(0.4, slip_velocity=0.01)


@pytest.fixture(params=[2, 3], ids=["2d", "3d"])
def points(request):
    """Points between nodes with a compliance of 1e-3 m/N among them, of single precision; their lagged contact; the
    compliance as it is given."""
    dim, rng = request.param, np.random.default_rng(request.param)
    normal = rng.standard_normal((K, dim))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    root = rng.standard_normal((NODES * dim, NODES * dim))
    among_nodes = (1e-3 * (root @ root.T) / (NODES * dim)).astype(np.float32)
    corners = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [1, 1]])
    shares = np.column_stack([share := rng.uniform(0.2, 0.8, K), 1.0 - share])
    shares[-1] = 1.0, 0.0  # a point that is a node
    given = NodalCompliance(among_nodes, corners, shares)
    carrier = np.eye(dim) + 0.2 * rng.standard_normal((K, dim, dim))
    pose = RigidPose.identity(dim)
    lagged = LaggedContact(np.arange(K), np.full(K, FORCE), normal, np.zeros((K, dim)), pose)
    return CompliantPoints.of(given, dim), carrier, lagged, rng, given


def settled(points, y, stiffer=1.0, start=None):
    compliance, carrier, lagged, *_ = points
    compliance = replace(compliance, stiffness=stiffer * compliance.stiffness)
    return settle(lambda x: LAW.terms(x, lagged, TIME_STEP), y, carrier, compliance, start)


def slipped(points, length):
    _, carrier, _, rng, _ = points
    return length * rng.standard_normal(carrier.shape[:2])


@pytest.mark.parametrize("length", [1e-5, 1e-4, 1e-3, 1e-1], ids="{} m".format)
def test_no_other_displacements_have_less_energy(points, length):
    y = slipped(points, length)
    compliance, carrier, lagged, rng, _ = points
    found = settled(points, y)
    assert found.converged
    for _ in range(20):
        u = found.displacement + 1e-7 * rng.standard_normal(len(found.displacement))
        x = y + (carrier @ compliance.displacement(u)[..., None])[..., 0]
        energy = LAW.terms(x, lagged, TIME_STEP).energy + 0.5 * u @ compliance.stiffness @ u
        assert energy > found.energy


@pytest.mark.parametrize("length", [1e-5, 1e-4, 1e-3], ids="{} m".format)
def test_points_are_displaced_by_the_friction_forces_on_their_nodes(points, length):
    """As the compliance among the points says that is given; and the forces are tangential."""
    y = slipped(points, length)
    _, carrier, lagged, _, given = points
    found, dim = settled(points, y), y.shape[1]
    on_nodes = np.zeros((NODES, dim))
    np.add.at(on_nodes, given.corners, given.shares[..., None] * found.rest_forces[:, None])
    at_nodes = (given.among_nodes @ on_nodes.ravel()).reshape(NODES, dim)
    expected = (given.shares[..., None] * at_nodes[given.corners]).sum(axis=1)
    # The compliance is regularised by 1e-5 of its mean diagonal.
    size = np.abs(expected).max()
    np.testing.assert_allclose(found.rest_displacement, expected, atol=1e-4 * size)
    world = np.linalg.solve(carrier.swapaxes(1, 2), found.rest_forces[..., None])[..., 0]
    normal = (world * lagged.normal).sum(axis=1)
    np.testing.assert_allclose(normal, 0.0, atol=1e-12 * LAW.coefficient * FORCE)


@pytest.mark.parametrize("size", [0.9, 1e6])
def test_the_start_changes_the_cost_alone(points, size):
    """Near, or far beyond what friction can be, where zero is the better start."""
    y = slipped(points, 1e-3)
    found = settled(points, y)
    again = settled(points, y, start=size * found.displacement)
    assert again.converged
    # The energy is convex, and the residual at most 1e-9.
    np.testing.assert_allclose(
        again.displacement, found.displacement, atol=1e-6 * np.abs(found.displacement).max()
    )


@pytest.mark.parametrize("length", [1e-4, 1e-3], ids="{} m".format)
def test_derivatives(points, length):
    """With carriers that change with the rows, of which there are two."""
    y = slipped(points, length)
    compliance, carrier, lagged, rng, _ = points
    dim = y.shape[1]
    carried = rng.standard_normal((K, dim, dim, 2 * dim))
    fixed = rng.standard_normal((K, dim, 2 * dim))

    def at(rows):
        A = carrier + carried @ rows.ravel()
        found = settle(lambda x: LAW.terms(x, lagged, TIME_STEP), y + fixed @ rows.ravel(), A, compliance)
        more = np.einsum("kabr,kb->kar", carried, found.rest_displacement)
        return found.energy, *found.through((fixed + more).reshape(K * dim, -1), carried)

    _, gradient, hessian = at(np.zeros((2, dim)))
    for _ in range(3):
        way, h = rng.standard_normal((2, dim)), 1e-8
        ahead, behind = at(h * way), at(-h * way)
        # Energies of 1e-4 J and forces of 1 N, right to 1e-9 of themselves, over features of 1e-4 m.
        assert (ahead[0] - behind[0]) / (2 * h) == pytest.approx(np.vdot(gradient, way), rel=1e-5)
        change = (ahead[1] - behind[1]).ravel() / (2 * h)
        np.testing.assert_allclose(hessian @ way.ravel(), change, atol=1e-4 * np.abs(change).max())


def test_what_sticks_is_a_spring_in_series(points):
    """Far below eps friction is linear, with 2 mu N / eps along the tangents."""
    y = slipped(points, 1e-9)
    compliance, carrier, lagged, *_ = points
    stiffness = 2.0 * LAW.coefficient * FORCE / (LAW.slip_velocity * TIME_STEP)
    dim = y.shape[1]
    P = np.eye(dim) - lagged.normal[:, :, None] * lagged.normal[:, None, :]
    # x = y + A N u and u = -G N^T A^T k P x.
    N = np.stack([compliance.displacement(e) for e in np.eye(NODES * dim)], axis=-1)
    T = (carrier @ N).reshape(K * dim, -1)
    H = np.zeros((K, dim, K, dim))
    H[np.arange(K), :, np.arange(K)] = stiffness * P
    H = H.reshape(K * dim, K * dim)
    u = -np.linalg.solve(compliance.stiffness + T.T @ H @ T, T.T @ H @ y.ravel())
    # Friction falls off from linear by |slip| / (2 eps), a few parts in a million.
    np.testing.assert_allclose(settled(points, y).displacement, u, rtol=1e-3, atol=1e-4 * np.abs(u).max())


def test_a_surface_that_does_not_give_way_feels_friction_itself(points):
    y = slipped(points, 1e-4)
    rigid = LAW.terms(y, points[2], TIME_STEP)
    found = settled(points, y, stiffer=1e9)
    # Displacements of 1e-12 m, of slips of 1e-4 m.
    np.testing.assert_allclose(found.terms.gradient, rigid.gradient, atol=1e-6 * FORCE)
    assert found.energy == pytest.approx(rigid.energy, rel=1e-6)


def test_what_slips_gives_coulomb_s_force(points):
    y = slipped(points, 1.0)  # m, far beyond what a millimetre a newton gives way
    force = np.linalg.norm(settled(points, y).terms.gradient, axis=1)
    np.testing.assert_allclose(force, LAW.coefficient * FORCE, rtol=1e-9)
