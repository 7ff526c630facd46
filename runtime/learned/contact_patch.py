"""The contact patch: position, depth and width of the contact as a whole, inputs that all points share.

It is measured at the reduced positions of the body's surface samples, over those that penetrate, with the weights of
the penalty pressure (w_i = a_i depth_i^2, so that the weight of a sample vanishes smoothly as it leaves the contact):

    depth  D = sum w_i depth_i / sum w_i          [m]
    size   s = (sum w_i / D^2)^(1/(dim-1))        [m], the width of the patch
    means over the patch of z, deformed surface normal, gradient of the distance, rest position; covariance of z

All but the means of rest positions are in collider space. These numbers are the *shared inputs* of a contact model, and
its displacement fades to zero with D as contact opens. Their derivative is one small tensor for the whole body, so the
global part of the model adds almost no cost.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.deformed_normal import deformed_normal, deformed_normal_derivative
from softprint.runtime.learned.point_states import PointTensors, collider_rows


@dataclass(frozen=True, eq=False)
class Patch:
    """depth: D [m]; shared: (n_shared,); touching: the penetrating samples; rotation: (dim, dim) of the collider's
    pose. The derivatives by the world rows are computed at their first use."""

    depth: float
    shared: Tensor
    touching: Touching
    rotation: Tensor

    @cached_property
    def shared_slope(self) -> Tensor:
        """(n_shared, n_rows, dim)."""
        points = self.touching.points
        to_z, to_F = self.touching.derivatives()
        slope = torch.einsum("mr,fmb->frb", points.basis, to_z)
        slope += torch.einsum("mrj,fmbj->frb", points.basis_gradient, to_F)
        return slope @ self.rotation.T


def n_shared_inputs(dim: int) -> int:
    """The number of shared inputs: depth, size, four mean vectors and a covariance."""
    return 2 + 4 * dim + dim * (dim + 1) // 2


class ContactProbe:
    """Measures the contact patch of one body with one collider, in float64."""

    def __init__(self, body: ReducedBody, collider: Collider) -> None:
        if body.dim != collider.dim:
            raise SoftprintError(
                f"body {body.name!r} is {body.dim}D, but the collider {collider.name!r} is {collider.dim}D"
            )
        self.body_hash = body.content_hash
        self.collider = collider
        points = body.node_points(body.surface.nodes)
        self.affine_part = body.handles.affine_part
        self._basis = points.basis
        self._areas = body.surface.areas
        self._points = PointTensors.of(points, torch.zeros((), dtype=torch.float64))

    def collider_rows(self, rows: Array, pose: RigidPose) -> Array:
        """T^-1 q (n_rows, dim)."""
        return collider_rows(rows, self.affine_part, pose)

    def measure(self, rows: Array, pose: RigidPose) -> Patch | None:
        """The patch at handle rows (n_rows, dim), or None where no surface sample penetrates."""
        local_rows = self.collider_rows(rows, pose)
        z = self._basis @ local_rows
        near = np.flatnonzero(((z > self.collider.lower) & (z < self.collider.upper)).all(axis=1))
        inside = near[self.collider.sdf(z[near]) < 0.0] if near.size else near
        if inside.size == 0:
            return None
        distance = self.collider.sdf_derivatives(z[inside])
        touching = Touching(
            self._points.take(torch.from_numpy(inside)),
            torch.from_numpy(self._areas[inside]),
            torch.from_numpy(local_rows),
            torch.from_numpy(z[inside]),
            *(torch.from_numpy(part) for part in distance),
        )
        shared = touching.features()
        return Patch(float(shared[0]), shared, touching, torch.from_numpy(pose.rotation.copy()))


@dataclass(frozen=True, eq=False)
class Touching:
    """The m penetrating samples: areas (m,), collider rows, z (m, dim), and the signed distance there with its first
    and second derivatives."""

    points: PointTensors
    areas: Tensor
    rows: Tensor
    z: Tensor
    sdf: Tensor
    slope: Tensor
    curvature: Tensor

    @cached_property
    def _weight(self) -> Tensor:
        return self.areas * self.sdf**2

    @cached_property
    def _F(self) -> Tensor:
        return torch.matmul(self.rows.T, self.points.basis_gradient)

    def features(self) -> Tensor:
        """Shared inputs (f,); the first is D."""
        weight = self._weight
        total = weight.sum()
        share = weight / total
        depth = share @ -self.sdf
        size = (total / depth**2) ** (1.0 / (self.z.shape[1] - 1))
        centre = share @ self.z
        normal = deformed_normal(self._F, self.points.surface_normal)
        means = torch.cat([normal, self.slope, self.points.rest, self._products(centre)], dim=1)
        return torch.cat([depth[None], size[None], centre, share @ means])

    def _products(self, centre: Tensor) -> Tensor:
        """(m, dim(dim+1)/2) products of offsets from the centre; their mean is the covariance."""
        offset = self.z - centre
        upper = torch.triu_indices(offset.shape[1], offset.shape[1])
        return offset[:, upper[0]] * offset[:, upper[1]]

    def derivatives(self) -> tuple[Tensor, Tensor]:
        """d(shared)/dz_i (f, m, dim) and d(shared)/dF_i (f, m, dim, dim)."""
        m, dim = self.z.shape
        depth = -self.sdf
        total = self._weight.sum()
        weight_slope = -2.0 * (self.areas * depth)[:, None] * self.slope  # dw_i/dz_i
        share, share_slope = self._weight / total, weight_slope / total

        def mean(values: Tensor, to_z: Tensor) -> tuple[Tensor, Tensor]:
            """Weighted mean of values (m, k) and its slope (k, m, dim), from dvalues/dz (m, k, dim)."""
            average = share @ values
            slope = share[:, None, None] * to_z + (values - average)[:, :, None] * share_slope[:, None, :]
            return average, slope.transpose(0, 1)

        zero, identity = self.z.new_zeros(m, dim, dim), torch.eye(dim, dtype=self.z.dtype).expand(m, dim, dim)
        D, D_slope = mean(depth[:, None], -self.slope[:, None, :])
        normal, normal_slope = deformed_normal_derivative(self._F, self.points.surface_normal)
        centre, centre_slope = mean(self.z, identity)
        offset = self.z - centre
        upper = torch.triu_indices(dim, dim)
        # The derivative of the covariance by the centre is zero, so only z_i itself is differentiated.
        product_slope = (
            offset[:, upper[0], None] * identity[:, upper[1]]
            + offset[:, upper[1], None] * identity[:, upper[0]]
        )

        exponent = 1.0 / (dim - 1)
        size = (total / D**2) ** exponent
        size_slope = size * exponent * (share_slope - 2.0 * D_slope / D)
        slopes = [
            D_slope,
            size_slope,
            centre_slope,
            mean(normal, zero)[1],
            mean(self.slope, self.curvature)[1],
            mean(self.points.rest, zero)[1],
            mean(self._products(centre), product_slope)[1],
        ]
        to_z = torch.cat(slopes)
        to_F = self.z.new_zeros(len(to_z), m, dim, dim)
        start = 2 + dim
        to_F[start : start + dim] = (share[:, None, None, None] * normal_slope).transpose(0, 1)
        return to_z, to_F
