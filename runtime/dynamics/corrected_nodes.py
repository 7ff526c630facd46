"""Where nodes of a body are at a state, with all detail: for those who look at it, not for its dynamics."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from runtime.arrays import Array, IntArray
from runtime.body.body import ReducedBody
from runtime.corrections.correction import BoundCorrection, Correction
from runtime.corrections.internal_response import InternalResponse
from runtime.dynamics.state import ReducedState


class CorrectedNodes:
    """x = U rows + internal response + corrections of the given nodes, all by default. corrections: (name of the
    collider, correction); nothing is prepared before the first question."""

    def __init__(
        self,
        body: ReducedBody,
        corrections: Sequence[tuple[str, Correction]],
        internal: InternalResponse | None,
        nodes: IntArray | None = None,
    ) -> None:
        self._body, self._nodes = body, nodes
        self._corrections, self._everywhere = corrections, internal

    def positions(self, state: ReducedState) -> Array:
        """(n, dim) [m]."""
        x: Array = self._basis @ state.rows
        turn = state.turn
        if self._internal is not None:
            turn = self._internal.turn(state.rows) if turn is None else turn
            x += self._internal.displacement(state.rows, turn)
        for collider, correction in self._bound:
            x += correction.displacement(state.rows, state.poses[collider], turn)
        return x

    @cached_property
    def _basis(self) -> Array:
        return self._body.basis if self._nodes is None else self._body.basis[self._nodes]

    @cached_property
    def _internal(self) -> InternalResponse | None:
        if self._everywhere is None or self._nodes is None:
            return self._everywhere
        return self._everywhere.at(self._nodes)

    @cached_property
    def _bound(self) -> list[tuple[str, BoundCorrection]]:
        if not self._corrections:
            return []
        points = self._body.node_points(self._nodes)
        return [(collider, correction.bind(points)) for collider, correction in self._corrections]
