"""Where nodes of a body are at a state, with all detail: for those who look at it, not for its dynamics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, cast

from runtime.arrays import Array, IntArray
from runtime.body.body import ReducedBody
from runtime.corrections.correction import BoundCorrection, Correction
from runtime.corrections.internal_response import InternalResponse
from runtime.corrections.joint_press import JointProbe
from runtime.dynamics.state import ReducedState

if TYPE_CHECKING:
    from runtime.corrections.elastic_contact import BoundElasticContact


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
        x: Array = self._basis @ state.rows
        turn = state.rows if state.turn is None else state.turn
        if self._internal is not None:
            x += self._internal.displacement(state.rows, turn)
        for collider, correction in self._bound:
            x += self._displacement(collider, correction, state, turn)
        return x

    def _displacement(
        self, collider: str, correction: BoundCorrection, state: ReducedState, turn: Array
    ) -> Array | float:
        """(n, dim) [m] by one collider; where it presses together with others, by its share of what all of them do."""
        rows, pose = state.rows, state.poses[collider]
        if collider not in self._joint:
            return correction.displacement(rows, pose, turn)
        press = self._joint[collider].press(rows, state.poses, turn)
        if press is None:
            return 0.0
        return cast("BoundElasticContact", correction).displacement_among(press, rows, pose, turn)

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
