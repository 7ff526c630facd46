"""Where nodes of a body are at a state, with all detail: for those who look at it, not for its dynamics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

from runtime.arrays import Array, IntArray
from runtime.body.body import ReducedBody
from runtime.contact.condensed.joint_press import BoundPressed, JointProbe
from runtime.dynamics.state import ReducedState
from runtime.learned.correction import BoundCorrection, Correction
from runtime.linalg.row_products import placed
from runtime.mechanics.static_condensation import StaticCondensation


class Snapshot(NamedTuple):
    """Handle rows and turn (n_rows, dim) of a state, and what every collider does there: plain data."""

    rows: Array
    turn: Array
    parts: list[Any]


class CorrectedNodes:
    """x = U rows + internal response + corrections of the given nodes, all by default. corrections: (name of the
    collider, correction); joint: those that are pressed together with others, by the collider's name; nothing is
    prepared before the first question."""

    def __init__(
        self,
        body: ReducedBody,
        corrections: Sequence[tuple[str, Correction]],
        internal: StaticCondensation | None,
        nodes: IntArray | None = None,
        joint: Mapping[str, JointProbe] | None = None,
    ) -> None:
        self._body, self._nodes, self._joint = body, nodes, joint or {}
        self._corrections, self._everywhere = corrections, internal

    def positions(self, state: ReducedState) -> Array:
        """(n, dim) [m]."""
        return self.drawn(self.snapshot(state))

    def snapshot(self, state: ReducedState) -> Snapshot:
        """What is to be drawn: loads are pressed now, if they have not been."""
        turn = state.rows if state.turn is None else state.turn
        parts = [self._part(collider, correction, state, turn) for collider, correction in self._bound]
        return Snapshot(state.rows, turn, parts)

    def _part(self, collider: str, correction: BoundCorrection, state: ReducedState, turn: Array) -> Any:
        """Of one collider: displacement (n, dim) [m], or what `BoundPressed.drawn` makes it of; None for none."""
        rows, pose = state.rows, state.poses[collider]
        press = None
        if collider in self._joint:
            press = self._joint[collider].press(rows, state.poses, turn)
            if press is None:
                return None
        if isinstance(correction, BoundPressed):
            return correction.pressed(press, rows, pose, turn)
        return correction.displacement(rows, pose, turn)

    def drawn(self, snapshot: Snapshot) -> Array:
        """(n, dim) [m] of a snapshot of these nodes, most of the work: on any thread or in another process, beside
        other steps."""
        x = placed(self._basis, snapshot.rows)
        if self._internal is not None:
            x += self._internal.displacement(snapshot.rows, snapshot.turn)
        for (_, correction), part in zip(self._bound, snapshot.parts, strict=True):
            if part is not None:
                x += correction.drawn(part) if isinstance(correction, BoundPressed) else part
        return x

    @cached_property
    def _basis(self) -> Array:
        return self._body.basis if self._nodes is None else self._body.basis[self._nodes]

    @cached_property
    def _internal(self) -> StaticCondensation | None:
        if self._everywhere is None or self._nodes is None:
            return self._everywhere
        return self._everywhere.at(self._nodes)

    @cached_property
    def _bound(self) -> list[tuple[str, BoundCorrection]]:
        if not self._corrections:
            return []
        points = self._body.node_points(self._nodes)
        return [(collider, correction.bind(points)) for collider, correction in self._corrections]
