"""The network inputs of a point: three encodings of the relative configuration, with their derivatives.

An encoding converts the state of points to local inputs, and pulls a Jacobian dy/d(inputs) back to the handle rows by
the chain rule, written out by hand.
"""

from __future__ import annotations

from typing import Protocol

import torch
from torch import Tensor

from softprint.runtime.learned.deformed_normal import deformed_normal, deformed_normal_derivative
from softprint.runtime.learned.point_states import PointStates


class Encoding(Protocol):
    """Local inputs of a contact model."""

    def n_inputs(self, dim: int, n_rows: int) -> int: ...

    def encode(self, state: PointStates) -> Tensor:
        """Inputs (..., n, n_inputs)."""
        ...

    def pull_back(self, state: PointStates, jacobian: Tensor, rotation: Tensor) -> Tensor:
        """From dy/d(inputs) (n, n_out, n_inputs) to dy/d(world rows) (n, n_out, n_rows, dim) of one contact.

        rotation: (dim, dim) of the collider's pose, d(collider rows) = d(world rows) R.
        """
        ...


class WeightedRows:
    """The thesis's inputs (eq. 5.4): z and W(X) T^-1 q with W = diag(U(X)), all handle rows weighted by the
    basis."""

    def n_inputs(self, dim: int, n_rows: int) -> int:
        return dim + n_rows * dim

    def encode(self, state: PointStates) -> Tensor:
        weighted = state.points.basis[..., None] * state.rows[..., None, :, :]
        return torch.cat([state.z, weighted.flatten(-2)], dim=-1)

    def pull_back(self, state: PointStates, jacobian: Tensor, rotation: Tensor) -> Tensor:
        n, n_out, _ = jacobian.shape
        dim = state.z.shape[-1]
        to_z, to_rows = jacobian[..., :dim], jacobian[..., dim:].reshape(n, n_out, -1, dim)
        return state.points.basis[:, None, :, None] * ((to_z[:, :, None, :] + to_rows) @ rotation.T)


class AllRows:
    """z and all handle rows T^-1 q, without weights (eq. 5.3): the network itself has to find which of them matter."""

    def n_inputs(self, dim: int, n_rows: int) -> int:
        return dim + n_rows * dim

    def encode(self, state: PointStates) -> Tensor:
        rows = state.rows[..., None, :, :].flatten(-2)
        return torch.cat([state.z, rows.expand(*state.z.shape[:-1], -1)], dim=-1)

    def pull_back(self, state: PointStates, jacobian: Tensor, rotation: Tensor) -> Tensor:
        n, n_out, _ = jacobian.shape
        dim = state.z.shape[-1]
        to_z, to_rows = jacobian[..., :dim], jacobian[..., dim:].reshape(n, n_out, -1, dim)
        of_z = state.points.basis[:, None, :, None] * (to_z @ rotation.T)[:, :, None, :]
        return of_z + to_rows @ rotation.T


class LocalGeometry:
    """The position of the collider relative to the material point, which determines a contact anywhere on the body.

    Inputs: z, signed distance and its gradient there, F, the deformed outward normal of the nearest surface
    point, the rest distance to that surface, and the rest position (for properties that vary over the body:
    thickness, handles).
    """

    def n_inputs(self, dim: int, n_rows: int) -> int:
        return dim + 1 + dim + dim * dim + dim + 1 + dim

    def encode(self, state: PointStates) -> Tensor:
        points = state.points
        normal = deformed_normal(state.F, points.surface_normal)
        return torch.cat(
            [
                state.z,
                state.sdf[..., None],
                state.slope,
                state.F.flatten(-2),
                normal,
                points.surface_distance[..., None],
                points.rest,
            ],
            dim=-1,
        )

    def pull_back(self, state: PointStates, jacobian: Tensor, rotation: Tensor) -> Tensor:
        n, n_out, _ = jacobian.shape
        dim = state.z.shape[-1]
        to_z, to_sdf, to_slope, to_F, to_normal, _ = jacobian.split(
            [dim, 1, dim, dim * dim, dim, 1 + dim], dim=-1
        )
        _, normal_slope = deformed_normal_derivative(state.F, state.points.surface_normal)
        to_z = to_z + to_sdf * state.slope[:, None, :] + to_slope @ state.curvature
        to_F = to_F + to_normal @ normal_slope.reshape(n, dim, dim * dim)
        # Columns per point: d/dz_b, multiplied by the basis, then d/dF_bj for each j, by the gradient of the basis.
        by_row = torch.cat([to_z[..., None], to_F.reshape(n, n_out, dim, dim)], dim=-1)
        by_row = torch.einsum("nobk,cb->nock", by_row, rotation).reshape(n, n_out * dim, 1 + dim)
        basis = torch.cat([state.points.basis[..., None], state.points.basis_gradient], dim=-1)
        n_rows = basis.shape[1]
        world = torch.bmm(by_row, basis.transpose(1, 2))  # (n, n_out * dim, n_rows)
        return world.reshape(n, n_out, dim, n_rows).transpose(2, 3)


ENCODINGS: dict[str, Encoding] = {
    "weighted_rows": WeightedRows(),
    "all_rows": AllRows(),
    "local_geometry": LocalGeometry(),
}
