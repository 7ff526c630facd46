"""Values as colours: of vertices, of contact points, and of the legend."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.drawing.colours import BODY, ERROR_COLOURS

Bytes = NDArray[np.uint8]

_LEVELS = 256


def rgb(colour: str) -> tuple[int, int, int]:
    """#rrggbb as three numbers."""
    return (int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16))


@cache
def levels() -> Bytes:
    """(256, 3) the colours from the lowest value to the highest, sRGB."""
    stops = np.array([rgb(colour) for colour in ERROR_COLOURS], dtype=float)
    at = np.linspace(0.0, len(stops) - 1.0, _LEVELS)
    channels = [np.interp(at, np.arange(len(stops)), channel) for channel in stops.T]
    return np.column_stack(channels).round().astype(np.uint8)


def colours(values: NDArray[np.floating[Any]], top: float, linear: bool = False) -> Bytes:
    """(n, 3) of values (n,) from 0 to `top`; the colour of the body where there is none (NaN). linear: for the vertices
    of a mesh, whose colours are multiplied by light."""
    table = _table(linear)
    share = np.nan_to_num(np.asarray(values, dtype=float) / max(top, 1e-30), nan=0.0)
    index = np.clip(share * (_LEVELS - 1), 0, _LEVELS - 1).astype(np.int64)
    found = table[index]
    missing = np.isnan(values)
    if missing.any():
        found[missing] = table[-1]
    return found


@cache
def _table(linear: bool) -> Bytes:
    """(257, 3) the levels, and below them the colour of the body."""
    table = np.vstack([levels(), np.array([rgb(BODY)], dtype=np.uint8)])
    if not linear:
        return table
    share = table / 255.0
    light = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.asarray((255.0 * light).round().astype(np.uint8))


# The share of the vertices whose values a scale covers: a few under a tip would leave all others pale.
_COVERED = 0.985


class Scale:
    """The upper end of a scale that covers nearly all values: at once higher where values are, and slowly lower where
    they are no longer. above: whether some values are higher."""

    def __init__(self) -> None:
        self.quantity, self.top, self.above = "", 0.0, False

    def fit(self, quantity: str, values: NDArray[np.floating[Any]], seconds: float) -> float:
        """The top of the scale for these values, so many seconds after the last ones; a round number."""
        if quantity == "confidence":
            self.above = False
            return 1.0
        if quantity != self.quantity:
            self.quantity, self.top = quantity, 0.0
        finite = values[np.isfinite(values)]
        highest = float(finite.max()) if len(finite) else 0.0
        # Of contact pressure most values are zero.
        most = float(np.quantile(finite[finite > 0.01 * highest], _COVERED)) if highest > 0 else 0.0
        self.top = max(most, self.top * float(np.exp(-seconds / 4.0)))
        top = rounded_up(self.top)
        self.above = highest > top
        return top


def rounded_up(value: float) -> float:
    """The next of ... 1, 2, 5, 10, 20, 50 ..."""
    if not (np.isfinite(value) and value > 0):
        return 1e-6
    ten = 10.0 ** np.floor(np.log10(value))
    return float(next(ten * step for step in (1.0, 2.0, 5.0, 10.0) if value <= ten * step * (1.0 + 1e-9)))
