"""Material points as tensors, and what they are at a reduced state seen from the collider.

*Collider rows* are the handle rows taken to collider space, T^-1 q of thesis eq. 5.3: points and the
translation rows of frames are moved by the inverse pose, the linear rows of frames only rotated. Since U
reproduces affine maps,

    z = U rows = T^-1 x_reduced,      F_ij = sum_r rows_ri dU_r/dX_j = (R^T dx/dX)_ij.

Everything a contact-centric model knows of the state are functions of these rows: it cannot tell a moved body
from a body that was moved together with its collider.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from runtime.arrays import Array
from runtime.body.material_points import MaterialPoints
from runtime.colliders.collider import Collider
from runtime.colliders.pose import RigidPose


def collider_rows(rows: Array, affine_part: Array, pose: RigidPose) -> Array:
    """T^-1 q: handle rows (n_rows, dim) in collider space; affine_part: (n_rows,), see `Handles.affine_part`."""
    return (rows - affine_part[:, None] * pose.translation) @ pose.rotation


@dataclass(frozen=True, eq=False)
class PointTensors:
    """`MaterialPoints` as tensors of the model's type; any leading shape (...)."""

    rest: Tensor
    basis: Tensor
    basis_gradient: Tensor
    surface_distance: Tensor
    surface_normal: Tensor

    @classmethod
    def of(cls, points: MaterialPoints, like: Tensor) -> PointTensors:
        """With the type and device of `like`."""
        arrays = (
            points.rest,
            points.basis,
            points.basis_gradient,
            points.surface_distance,
            points.surface_normal,
        )
        return cls(*(torch.as_tensor(array).to(like) for array in arrays))

    def take(self, index: Tensor) -> PointTensors:
        """The points of the given indices, of any shape."""
        return self._map(lambda tensor: tensor[index])

    def to(self, like: Tensor | torch.device) -> PointTensors:
        """On a device, or with the type and device of a tensor."""
        return self._map(lambda tensor: tensor.to(like))

    def _map(self, change: Callable[[Tensor], Tensor]) -> PointTensors:
        return PointTensors(
            change(self.rest),
            change(self.basis),
            change(self.basis_gradient),
            change(self.surface_distance),
            change(self.surface_normal),
        )


@dataclass(frozen=True, eq=False)
class PointStates:
    """n points at a reduced state, in collider space.

    rows: (..., n_rows, dim) collider rows [m]; z: (..., n, dim) [m]; F: (..., n, dim, dim); sdf: (..., n)
    [m], slope: (..., n, dim) and, for derivatives only, curvature: (n, dim, dim) [1/m] of the collider's
    signed distance at z.
    """

    points: PointTensors
    rows: Tensor
    z: Tensor
    F: Tensor
    sdf: Tensor
    slope: Tensor
    curvature: Tensor | None = None

    @classmethod
    def at(cls, points: PointTensors, rows: Array, z: Array, collider: Collider) -> PointStates:
        """All of it for points at z = basis @ rows (n, dim); rows and z in float64, the distance is taken
        there."""
        like = points.basis
        tensor_rows = torch.from_numpy(rows).to(like)
        F = torch.matmul(tensor_rows.T, points.basis_gradient)
        sdf, slope, curvature = (torch.from_numpy(part).to(like) for part in collider.sdf_derivatives(z))
        return cls(points, tensor_rows, torch.from_numpy(z).to(like), F, sdf, slope, curvature)
