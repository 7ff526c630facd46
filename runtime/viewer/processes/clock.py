"""When the next step of a session is due, and how fast the steps really come."""

from __future__ import annotations

import time
from collections import deque

from softprint.runtime.viewer.processes.frame_info import Pace

# Steps that the pace is averaged over, at most this old [s].
_WINDOW = 1.0
# A simulation that is late by more than this [s] does not catch up.
_LATE = 0.1


class Clock:
    """Paces steps of `step` simulated seconds."""

    def __init__(self, step: float) -> None:
        self.step = step
        self._due = time.monotonic()
        self._taken: deque[tuple[float, float]] = deque()

    @property
    def wait(self) -> float:
        """Seconds until the next step is due; 0 if it is."""
        return max(0.0, self._due - time.monotonic())

    def stepped(self, cost: float, speed: float) -> None:
        """Note a step that took so many seconds."""
        now = time.monotonic()
        self._due = max(self._due + self.step / speed, now - _LATE)
        self._taken.append((now, cost))
        # Two steps are left however long they took: slow ones have a pace, too.
        while len(self._taken) > 2 and self._taken[0][0] < now - _WINDOW:
            self._taken.popleft()

    def rest(self) -> None:
        """Nothing was to be done: the next step is due now."""
        self._due = time.monotonic()
        self._taken.clear()

    @property
    def pace(self) -> Pace:
        """Over the last second, or the last two steps where they took longer."""
        if len(self._taken) < 2:
            return Pace()
        span = self._taken[-1][0] - self._taken[0][0]
        steps = (len(self._taken) - 1) / span if span > 0 else 0.0
        return Pace(steps, sum(cost for _, cost in self._taken) / len(self._taken), steps * self.step)
