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


@dataclass(frozen=True, eq=False)
class LoadPress:
    """The load problem of a state, solved. index: (m,) the loads near the collider; state: of their points.

    As arrays of the m loads, in collider space where they have a frame: pressure p [N], left e [m], position z,
    slope and curvature of the signed distance, F, given = sum_j G_ij nu_j p_j [m] in rest coordinates.
    """

    index: IntArray
    state: PointStates
    problem: LoadProblem
    solution: LoadSolution

    @property
    def touching(self) -> IntArray:
        """Which of the loads bear pressure."""
        return np.flatnonzero(self.left > 0.0)

    @property
    def pressure(self) -> Array:
        return np.asarray(self.solution.pressure.numpy())

    @property
    def left(self) -> Array:
        return np.asarray(self.solution.left.numpy())

    @property
    def given(self) -> Array:
        return np.asarray(self.solution.given.numpy())

    @property
    def position(self) -> Array:
        return np.asarray(self.state.z.numpy())

    @property
    def slope(self) -> Array:
        return np.asarray(self.state.slope.numpy())

    @property
    def curvature(self) -> Array:
        assert self.state.curvature is not None, "PointStates.at takes it"
        return np.asarray(self.state.curvature.numpy())

    @property
    def F(self) -> Array:
        return np.asarray(self.state.F.numpy())

    @property
    def stiffening(self) -> Array:
        """S = dp/de = 2 a k max(0, e) (m,) [N/m]."""
        return np.asarray((2.0 * self.problem.stiffness * self.solution.left.clamp(min=0.0)).numpy())

    @property
    def energy(self) -> float:
        """sum_j (a_j k / 3) max(0, e_j)^3 + 1/2 p . A p [J]; A p = -s - e."""
        left, pressure = self.left, self.pressure
        dent = -self.state.sdf.numpy() - left
        return float(pressure @ (np.maximum(left, 0.0) / 3.0 + 0.5 * dent))

    @cached_property
    def coupling(self) -> Array:
        """A (m, m) [m/N]."""
        return np.asarray(self.problem.coupling.numpy())

    def lever(self, at: IntArray) -> Array:
        """nu_j . G_ji (k, k*dim) [m/N] between the k loads `at`: what a force on one gives way at another."""
        nu = self.problem.normal.numpy()[at]
        m, dim = nu.shape
        return np.matmul(nu[:, None, :], self.compliance(at).reshape(m, dim, -1))[:, 0]

    def compliance(self, at: IntArray) -> Array:
        """G (k*dim, k*dim) [m/N] between the k loads `at`."""
        G = self.problem.compliance.numpy()
        dim = G.shape[1]
        return np.asarray(G[at][:, :, at].reshape(len(at) * dim, -1))


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
        # Forces are spread over the areas of loads, displacements taken at their nodes: between loads G is symmetric
        # only up to that, and made so, for only then do forces derive from an energy.
        among = compliance.operator[:, :, compliance.nodes]
        pairs = 0.5 * (among + among.transpose(2, 3, 0, 1)).transpose(0, 2, 1, 3)
        self._among_loads = np.ascontiguousarray(
            pairs
        )  # [i, j]: (dim, dim), so that few of them are gathered fast
        self._last: tuple[Array, RigidPose, ContactLoads | None] | None = None
        self._last_press: tuple[Array, RigidPose, LoadPress | None] | None = None

    def measure(self, rows: Array, pose: RigidPose) -> ContactLoads | None:
        """The loads at handle rows (n_rows, dim), or None where no surface sample penetrates."""
        if self._last is not None:
            last_rows, last_pose, loads = self._last
            if last_pose is pose and np.array_equal(last_rows, rows):
                return loads
        loads = self._measure(rows, pose)
        self._last = (rows.copy(), pose, loads)
        return loads

    def press(self, rows: Array, pose: RigidPose) -> LoadPress | None:
        """The load problem and its solution alone, or None where no load is near enough to be pressed."""
        if self._last_press is not None:
            last_rows, last_pose, press = self._last_press
            if last_pose is pose and np.array_equal(last_rows, rows):
                return press
        press = self._press(rows, pose)
        self._last_press = (rows.copy(), pose, press)
        return press

    def collider_rows(self, rows: Array, pose: RigidPose) -> Array:
        """T^-1 q (n_rows, dim)."""
        return self._patch_probe.collider_rows(rows, pose)

    def _press(self, rows: Array, pose: RigidPose) -> LoadPress | None:
        collider, local_rows = self.collider, self.collider_rows(rows, pose)
        z = self._basis @ local_rows
        near = ((z > collider.lower - self.band) & (z < collider.upper + self.band)).all(axis=1)
        index = np.flatnonzero(near)
        index = index[collider.sdf(z[index]) < self.band] if index.size else index
        if index.size == 0:
            return None
        state = PointStates.at(self._points.take(torch.from_numpy(index)), local_rows, z[index], collider)
        among = self._among_loads[np.ix_(index, index)].transpose(0, 2, 1, 3).astype(np.float64, order="C")
        problem = LoadProblem(
            torch.from_numpy(among),
            self._stiffness * self._areas[index],
            state.sdf,
            torch.einsum("mbj,mb->mj", state.F, state.slope),
        )
        return LoadPress(index, state, problem, problem.solve())

    def _measure(self, rows: Array, pose: RigidPose) -> ContactLoads | None:
        patch = self._patch_probe.measure(rows, pose)
        press = None if patch is None else self.press(rows, pose)
        if patch is None or press is None:
            return None
        rotation = torch.from_numpy(pose.rotation.copy())
        return ContactLoads(
            patch,
            press.index,
            press.state,
            press.problem,
            press.solution,
            self._areas[press.index],
            self.band,
            rotation,
        )
