"""Where contact came from. Loads may be in balance in several ways; of these a body comes to the one next to the last.

Dynamics asks for energy, derivatives and forces of one state one after the other, so that the last press is kept; and
the next one starts from it, or from one that is held. A line search looks about one state: were each trial to start
from the last, which may have slid to another balance, the energy would leap however short the step becomes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

from runtime.arrays import Array, same

Where = TypeVar("Where")
Press = TypeVar("Press")


class _Last(NamedTuple, Generic[Where, Press]):
    rows: Array
    where: Where
    turn: Array
    press: Press | None


class PressMemory(Generic[Where, Press]):
    """Of one body among colliders that are somewhere; same: whether they are at the same place."""

    def __init__(self, same: Callable[[Where, Where], bool]) -> None:
        self._same = same
        self._last: _Last[Where, Press] | None = None
        self._held: Press | None = None

    def press(
        self, rows: Array, where: Where, turn: Array, find: Callable[[Press | None], Press | None]
    ) -> Press | None:
        """What was found last for this state; or what is found now, from the press that it is to start from."""
        last = self._last
        there = last is not None and self._same(last.where, where) and same(last.turn, turn)
        if last is not None and there and same(last.rows, rows):
            return last.press
        found = find(self._held or (None if last is None else last.press))
        self._last = _Last(rows.copy(), where, turn.copy(), found)
        return found

    def hold(self, press: Press | None) -> None:
        """Start from this press, until another is held, wherever the loads are pressed next."""
        self._held = press

    def forget(self) -> None:
        """Start from nothing."""
        self._last = self._held = None
