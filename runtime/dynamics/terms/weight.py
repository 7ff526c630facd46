"""The weight of a body: of U rows, and of the internal response that hangs on it.

    E(rows) = -sum_i m_i g . (U rows + u)_i,    u_i = R [L_i (R^T rows - rest) + w_i R^T g],

linear in the rows while the turn is held; R is that of the region of the body where i is (`body_regions.py`). Without
the second part the body would not hang where it balances: u gives way to gravity, and what it gives way by does work.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from runtime.arrays import Array, same
from runtime.body.body import ReducedBody
from runtime.compiled import summing
from runtime.mechanics.body_regions import BodyRegions
from runtime.mechanics.static_condensation import StaticCondensation


class Weight:
    """gravity: (dim,) [m/s^2]; internal: of all nodes of the body, None where U rows is all there is."""

    def __init__(self, body: ReducedBody, gravity: Array, internal: StaticCondensation | None) -> None:
        self._linear = np.outer(body.basis.T @ body.node_mass, gravity)
        self._internal = internal
        self._last: tuple[Array, tuple[Array, float]] | None = None
        if internal is not None:
            regions = BodyRegions(body, internal)
            self._turning = regions.turning
            # Summed over the nodes of a region: (n, dim, n_rows, dim) and (n, dim, dim).
            shares = sp.csr_matrix(
                (body.node_mass, (regions.of_nodes, np.arange(body.n_nodes))),
                shape=(regions.count, body.n_nodes),
            )
            self._modes = _summed(shares, internal.modes)
            self._hanging = _summed(shares, internal.weight)

    def form(self, turn: Array) -> tuple[Array, float]:
        """The force F (n_rows, dim) [N] and c [J] of E = c - tr(F^T rows); turn: (n_rows, dim), see `corotation.py`.
        That of the last turn is kept."""
        if self._internal is None:
            return self._linear, 0.0
        if self._last is None or not same(self._last[0], turn):
            self._last = turn.copy(), self._hangs(self._internal, turn)
        return self._last[1]

    def _hangs(self, internal: StaticCondensation, turn: Array) -> tuple[Array, float]:
        """`form`, with an internal response."""
        rotations = self._turning.rotations(turn)
        force, constant = _hanging(
            self._modes, self._hanging, internal.gravity, internal.rest_rows, rotations
        )
        return self._linear + force, constant


@summing
def _hanging(
    modes: Array, weight: Array, gravity: Array, rest: Array, rotations: Array
) -> tuple[Array, float]:
    """sum_n h L_n R^T (n_rows, dim) and sum_n h L_n : rest - h w_n h with h = R^T g, over the regions n: L (n, dim,
    n_rows, dim), w (n, dim, dim)."""
    n_rows, dim = rest.shape
    total, constant = np.zeros((n_rows, dim)), 0.0
    for n in range(len(modes)):
        R, force, h = rotations[n], np.zeros((n_rows, dim)), np.zeros(dim)
        for a in range(dim):
            for b in range(dim):
                h[a] += gravity[b] * R[b, a]
            share, by_row = h[a], modes[n, a]
            for r in range(n_rows):
                for b in range(dim):
                    force[r, b] += share * by_row[r, b]
        for r in range(n_rows):
            for b in range(dim):
                constant += force[r, b] * rest[r, b]
                for a in range(dim):
                    total[r, a] += force[r, b] * R[a, b]
        for a in range(dim):
            for b in range(dim):
                constant -= h[a] * weight[n, a, b] * h[b]
    return total, constant


def _summed(shares: sp.csr_matrix, values: NDArray[np.floating[Any]]) -> Array:
    """Over the nodes (n_nodes, ...), by their shares (n, n_nodes) in regions."""
    return np.asarray(shares @ values.reshape(len(values), -1)).reshape(-1, *values.shape[1:])
