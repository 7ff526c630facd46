"""Which times of a motion are converted: a part of it, every nth frame, or a rate of one's own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.errors import SoftprintError

# Frames a second at most: a film of more is a mistake in the unit.
_HIGHEST_RATE = 10_000.0


class Moment(NamedTuple):
    """A time of a motion: `value` seconds, or the number of a frame."""

    value: float
    is_frame: bool = False

    @classmethod
    def parse(cls, text: str) -> Moment:
        """`1.5` or `1.5s` in seconds; `30f` is frame 30. Raises ValueError."""
        number = text.strip().lower()
        is_frame = number.endswith("f")
        value = float(int(number[:-1])) if is_frame else float(number.removesuffix("s"))
        if not np.isfinite(value) or value < 0:
            raise ValueError(text)
        return cls(value, is_frame)

    def __str__(self) -> str:
        return f"frame {self.value:.0f}" if self.is_frame else f"{self.value:g} s"


@dataclass(frozen=True)
class Sampling:
    """begin, end: the part of the motion, both included, all of it by default, in seconds if they are numbers; every:
    only each nth of its frames; rate: frames a second, in between those of the motion, instead."""

    begin: Moment | float | None = None
    end: Moment | float | None = None
    every: int | None = None
    rate: float | None = None

    def times(self, stored: Array, label: str) -> Array:
        """(n,) the times [s] to convert, of a motion with frames at the times stored (F,)."""
        first = float(stored[0]) if self.begin is None else self._within(_moment(self.begin), stored, label)
        last = float(stored[-1]) if self.end is None else self._within(_moment(self.end), stored, label)
        slack = 1e-9 * max(abs(float(stored[-1])), 1.0)
        if last < first:
            raise SoftprintError(f"{label}: the end, {self.end}, is before the beginning, {self.begin}")
        if self.every is not None and self.every < 1:
            raise SoftprintError(f"--every must be 1 or more, not {self.every}")
        if self.rate is None:
            chosen = stored[(stored >= first - slack) & (stored <= last + slack)][:: self.every or 1]
            if not len(chosen):
                raise SoftprintError(
                    f"{label}: has no frame from {first:g} to {last:g} s: choose more of it, or a --rate"
                )
            return chosen
        if self.every is not None:
            raise SoftprintError("--rate and --every exclude each other: give one of them")
        if not 0 < self.rate <= _HIGHEST_RATE:
            raise SoftprintError(
                f"--rate is in frames a second, above 0 and up to {_HIGHEST_RATE:.0f}, not {self.rate:g}"
            )
        count = int(np.floor((last - first) * self.rate + 1e-6)) + 1
        return first + np.arange(count) / self.rate

    def _within(self, moment: Moment, stored: Array, label: str) -> float:
        if moment.is_frame:
            if moment.value >= len(stored):
                raise SoftprintError(
                    f"{label}: no frame {moment.value:.0f}; they are numbered 0 to {len(stored) - 1}"
                )
            return float(stored[int(moment.value)])
        slack = 1e-9 * max(abs(float(stored[-1])), 1.0)
        if not stored[0] - slack <= moment.value <= stored[-1] + slack:
            raise SoftprintError(
                f"{label}: {moment.value:g} s is not in the motion, which lasts from {stored[0]:g} to {stored[-1]:g} s"
            )
        return float(np.clip(moment.value, stored[0], stored[-1]))


def _moment(given: Moment | float) -> Moment:
    return given if isinstance(given, Moment) else Moment(float(given))
