"""The energy of contact with the detail condensed out: what dynamics minimises in place of penalty on rigid detail.

The contact displacement u of a state is an equilibrium, so the energy of body and contact over all such u is a
function of the reduced state alone. With the body's compliance G (`compliance.py`) and the load problem of
`load_solve.py` it is, by Clapeyron's theorem,

    W(q) = sum_j (a_j k / 3) max(0, e_j)^3 + 1/2 p^T A p,        e + A p = -s,    p_j = a_j k max(0, e_j)^2,

the penalty energy of the penetration e that is left and the elastic energy of the dent: no cubature of the body's
volume has to resolve a dent, and no derivative of u is needed, for W does not change to first order with p (envelope
theorem). With v_j = sum_i G_ji nu_i p_i (rest coordinates), nu_j = F_j^T g_j, g_j and H_j the world gradient and
Hessian of the signed distance,

    dW      = -sum_j p_j (ds_j + dnu_j . v_j),        ds_j = g_j . dx_j,    dnu_j = F_j^T H_j dx_j + dF_j^T g_j
    d2W     = C^T S (1 + A S)^-1 C - sum_j p_j (d2s_j + d2nu_j . v_j) - sum_ij p_i dnu_i . G_ij dnu_j p_j,

S = dp/de, C_j = ds_j + d(A p)_j at fixed p. The third derivative of the distance in d2nu . v is the rate of H_j along
the displacement u = F v; it is taken by a difference, for a spline's Hessian is linear within a cell of its grid.
"""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array
from runtime.colliders.pose import RigidPose
from runtime.corrections.contact_loads import LoadPress, LoadProbe
from runtime.corrections.correction import PressedLoads

# Share of a displacement over which the Hessian of the distance is differenced.
_SHORT = 1e-3


class ContactPotential:
    """W of one body and one collider, as a function of handle rows and pose."""

    def __init__(self, probe: LoadProbe, basis: Array, basis_gradient: Array) -> None:
        """basis (n_loads, n_rows) and basis_gradient (n_loads, n_rows, dim): at the loads of the probe."""
        self._probe, self._basis, self._gradient = probe, basis, basis_gradient

    def energy(self, rows: Array, pose: RigidPose, turn: Array) -> float:
        """W [J]."""
        press = self._probe.press(rows, pose)
        return 0.0 if press is None else press.energy

    def pressed(self, rows: Array, pose: RigidPose, turn: Array) -> PressedLoads:
        """The loads that push on the collider, for resultants."""
        press = self._probe.press(rows, pose)
        if press is None:
            dim = rows.shape[1]
            return PressedLoads(np.empty((0, dim)), np.empty((0, dim)), np.empty(0), np.empty(0))
        at = press.touching
        u = np.einsum("mbj,mj->mb", press.F[at], press.given[at])
        # The normal where the dent has taken the load, to first order: with it the forces are exactly those of W.
        normal = press.slope[at] + np.einsum("mab,mb->ma", press.curvature[at], u)
        return PressedLoads(
            pose.apply(press.position[at] + u), pose.rotate(normal), press.pressure[at], press.left[at]
        )

    def linearise(self, rows: Array, pose: RigidPose, turn: Array) -> tuple[float, Array, Array | None]:
        """W [J], dW/drows (n_rows, dim) [N] and its Hessian (n_rows*dim, n_rows*dim) [N/m]; no Hessian where
        nothing is pressed."""
        press = self._probe.press(rows, pose)
        if press is None or not press.touching.size:
            return 0.0, np.zeros_like(rows), None
        at = press.touching
        U, dU = self._basis[press.index[at]], self._gradient[press.index[at]]
        p, v = press.pressure[at], press.given[at]
        g = pose.rotate(press.slope[at])
        H = pose.rotate_matrices(press.curvature[at])
        turned = pose.rotation @ press.curvature[at] @ press.F[at]  # H F, from rest coordinates to the world
        bent = np.einsum("mbj,mj->mb", turned, v)
        carried = np.einsum("mrj,mj->mr", dU, v)
        # p (ds + dnu . v) at rows: U (g + H F v) + (dU v) g.
        gradient = -(U.T @ (p[:, None] * (g + bent)) + carried.T @ (p[:, None] * g))

        m, n_rows, dim = dU.shape
        C = (U[:, :, None] * (g + bent)[:, None, :] + carried[:, :, None] * g[:, None, :]).reshape(m, -1)
        # Through the normals of all others: sum_i nu_j . G_ji dnu_i p_i.
        dnu = np.einsum("mrj,mb->mjrb", dU, g) + np.einsum("mbj,mr->mjrb", turned, U)
        pressed = (p[:, None, None, None] * dnu).reshape(m * dim, -1)
        C += press.lever(at) @ pressed
        S = press.stiffening[at]
        A = press.coupling[np.ix_(at, at)]
        hessian = C.T @ (S[:, None] * np.linalg.solve(np.eye(m) + A * S, C))
        hessian -= pressed.T @ (press.compliance(at) @ pressed)
        # d2s + d2nu . v = dx^T (H + dH) dx + 2 (dF v)^T H dx, with dx = U and dF v = carried at rows.
        left, right = np.concatenate([U, U, carried]), np.concatenate([U, carried, U])
        bend = p[:, None, None] * H
        bends = np.concatenate([bend + p[:, None, None] * self._along(press, pose), bend, bend])
        blocks = (right[:, :, None, None] * bends[:, None]).reshape(3 * m, -1)
        geometric = (left.T @ blocks).reshape(n_rows, n_rows, dim, dim).transpose(0, 2, 1, 3)
        return press.energy, gradient, hessian - geometric.reshape(n_rows * dim, -1)

    def _along(self, press: LoadPress, pose: RigidPose) -> Array:
        """dH (m, dim, dim): how the Hessian of the distance changes along the displacement, world frame."""
        at = press.touching
        u = np.einsum("mbj,mj->mb", press.F[at], press.given[at])
        moved = self._probe.collider.sdf_derivatives(press.position[at] + _SHORT * u).hessian
        return pose.rotate_matrices((moved - press.curvature[at]) / _SHORT)
