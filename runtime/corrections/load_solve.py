"""Contact pressure from the body's compliance: a small convex problem in place of the full-space solve.

At the m loads near the collider, with signed distance s_j, gradient g_j and compliance G (see
`compliance.py`), the distance after the body has given way is s_j + g_j . v_j to first order. With the
penalty law of the truth, f_j = p_j g_j and p_j = a_j k max(0, e_j)^2 (thesis 5.4), the penetration e_j that
is left satisfies

    e + A p(e) = -s,      A_ij = nu_i . G_ij nu_j,      nu_j = F_j^T g_j.

A is symmetric positive semidefinite and p does not decrease: there is exactly one solution, it depends on the
state continuously, and Newton's method finds it in a few steps. Nothing here is learned; the network corrects
what the linearisation misses.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

log = logging.getLogger(__name__)

# |e + A p + s| below this share of the deepest penetration: far below what float32 networks resolve.
_TOLERANCE = 1e-10
_ITERATIONS = 60


@dataclass(frozen=True, eq=False)
class LoadSolution:
    """left: e (m,) [m], penetration left (negative: a gap); pressure: p (m,) [N]; load: nu_j p_j (m, dim) [N]
    in rest coordinates; given: sum_j G_ij nu_j p_j (m, dim) [m], displacement in rest coordinates."""

    left: Tensor
    pressure: Tensor
    load: Tensor
    given: Tensor


@dataclass(frozen=True, eq=False)
class LoadProblem:
    """The m loads near the collider; all tensors float64.

    compliance: G (m, dim, m, dim) [m/N]; stiffness: a_j k (m,) [N/m^2]; sdf: s (m,) [m]; normal: nu (m, dim).
    """

    compliance: Tensor
    stiffness: Tensor
    sdf: Tensor
    normal: Tensor

    @cached_property
    def coupling(self) -> Tensor:
        """A (m, m) [m/N]."""
        return torch.einsum("ia,iajb,jb->ij", self.normal, self.compliance, self.normal)

    def solve(self) -> LoadSolution:
        """Newton's method with step halving, from the penetration of the rigid collider made small.

        Loads that bear no pressure only follow: the linear systems are of the size of those that do.
        """
        A, k, depth = self.coupling.numpy(), self.stiffness.numpy(), -self.sdf.numpy()
        tolerance = _TOLERANCE * np.abs(depth).max()
        left = np.minimum(depth, 0.1 * max(depth.max(), 0.0))
        pressure = k * np.maximum(left, 0.0) ** 2
        residual = left + A @ pressure - depth
        for _ in range(_ITERATIONS):
            size = np.linalg.norm(residual)
            if size <= tolerance:
                break
            bearing = np.flatnonzero(left > 0.0)
            columns = A[:, bearing] * (2.0 * k[bearing] * left[bearing])
            among = columns[bearing]
            among[np.diag_indices(len(bearing))] += 1.0
            pressed = np.linalg.solve(among, residual[bearing])
            step = residual - columns @ pressed
            length = 1.0
            while True:
                trial = left - length * step
                trial_pressure = k * np.maximum(trial, 0.0) ** 2
                trial_residual = trial + A @ trial_pressure - depth
                if np.linalg.norm(trial_residual) < size or length < 1e-4:
                    break
                length *= 0.5
            left, pressure, residual = trial, trial_pressure, trial_residual
        else:
            log.warning(
                "contact loads not in balance after %d iterations: residual %.1e m", _ITERATIONS, size
            )
        load = self.normal * torch.from_numpy(pressure)[:, None]
        m, dim = load.shape
        given = (self.compliance.reshape(m * dim, m * dim) @ load.reshape(-1)).reshape(m, dim)
        return LoadSolution(torch.from_numpy(left), torch.from_numpy(pressure), load, given)

    def differentiate(
        self, solution: LoadSolution, sdf_slope: Tensor, normal_slope: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Derivatives of left (m, R), pressure (m, R), load (m, dim, R) and given (m, dim, R), from those of
        the distance (m, R) and of nu (m, dim, R), by the implicit function theorem."""
        A, slope = self.coupling, self._slope(solution.left)
        pressed = normal_slope * solution.pressure[:, None, None]
        # d(A p) at fixed p: through the normal at i and through the normals at all j.
        through_j = torch.einsum("ia,iajb,jbr->ir", self.normal, self.compliance, pressed)
        change = torch.einsum("iar,ia->ir", normal_slope, solution.given) + through_j
        left = torch.linalg.solve(torch.eye(len(A), dtype=A.dtype) + A * slope, -sdf_slope - change)
        pressure = slope[:, None] * left
        load = pressed + self.normal[:, :, None] * pressure[:, None, :]
        m, dim, _ = load.shape
        given = (self.compliance.reshape(m * dim, m * dim) @ load.reshape(m * dim, -1)).reshape(load.shape)
        return left, pressure, load, given

    def _slope(self, left: Tensor) -> Tensor:
        return 2.0 * self.stiffness * left.clamp(min=0.0)


def as_float64(array: np.ndarray) -> Tensor:  # type: ignore[type-arg]
    """A float64 tensor."""
    return torch.from_numpy(np.ascontiguousarray(array, dtype=np.float64))
