"""An independent library as a witness: the same energies assembled, and the same large deformation solved, in
scikit-fem.

Stresses and their derivatives are written out by hand here, in the tensors of the textbook (Bonet and Wood
1997, sec. 6.4; Smith et al. 2018), so that neither UFL's differentiation nor FFCx's code has a part in them:

    neo-Hookean         P = mu (F - F^-T) + lam log J F^-T
    stable neo-Hookean  P = mu (1 - 1/(I_C + 1)) F + (lam (J - 1) - 3/4 mu) J F^-T
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

pytest.importorskip("skfem")
pytest.importorskip("dolfinx")

import skfem
from skfem.helpers import ddot, det, grad, identity, inv, mul, transpose

from fem_truth.dynamics import FullSpaceSimulator
from fem_truth.full_space_elasticity import FullSpaceElasticity
from runtime.contact import PenaltyContact
from runtime.dynamics import KinematicHandle, NewtonSettings

ROUND_OFF = 1e-12  # sums of some hundred float64 products in another order
DENSITY = 1000.0  # kg/m^dim, of the bodies of `block`


def neo_hookean(F, mu, lam):
    """P, and dP as a function of dF."""
    F_T, log_J = transpose(inv(F)), np.log(det(F))

    def change(dF):
        across = mul(mul(F_T, transpose(dF)), F_T)  # -d(F^-T)
        return mu * dF + (mu - lam * log_J) * across + lam * ddot(F_T, dF) * F_T

    return mu * (F - F_T) + lam * log_J * F_T, change


def stable_neo_hookean(F, mu, lam):
    """P, and dP as a function of dF; E and nu are exact at small strain with mu and lam remapped."""
    mu, lam = 4 / 3 * mu, lam + 5 / 6 * mu
    F_T, J = transpose(inv(F)), det(F)
    trace = ddot(F, F) + (3 - len(F)) + 1.0  # I_C + 1, the third stretch of plane strain being 1
    pressure = lam * (J - 1.0) - 0.75 * mu

    def change(dF):
        growth = ddot(F_T, dF)  # dJ / J
        across = mul(mul(F_T, transpose(dF)), F_T)
        return (
            mu * (1.0 - 1.0 / trace) * dF
            + 2.0 * mu * ddot(F, dF) / trace**2 * F
            + J * (lam * J * growth * F_T + pressure * (growth * F_T - across))
        )

    return mu * (1.0 - 1.0 / trace) * F + pressure * J * F_T, change


class Witness:
    """A body in scikit-fem: forces (n_nodes, dim) and stiffness over (node, axis) at positions x."""

    def __init__(self, body, law):
        mesh, dim = body.mesh, body.dim
        element = skfem.ElementTriP1() if dim == 2 else skfem.ElementTetP1()
        kind = skfem.MeshTri if dim == 2 else skfem.MeshTet
        self._basis = skfem.Basis(
            kind(mesh.points.T.copy(), mesh.cells.T.copy()), skfem.ElementVector(element), intorder=1
        )
        self._dofs = self._basis.nodal_dofs.T  # (n_nodes, dim)
        young, poisson = body.material.young, body.material.poisson
        moduli = {
            "mu": young / (2 * (1 + poisson)),
            "lam": young * poisson / ((1 + poisson) * (1 - 2 * poisson)),
        }
        self._moduli = {name: values[:, None] for name, values in moduli.items()}
        self._rest = mesh.points

        @skfem.LinearForm
        def forces(v, w):
            return ddot(law(deformation(w), w.mu, w.lam)[0], grad(v))

        @skfem.BilinearForm
        def stiffness(du, v, w):
            return ddot(law(deformation(w), w.mu, w.lam)[1](grad(du)), grad(v))

        def deformation(w):
            return grad(w.u) + identity(grad(w.u))

        self._forces, self._stiffness = forces, stiffness

    def forces(self, x):
        return self._assembled(self._forces, x)[self._dofs]

    def stiffness(self, x):
        order = self._dofs.ravel()
        return self._assembled(self._stiffness, x)[order][:, order]

    def _assembled(self, form, x):
        u = np.empty(self._basis.N)
        u[self._dofs] = x - self._rest
        return form.assemble(self._basis, u=self._basis.interpolate(u), **self._moduli)

    def weight(self, gravity):
        """(n_nodes, dim) of a body force [N]."""

        @skfem.LinearForm
        def work(v, w):
            return sum(DENSITY * g * v[axis] for axis, g in enumerate(gravity))

        return work.assemble(self._basis)[self._dofs]


both = pytest.mark.parametrize("dim", [2, 3])
each_law = pytest.mark.parametrize("law", [stable_neo_hookean, neo_hookean])


@both
@each_law
def test_forces_and_stiffness_of_a_random_deformation(block, dim, law):
    body = block(dim, law.__name__)
    rng = np.random.default_rng(3)
    # A large homogeneous deformation and a random one on top: strains of 40 %, no cell inverted.
    stretch = np.eye(dim) + 0.3 * rng.uniform(-1, 1, (dim, dim))
    x = body.mesh.points @ stretch.T + 1e-3 * rng.standard_normal(body.mesh.points.shape)
    ours, witness = FullSpaceElasticity(body), Witness(body, law)
    assert ours.min_det_F(x) > 0.1
    assert np.abs(ours.deformation_gradients(x) - np.eye(dim)).max() > 0.35
    forces, stiffness = witness.forces(x), witness.stiffness(x)
    np.testing.assert_allclose(ours.gradient(x), forces, atol=ROUND_OFF * np.abs(forces).max())
    difference = ours.hessian(x).sparse() - stiffness
    assert np.abs(difference).max() < ROUND_OFF * np.abs(stiffness).max()


@both
@each_law
def test_a_clamped_block_under_a_large_body_force(block, dim, law):
    body = block(dim, law.__name__)
    gravity = np.array([100.0, 0.0, -20.0] if dim == 3 else [100.0, -20.0])
    clamped = body.handles.frame_nodes
    witness = Witness(body, law)
    x = solved(witness, body, witness.weight(gravity), clamped)

    base = [KinematicHandle("base")]
    simulator = FullSpaceSimulator(body, contact=PenaltyContact(1e9), gravity=gravity, kinematic=base)
    ours = simulator.settle(newton=NewtonSettings(max_iterations=100, tolerance=1e-10))
    assert ours.converged, ours.reason
    largest = np.abs(x - body.mesh.points).max()
    assert largest > 0.01  # a third of the free height: no small displacement
    # Both solvers stop at 1e-10 of the forces; the softest mode of the block gives them up to 1e2 in displacement.
    np.testing.assert_allclose(ours.state.x, x, atol=1e-8 * largest)


def solved(witness, body, load, clamped):
    """Newton's method in ten load steps, each to 1e-10 of its load."""
    n, dim = body.mesh.points.shape
    free = (np.setdiff1d(np.arange(n), clamped)[:, None] * dim + np.arange(dim)).ravel()
    x = body.mesh.points.copy()
    for share in np.linspace(0.1, 1.0, 10):
        for _ in range(20):
            residual = (share * load - witness.forces(x)).ravel()[free]
            if np.linalg.norm(residual) < 1e-10 * np.linalg.norm(share * load):
                break
            x.ravel()[free] += spsolve(witness.stiffness(x)[free][:, free], residual)
        else:
            raise AssertionError(f"the witness did not converge at {share:.0%} of the load")
    return x
