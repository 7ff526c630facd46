"""The forces of a contact as far as mechanics alone gives them: the state that a load model corrects.

For a reduced state and a pose: the contact patch, the loads near the collider, and the solution of the small
problem of `load_solve.py` for them. The last answer is kept, because dynamics asks for the same state at
several sets of points.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from runtime.arrays import Array, IntArray
from runtime.body.body import ReducedBody
from runtime.colliders.collider import Collider
from runtime.colliders.pose import RigidPose
from runtime.corrections.compliance import Compliance
from runtime.corrections.contact_patch import ContactProbe, Patch
from runtime.corrections.load_solve import LoadProblem, LoadSolution
from runtime.corrections.points import PointStates, PointTensors


@dataclass(frozen=True, eq=False)
class LoadSlopes:
    """Derivatives with respect to the R = n_rows * dim world rows, at the m active loads: of the
    weight (m, R), the load (m, dim, R), what is left (m, R), and of the displacement v = F given in
    collider space (m, dim, R)."""

    weight: Tensor
    load: Tensor
    left: Tensor
    moved: Tensor


@dataclass(frozen=True, eq=False)
class ContactLoads:
    """index: (m,) active loads; state: of their points; weight: (m,) [m^(dim-1)], area that fades out with
    distance; solution: of the load problem. All float64."""

    patch: Patch
    index: IntArray
    state: PointStates
    problem: LoadProblem
    solution: LoadSolution
    areas: Tensor
    band: float
    rotation: Tensor

    @cached_property
    def moved(self) -> Tensor:
        """v (m, dim) [m]: displacement of the loads by the solution, in collider space."""
        return torch.einsum("mij,mj->mi", self.state.F, self.solution.given)

    @cached_property
    def _nearness(self) -> Tensor:
        return (1.0 - self.state.sdf / self.band).clamp(min=0.0)

    @property
    def weight(self) -> Tensor:
        """(m,) area times x^2 / (1 + x^2), x = 1 - s / band: C1, zero at the band's edge."""
        x = self._nearness
        return self.areas * x**2 / (1.0 + x**2)

    @cached_property
    def slopes(self) -> LoadSlopes:
        """By the chain rule; see `LoadProblem.differentiate`."""
        state, points = self.state, self.state.points
        m = len(self.index)
        # d(collider rows) = d(world rows) R, so that dz_b = U_r R_cb and dF_bj = dU_rj R_cb.
        turned_slope = state.slope @ self.rotation.T
        sdf_slope = (points.basis[:, :, None] * turned_slope[:, None, :]).reshape(m, -1)
        bent = torch.einsum("cb,mbk,mkj->mjc", self.rotation, state.curvature, state.F)
        normal_slope = torch.einsum("mrj,mc->mjrc", points.basis_gradient, turned_slope)
        normal_slope = normal_slope + bent[:, :, None, :] * points.basis[:, None, :, None]
        left, _, load, given = self.problem.differentiate(
            self.solution, sdf_slope, normal_slope.reshape(m, -1, sdf_slope.shape[1])
        )
        turned_given = torch.einsum("mrj,mj->mr", points.basis_gradient, self.solution.given)
        moved = torch.einsum("cb,mr->mbrc", self.rotation, turned_given).reshape(given.shape)
        moved = moved + state.F @ given
        x = self._nearness
        weight = (-2.0 / self.band * self.areas * x / (1.0 + x**2) ** 2)[:, None] * sdf_slope
        return LoadSlopes(weight, load, left, moved)


class LoadProbe:
    """Measures `ContactLoads` for one body and one collider.

    stiffness: of the penalty contact [N/m^4]; band: [m], loads up to this far outside the collider take part.
    """

    def __init__(
        self, body: ReducedBody, collider: Collider, compliance: Compliance, stiffness: float, band: float
    ) -> None:
        self.collider, self.compliance, self.band = collider, compliance, band
        self._patch_probe = ContactProbe(body, collider)
        points = body.node_points(compliance.nodes)
        self._basis = points.basis
        self._points = PointTensors.of(points, torch.zeros((), dtype=torch.float64))
        self._areas = torch.from_numpy(compliance.areas)
        self._stiffness = stiffness
        self._among_loads = np.ascontiguousarray(compliance.operator[:, :, compliance.nodes])
        self._last: tuple[Array, RigidPose, ContactLoads | None] | None = None

    def measure(self, rows: Array, pose: RigidPose) -> ContactLoads | None:
        """The loads at handle rows (n_rows, dim), or None where no surface sample penetrates."""
        if self._last is not None:
            last_rows, last_pose, loads = self._last
            if last_pose is pose and np.array_equal(last_rows, rows):
                return loads
        loads = self._measure(rows, pose)
        self._last = (rows.copy(), pose, loads)
        return loads

    def collider_rows(self, rows: Array, pose: RigidPose) -> Array:
        """T^-1 q (n_rows, dim)."""
        return self._patch_probe.collider_rows(rows, pose)

    def _measure(self, rows: Array, pose: RigidPose) -> ContactLoads | None:
        patch = self._patch_probe.measure(rows, pose)
        if patch is None:
            return None
        collider, local_rows = self.collider, self.collider_rows(rows, pose)
        z = self._basis @ local_rows
        near = ((z > collider.lower - self.band) & (z < collider.upper + self.band)).all(axis=1)
        index = np.flatnonzero(near)
        index = index[collider.sdf(z[index]) < self.band] if index.size else index
        if index.size == 0:
            return None
        state = PointStates.at(self._points.take(torch.from_numpy(index)), local_rows, z[index], collider)
        dim = z.shape[1]
        among = self._among_loads[index][:, :, index].astype(np.float64)
        problem = LoadProblem(
            torch.from_numpy(among).reshape(len(index), dim, len(index), dim),
            self._stiffness * self._areas[index],
            state.sdf,
            torch.einsum("mbj,mb->mj", state.F, state.slope),
        )
        rotation = torch.from_numpy(pose.rotation.copy())
        return ContactLoads(
            patch, index, state, problem, problem.solve(), self._areas[index], self.band, rotation
        )
