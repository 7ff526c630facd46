"""Material points as tensors, and their states in collider space at a reduced state.

*Collider rows* are the handle rows in collider space, T^-1 q of thesis eq. 5.3: points and the translation rows of
frames are transformed by the inverse pose, the linear rows of frames are only rotated. Since U reproduces affine maps,

    z = U rows = T^-1 x_reduced,      F_ij = sum_r rows_ri dU_r/dX_j = (R^T dx/dX)_ij.

All inputs of a contact-centric model are functions of these rows, so it is invariant to common rigid motions of body
and collider.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from softprint.runtime.arrays import Array
from softprint.runtime.body.material_points import MaterialPoints
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose


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
        """The points with these indices, of any shape."""
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
        """The states of points at z = basis @ rows (n, dim); rows and z in float64, in which the distance is
        computed."""
        like = points.basis
        tensor_rows = torch.from_numpy(rows).to(like)
        F = torch.matmul(tensor_rows.T, points.basis_gradient)
        sdf, slope, curvature = (torch.from_numpy(part).to(like) for part in collider.sdf_derivatives(z))
        return cls(points, tensor_rows, torch.from_numpy(z).to(like), F, sdf, slope, curvature)
