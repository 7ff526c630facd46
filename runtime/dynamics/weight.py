"""The weight of a body: of U rows, and of the internal response that hangs on it.

    E(rows) = -sum_i m_i g . (U rows + u)_i,    u = R [L (R^T rows - rest) + w R^T g],

linear in the rows while the turn R is held. Without the second part the body would not hang where it balances: u gives
way to gravity, and what it gives way by does work.
"""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array
from runtime.body.body import ReducedBody
from runtime.corrections.internal_response import InternalResponse


class Weight:
    """gravity: (dim,) [m/s^2]; internal: of all nodes of the body, None where U rows is all there is."""

    def __init__(self, body: ReducedBody, gravity: Array, internal: InternalResponse | None) -> None:
        self._linear = np.outer(body.basis.T @ body.node_mass, gravity)
        self._internal = internal
        if internal is not None:
            # Summed over the nodes: (dim, n_rows, dim) and (dim, dim).
            self._modes = np.einsum("n,narb->arb", body.node_mass, internal.modes, optimize=True)
            self._hanging = np.einsum("n,nab->ab", body.node_mass, internal.weight, optimize=True)

    def form(self, turn: Array) -> tuple[Array, float]:
        """The force F (n_rows, dim) [N] and c [J] of E = c - tr(F^T rows); turn: (dim, dim)."""
        if self._internal is None:
            return self._linear, 0.0
        hanging = self._internal.gravity @ turn
        force = np.tensordot(hanging, self._modes, 1)
        constant = np.vdot(force, self._internal.rest_rows) - hanging @ self._hanging @ hanging
        return self._linear + force @ turn.T, float(constant)
