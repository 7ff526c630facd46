"""Contact force over time, one line for each model."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np

from softprint.runtime.arrays import Array

if TYPE_CHECKING:
    import viser

_SPAN = 8.0  # s
_LONGEST = 1500
_LINES = ("#d65c3a", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")


def force_lines(count: int) -> Any:
    """The series of a plot of so many forces over time, for viser."""
    lines = [{"label": f"{n + 1}", "stroke": _LINES[n % len(_LINES)], "width": 2} for n in range(count)]
    return ({"label": "s"}, *lines)


def force_scales() -> Any:
    """The scales of such a plot: forces from zero on, so that one that does not change is a level line."""
    from_zero = {"min": {"pad": 0.1, "soft": 0.0, "mode": 1}, "max": {"pad": 0.1, "soft": 0.0, "mode": 1}}
    return {"x": {"time": False, "auto": True}, "y": {"auto": True, "range": from_zero}}


def swatch(number: int) -> str:
    """The colour of a line, in HTML."""
    return f'<b style="color:{_LINES[number % len(_LINES)]}">━</b> '


class ForcePlot:
    """The last seconds."""

    def __init__(self, server: viser.ViserServer, height: int = 150) -> None:
        self._points: deque[tuple[float, ...]] = deque(maxlen=_LONGEST)
        self._count = 1
        self._handle = server.gui.add_uplot(
            data=self._data(),
            series=force_lines(1),
            title="contact force [N]",
            scales=force_scales(),
            legend={"show": False},
            height=height,
        )

    def add(self, time: float, forces: list[float]) -> None:
        """One point [s, N] of each model; time that goes back, and another number of models, begin a new plot."""
        if len(forces) != self._count or (self._points and time < self._points[-1][0]):
            self._points.clear()
        if self._points and time == self._points[-1][0]:
            return
        if len(forces) != self._count:
            self._count = len(forces)
            self._handle.series = force_lines(self._count)
        self._points.append((time, *forces))
        while self._points[0][0] < time - _SPAN:
            self._points.popleft()

    def show(self) -> None:
        """Send it to the page."""
        self._handle.data = self._data()

    def _data(self) -> tuple[Array, ...]:
        if not self._points:
            return tuple(np.zeros(2) for _ in range(1 + self._count))
        return tuple(np.array(self._points, dtype=float).T.copy())
