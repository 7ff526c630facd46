"""The contact as a whole: what every point is told about where, how deep and how wide the collider presses.

Measured on the reduced positions of the body's surface samples, over those that penetrate, weighted as the
penalty pressure would (w_i = a_i depth_i^2, so that a sample enters and leaves smoothly):

    depth  D = sum w_i depth_i / sum w_i          [m]
    size   s = (sum w_i / D^2)^(1/(dim-1))        [m], the width of the patch
    means over the patch of z, carried surface normal, gradient of the distance, rest position; covariance of
    z

All but the means of rest positions are in collider space. These numbers are the *shared inputs* of a contact
model and D is the measure by which its displacement fades as contact opens. Their derivative costs one small
tensor for the whole body, so the global part of the model is nearly free.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from runtime.arrays import Array
from runtime.body.body import ReducedBody
from runtime.colliders.collider import Collider
from runtime.colliders.pose import RigidPose
from runtime.corrections.carried_normal import carried_normal_derivative
from runtime.corrections.points import PointTensors, affine_part, collider_rows
from runtime.errors import SoftprintError


@dataclass(frozen=True, eq=False)
class Patch:
    """depth: D [m]; shared: (n_shared,); and their derivatives with respect to the world rows, (n_rows, dim)
    and (n_shared, n_rows, dim)."""

    depth: float
    shared: Tensor
    depth_slope: Tensor
    shared_slope: Tensor


def n_shared_inputs(dim: int) -> int:
    """Depth, size, four mean vectors and a covariance."""
    return 2 + 4 * dim + dim * (dim + 1) // 2


class ContactProbe:
    """Measures the contact patch of one body with one collider. All arithmetic in float64."""

    def __init__(self, body: ReducedBody, collider: Collider) -> None:
        if body.dim != collider.dim:
            raise SoftprintError(
                f"body {body.name!r} is {body.dim}D, but the collider {collider.name!r} is {collider.dim}D"
            )
        self.body_hash = body.content_hash
        self.collider = collider
        points = body.node_points(body.surface.nodes)
        self.affine_part = affine_part(body.handles)
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
        touching = _Touching(
            self._points.take(torch.from_numpy(inside)),
            torch.from_numpy(self._areas[inside]),
            torch.from_numpy(local_rows),
            torch.from_numpy(z[inside]),
            *(torch.from_numpy(part) for part in distance),
        )
        depth, shared, to_z, to_F = touching.features()
        slope = torch.einsum("mr,fmb->frb", touching.points.basis, to_z)
        slope += torch.einsum("mrj,fmbj->frb", touching.points.basis_gradient, to_F)
        slope = slope @ torch.from_numpy(pose.rotation.T.copy())
        return Patch(float(depth), shared, slope[0], slope)


@dataclass(frozen=True, eq=False)
class _Touching:
    """The m penetrating samples: areas (m,), collider rows, z (m, dim), and the signed distance there."""

    points: PointTensors
    areas: Tensor
    rows: Tensor
    z: Tensor
    sdf: Tensor
    slope: Tensor
    curvature: Tensor

    def features(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """D, shared inputs (f,), and d(shared)/dz_i (f, m, dim), d(shared)/dF_i (f, m, dim, dim); D is
        shared[0]."""
        m, dim = self.z.shape
        depth = -self.sdf
        weight = self.areas * depth**2
        weight_slope = -2.0 * (self.areas * depth)[:, None] * self.slope  # dw_i/dz_i
        total = weight.sum()
        share, share_slope = weight / total, weight_slope / total

        def mean(values: Tensor, to_z: Tensor) -> tuple[Tensor, Tensor]:
            """Weighted mean of values (m, k) and its slope (k, m, dim), from dvalues/dz (m, k, dim)."""
            average = share @ values
            slope = share[:, None, None] * to_z + (values - average)[:, :, None] * share_slope[:, None, :]
            return average, slope.transpose(0, 1)

        zero, identity = self.z.new_zeros(m, dim, dim), torch.eye(dim, dtype=self.z.dtype).expand(m, dim, dim)
        D, D_slope = mean(depth[:, None], -self.slope[:, None, :])
        F = torch.einsum("rb,mrj->mbj", self.rows, self.points.basis_gradient)
        normal, normal_slope = carried_normal_derivative(F, self.points.surface_normal)
        centre, centre_slope = mean(self.z, identity)
        offset = self.z - centre
        upper = torch.triu_indices(dim, dim)
        # The covariance does not change to first order with the centre, so only z_i itself is differentiated.
        product = offset[:, upper[0]] * offset[:, upper[1]]
        product_slope = (
            offset[:, upper[0], None] * identity[:, upper[1]]
            + offset[:, upper[1], None] * identity[:, upper[0]]
        )

        exponent = 1.0 / (dim - 1)
        size = (total / D**2) ** exponent
        size_slope = size * exponent * (share_slope - 2.0 * D_slope / D)
        parts = [
            (D, D_slope),
            (size, size_slope),
            (centre, centre_slope),
            mean(normal, zero),
            mean(self.slope, self.curvature),
            mean(self.points.rest, zero),
            mean(product, product_slope),
        ]
        shared = torch.cat([value for value, _ in parts])
        to_z = torch.cat([slope for _, slope in parts])
        to_F = self.z.new_zeros(len(shared), m, dim, dim)
        start = 2 + dim
        to_F[start : start + dim] = (share[:, None, None, None] * normal_slope).transpose(0, 1)
        return D[0], shared, to_z, to_F
