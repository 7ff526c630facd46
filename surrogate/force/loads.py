"""The loads of a contact: the contact nodes that its points act on, and the anchors that spread forces act around."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.mechanics.compliance.surface_compliance import SurfaceCompliance
from softprint.runtime.mechanics.loaded_points import LoadedPoints


class Loads(NamedTuple):
    """Of m contact points. loads: (n,) contact nodes, and then anchors, numbered from the number of contact nodes on;
    corners: (m, c) the nodes of each point, by their places among these, and shares: (m, c); anchors: (k, a) the loads
    that a spread force on each of the k nodes acts on, and anchor_shares: (k, a)."""

    loads: IntArray
    corners: IntArray
    shares: Array
    anchors: IntArray
    anchor_shares: Array

    @classmethod
    def of(cls, points: LoadedPoints, index: IntArray, spread: SurfaceCompliance) -> Loads:
        """Of some of the points (m,)."""
        nodes, corners, shares = points.among(index)
        between, anchor_shares = _padded_rows(spread, nodes)
        anchors, place = np.unique(between, return_inverse=True)
        loads = np.concatenate([nodes, len(spread.nodes) + anchors])
        return cls(loads, corners, shares, len(nodes) + place.reshape(between.shape), anchor_shares)

    def to_points(self, at: NDArray[Any]) -> Array:
        """Of what there is at the loads (n, dim), what m points with forces on them, and spread around them, have a
        share in: (m, 2 dim)."""
        around = (self.anchor_shares[..., None] * at[self.anchors]).sum(axis=1)
        on_points = (self.shares[..., None] * at[self.corners]).sum(axis=1)
        return np.concatenate(
            [on_points, (self.shares[..., None] * around[self.corners]).sum(axis=1)], axis=1
        )


def on_loads(
    forces: Tensor, corners: Tensor, shares: Tensor, anchors: Tensor, anchor_shares: Tensor, n: int
) -> Tensor:
    """Forces (b, n, dim) on loads by forces phi and psi (b, m, 2 dim) on contact points and spread around them; the
    others: of `Loads`, of b samples, padded."""
    phi, psi = forces.chunk(2, dim=-1)
    around = _shared(psi, corners, shares, anchors.shape[1])
    return _shared(phi, corners, shares, n) + _shared(around, anchors, anchor_shares, n)


def _shared(forces: Tensor, places: Tensor, shares: Tensor, n: int) -> Tensor:
    """(b, n, dim) by forces (b, m, dim) with shares (b, m, c) at places (b, m, c)."""
    b, _, dim = forces.shape
    parts = (shares[..., None] * forces[:, :, None]).reshape(b, -1, dim)
    at = places.reshape(b, -1, 1).expand(-1, -1, dim)
    return forces.new_zeros(b, n, dim).scatter_add(1, at, parts)


def _padded_rows(spread: SurfaceCompliance, nodes: IntArray) -> tuple[IntArray, Array]:
    """The anchors of contact nodes (k,) and their shares, (k, a) both; where there are fewer, the first again, with no
    share."""
    share, rows = spread.share, spread.share[nodes]
    count = np.diff(rows.indptr)
    most = int(np.diff(share.indptr).max())
    place = np.minimum(np.arange(most), count[:, None] - 1) + rows.indptr[:-1, None]
    return rows.indices[place].astype(np.int64), np.where(
        np.arange(most) < count[:, None], rows.data[place], 0.0
    )
