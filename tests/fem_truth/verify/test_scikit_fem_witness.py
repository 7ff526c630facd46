"""An independent library as a reference: the same energies assembled, and the same large deformation solved, in
scikit-fem (see `fem_truth.verify.problems.witness`)."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("skfem")
pytest.importorskip("dolfinx")

from softprint.fem_truth.dynamics.full_space_simulator import FullSpaceSimulator
from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.verify.problems.witness import LAWS, Witness
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics import KinematicHandle, NewtonSettings

ROUND_OFF = 1e-12  # sums of some hundred float64 products in another order
DENSITY = 1000.0  # kg/m^dim, of the bodies of `block`


def witness_of(body, law):
    return Witness(body.mesh, body.material.young, body.material.poisson, law)


both = pytest.mark.parametrize("dim", [2, 3])
each_law = pytest.mark.parametrize("law", LAWS)


@both
@each_law
def test_forces_and_stiffness_of_a_random_deformation(block, dim, law):
    body = block(dim, law)
    rng = np.random.default_rng(3)
    # A large homogeneous deformation plus a random one: strains of 40 %, no inverted cell.
    stretch = np.eye(dim) + 0.3 * rng.uniform(-1, 1, (dim, dim))
    x = body.mesh.points @ stretch.T + 1e-3 * rng.standard_normal(body.mesh.points.shape)
    ours, witness = FullSpaceElasticity(body), witness_of(body, law)
    assert ours.min_det_F(x) > 0.1
    assert np.abs(ours.deformation_gradients(x) - np.eye(dim)).max() > 0.35
    forces, stiffness = witness.forces(x), witness.stiffness(x)
    np.testing.assert_allclose(ours.gradient(x), forces, atol=ROUND_OFF * np.abs(forces).max())
    difference = ours.hessian(x).sparse() - stiffness
    assert np.abs(difference).max() < ROUND_OFF * np.abs(stiffness).max()


@both
@each_law
def test_a_clamped_block_under_a_large_body_force(block, dim, law):
    body = block(dim, law)
    gravity = np.array([100.0, 0.0, -20.0] if dim == 3 else [100.0, -20.0])
    clamped = body.handles.frame_nodes
    witness = witness_of(body, law)
    x = witness.solve(witness.weight(DENSITY * gravity), clamped)

    base = [KinematicHandle("base")]
    simulator = FullSpaceSimulator(body, contact=PenaltyContact(1e9), gravity=gravity, kinematic=base)
    ours = simulator.settle(newton=NewtonSettings(max_iterations=100, tolerance=1e-10))
    assert ours.converged, ours.reason
    largest = np.abs(x - body.mesh.points).max()
    assert largest > 0.01  # a third of the free height: no small displacement
    # Both solvers stop at 1e-10 of the forces; the softest mode of the block amplifies this to up to 1e2 times in
    # displacement.
    np.testing.assert_allclose(ours.state.x, x, atol=1e-8 * largest)
