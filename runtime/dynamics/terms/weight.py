"""The weight of a body at U rows and the displacement u of static condensation.

    E(rows) = -sum_i m_i g . (U rows + u)_i,    u_i = R [L_i (R^T rows - rest) + w_i R^T g],

linear in the rows while the rotations R are fixed, one for each region of the body (`body_regions.py`). Without the
second part the equilibrium under gravity would be wrong: u depends on gravity, and gravity does work along u.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.compiled import summing
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mechanics.body_regions import BodyRegions
from softprint.runtime.mechanics.static_condensation import StaticCondensation


class Weight:
    """gravity: (dim,) [m/s^2]; condensation: of all nodes of the body, None without static condensation."""

    def __init__(self, body: ReducedBody, gravity: Array, condensation: StaticCondensation | None) -> None:
        self._linear = np.outer(body.basis.T @ body.node_mass, gravity)
        self._condensation = condensation
        if condensation is not None:
            regions = BodyRegions(body, condensation)
            self._corotation = regions.corotation
            # Summed over the nodes of a region: (n, dim, n_rows, dim) and (n, dim, dim).
            shares = sp.csr_matrix(
                (body.node_mass, (regions.of_nodes, np.arange(body.n_nodes))),
                shape=(regions.count, body.n_nodes),
            )
            self._modes = _summed(shares, condensation.modes)
            self._by_gravity = _summed(shares, condensation.weight)

    def form(self, frame_rows: Array) -> tuple[Array, float]:
        """The force F (n_rows, dim) [N] and c [J] of E = c - tr(F^T rows), with the rotations of frame rows (n_rows,
        dim), see `corotation.py`."""
        own = self._condensation
        if own is None:
            return self._linear, 0.0
        rotations = self._corotation.rotations(frame_rows)
        force, constant = _condensed_weight(
            self._modes, self._by_gravity, own.gravity, own.rest_rows, rotations
        )
        return self._linear + force, constant


@summing
def _condensed_weight(
    modes: Array, weight: Array, gravity: Array, rest: Array, rotations: Array
) -> tuple[Array, float]:
    """sum_n h L_n R^T (n_rows, dim) and sum_n h L_n : rest - h w_n h with h = R^T g, over the regions n; modes: L (n,
    dim, n_rows, dim); weight: w (n, dim, dim)."""
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
    """Values (n_nodes, ...) summed over the nodes, with weights `shares` (n, n_nodes) in regions."""
    return np.asarray(shares @ values.reshape(len(values), -1)).reshape(-1, *values.shape[1:])


def acceleration(body: ReducedBody, gravity: Sequence[float] | Array | None) -> Array:
    """Gravity as an array (dim,) [m/s^2], zero for None. Raises SoftprintError for anything else."""
    found = np.zeros(body.dim) if gravity is None else np.asarray(gravity, dtype=float)
    if found.shape != (body.dim,) or not np.isfinite(found).all():
        raise SoftprintError(f"gravity must be {body.dim} numbers for this body, not {found.tolist()}")
    return found
