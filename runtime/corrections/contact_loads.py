"""What a load model is told of a contact: the patch, the loads near the collider, and what mechanics makes of them.

More loads than bear pressure take part, all within a band around the collider, so that what is learned can push where
the linear body is not pushed. The last answer is kept, because the same state is asked for at several sets of points.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from runtime.arrays import Array, IntArray
from runtime.body.body import ReducedBody
from runtime.colliders.collider import Collider, SdfDerivatives
from runtime.colliders.pose import RigidPose
from runtime.corrections.contact_patch import ContactProbe, Patch
from runtime.corrections.load_press import LoadMotion, LoadPress, LoadProbe
from runtime.corrections.points import PointStates, PointTensors
from runtime.corrections.rest_mechanics import RestMechanics


@dataclass(frozen=True, eq=False)
class LoadSlopes:
    """Derivatives with respect to the R = n_rows * dim world rows, at the m loads: of the weight (m, R), the load (m,
    dim, R), what is left (m, R), and of the displacement moved (m, dim, R). point: of z beyond what the basis gives,
    (m, dim, n_rows, dim), or None where there is no more."""

    weight: Tensor
    load: Tensor
    left: Tensor
    moved: Tensor
    point: Tensor | None


@dataclass(frozen=True, eq=False)
class ContactLoads:
    """index: (m,) loads of the body; state: of their points; load: (m, dim) [N] in rest coordinates, moved: (m, dim)
    [m] in collider space and left: (m,) [m], penetration left (negative: a gap), of the contact that mechanics gives.
    patch: None where the subspace alone does not touch. All float64."""

    patch: Patch | None
    index: IntArray
    state: PointStates
    load: Tensor
    moved: Tensor
    left: Tensor
    areas: Tensor
    band: float
    derivatives: LoadDerivatives

    @cached_property
    def _nearness(self) -> Tensor:
        return (1.0 - self.state.sdf / self.band).clamp(min=0.0)

    @property
    def weight(self) -> Tensor:
        """(m,) area times x^2 / (1 + x^2), x = 1 - s / band: C1, zero at the band's edge."""
        x = self._nearness
        return self.areas * x**2 / (1.0 + x**2)

    @property
    def rotation(self) -> Tensor:
        """(dim, dim) of the collider's pose."""
        return torch.from_numpy(self.derivatives.pose.rotation.copy())

    @cached_property
    def slopes(self) -> LoadSlopes:
        """By the chain rule; see `load_press.py`."""
        of, x = self.derivatives, self._nearness
        weight = -2.0 * self.areas * x / (1.0 + x**2) ** 2 / self.band
        distance = torch.einsum("ma,mar->mr", self.state.slope, torch.from_numpy(of.approach))
        return LoadSlopes(
            weight=weight[:, None] * distance,
            load=torch.from_numpy(of.load),
            left=torch.from_numpy(of.left),
            moved=torch.from_numpy(of.moved),
            point=None if of.point is None else torch.from_numpy(of.point),
        )


@dataclass(frozen=True, eq=False)
class LoadDerivatives:
    """What slopes are made of, worked out when they are first asked for. given: v (m, dim) [m]; bearing: (k,) which of
    the m loads bear pressure; lever: G (m*dim, k*dim) [m/N]; displaced: signed distance where the loads have gone."""

    press: LoadPress
    motion: LoadMotion
    F: Array
    given: Array
    bearing: IntArray
    lever: Array
    displaced: SdfDerivatives
    pose: RigidPose
    internal: Array | None

    @cached_property
    def _load(self) -> Array:
        return self.press.load_slope

    @property
    def load(self) -> Array:
        """(m, dim, R)."""
        m, dim = self.given.shape
        slope = np.zeros((m, dim, self._load.shape[2]))
        slope[self.bearing] = self._load
        return slope

    @cached_property
    def _gone(self) -> Array:
        """dy (m, dim, R) = dx + dF v + F dv, world frame."""
        m, dim = self.given.shape
        dv = (self.lever @ self._load.reshape(-1, self._load.shape[2])).reshape(m, dim, -1)
        return self.motion.carried(self.given) + self.F @ dv

    @property
    def left(self) -> Array:
        """(m, R) = -g(y) . dy."""
        return np.asarray(-(self.displaced.gradient[:, None, :] @ self._gone)[:, 0])

    @property
    def moved(self) -> Array:
        """(m, dim, R), collider space."""
        return np.asarray(self.pose.rotation.T @ (self._gone - self.motion.position))

    @property
    def approach(self) -> Array:
        """dz (m, dim, R): of the undisplaced loads, collider space."""
        return np.asarray(self.pose.rotation.T @ self.motion.position)

    @property
    def point(self) -> Array | None:
        """The part of dz (m, dim, n_rows, dim) that is internal response."""
        if self.internal is None:
            return None
        m, dim = self.given.shape
        turned = self.pose.rotation.T @ self.internal.reshape(m, dim, -1)
        return np.asarray(turned.reshape(self.internal.shape))


class ContactLoadsProbe:
    """Measures `ContactLoads` for one body and one collider.

    stiffness: of the penalty contact [N/m^4]; band: [m], loads up to this far outside the collider take part.
    """

    def __init__(
        self,
        body: ReducedBody,
        collider: Collider,
        mechanics: RestMechanics,
        stiffness: float,
        band: float,
    ) -> None:
        self.loads = LoadProbe(body, collider, mechanics, stiffness, band)
        self.collider, self._band = collider, band
        self._patch_probe = ContactProbe(body, collider)
        self._points = PointTensors.of(self.loads.points, torch.zeros((), dtype=torch.float64))
        self._areas = torch.from_numpy(mechanics.compliance.areas)
        self._last: tuple[Array, RigidPose, ContactLoads | None] | None = None

    def measure(self, rows: Array, pose: RigidPose, turn: Array | None = None) -> ContactLoads | None:
        """The loads at handle rows (n_rows, dim), or None where no load is inside the collider. turn: of the body,
        that of the rows themselves by default."""
        if turn is not None:
            return self._measure(rows, pose, turn)
        if self._last is not None:
            last_rows, last_pose, loads = self._last
            if last_pose is pose and np.array_equal(last_rows, rows):
                return loads
        loads = self._measure(rows, pose, self.loads.turn(rows))
        self._last = (rows.copy(), pose, loads)
        return loads

    def collider_rows(self, rows: Array, pose: RigidPose) -> Array:
        """T^-1 q (n_rows, dim)."""
        return self._patch_probe.collider_rows(rows, pose)

    def _measure(self, rows: Array, pose: RigidPose, turn: Array) -> ContactLoads | None:
        probe = self.loads
        press = probe.press(rows, pose, turn)
        if press is None:
            return None
        x, index = press.positions, press.around
        F = probe.deformation(rows, index)
        pressed = press.index[press.bearing]
        bearing = np.searchsorted(index, pressed)
        lever = probe.among(index, pressed).reshape(F.shape[0] * F.shape[1], -1)
        given = (lever @ press.load.ravel()).reshape(-1, F.shape[1])
        moved = (F @ given[..., None])[..., 0]
        displaced = press.problem.distance(x[index] + moved)
        load = np.zeros_like(moved)
        load[bearing] = press.load
        state = PointStates.at(
            self._points.take(torch.from_numpy(index)),
            self.collider_rows(rows, pose),
            pose.apply_inverse(x[index]),
            self.collider,
        )
        internal = None if probe.internal is None else probe.internal.derivative(turn, index)
        return ContactLoads(
            patch=self._patch_probe.measure(rows, pose),
            index=index,
            state=state,
            load=torch.from_numpy(load),
            moved=torch.from_numpy(pose.rotate_inverse(moved)),
            left=torch.from_numpy(-displaced.value),
            areas=self._areas[index],
            band=self._band,
            derivatives=LoadDerivatives(
                press, probe.motion(index, turn), F, given, bearing, lever, displaced, pose, internal
            ),
        )
