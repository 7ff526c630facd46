"""Where nodes of a body are at a state, with all detail: for those who look at it, not for its dynamics."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

from runtime.arrays import Array, IntArray
from runtime.body.body import ReducedBody
from runtime.corrections.correction import BoundCorrection, Correction
from runtime.corrections.internal_response import InternalResponse
from runtime.corrections.joint_press import BoundPressed, JointProbe
from runtime.dynamics.state import ReducedState
from runtime.row_products import placed


class CorrectedNodes:
    """x = U rows + internal response + corrections of the given nodes, all by default. corrections: (name of the
    collider, correction); joint: those that are pressed together with others, by the collider's name; nothing is
    prepared before the first question."""

    def __init__(
        self,
        body: ReducedBody,
        corrections: Sequence[tuple[str, Correction]],
        internal: InternalResponse | None,
        nodes: IntArray | None = None,
        joint: Mapping[str, JointProbe] | None = None,
    ) -> None:
        self._body, self._nodes, self._joint = body, nodes, joint or {}
        self._corrections, self._everywhere = corrections, internal

    def positions(self, state: ReducedState) -> Array:
        """(n, dim) [m]."""
        return self.later(state)()

    def later(self, state: ReducedState) -> Callable[[], Array]:
        """The same in two parts: loads are pressed now, if they have not been; what is called later, on any thread
        and beside other steps, does the rest, most of the work."""
        rows, internal, basis = state.rows, self._internal, self._basis
        turn = rows if state.turn is None else state.turn
        moved = [self._later(collider, correction, state, turn) for collider, correction in self._bound]

        def positions() -> Array:
            x = placed(basis, rows)
            if internal is not None:
                x += internal.displacement(rows, turn)
            for displacement in moved:
                x += displacement()
            return x

        return positions

    def _later(
        self, collider: str, correction: BoundCorrection, state: ReducedState, turn: Array
    ) -> Callable[[], Array | float]:
        """(n, dim) [m] by one collider; where it presses together with others, by its share of what all of them do."""
        rows, pose = state.rows, state.poses[collider]
        press = None
        if collider in self._joint:
            press = self._joint[collider].press(rows, state.poses, turn)
            if press is None:
                return lambda: 0.0
        if isinstance(correction, BoundPressed):
            return correction.later(press, rows, pose, turn)
        displacement = correction.displacement(rows, pose, turn)
        return lambda: displacement

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
