"""Timings of the phases of a step."""

from __future__ import annotations

from time import perf_counter
from typing import Self

PHASES = ("positions", "elastic", "contact", "correction", "solve")


class Phase:
    """A stopwatch that may be entered many times; ``seconds`` is the sum."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def __enter__(self) -> Self:
        self._start = perf_counter()
        return self

    def __exit__(self, *exception: object) -> None:
        self.seconds += perf_counter() - self._start


class Timings:
    """One stopwatch for each of `PHASES`; everything else a step does counts in its total only."""

    def __init__(self) -> None:
        self._start = perf_counter()
        self.positions = Phase()
        self.elastic = Phase()
        self.contact = Phase()
        self.correction = Phase()
        self.solve = Phase()

    def seconds(self) -> dict[str, float]:
        """Seconds in each phase so far, and in ``total``."""
        phases = {name: getattr(self, name).seconds for name in PHASES}
        return {**phases, "total": perf_counter() - self._start}
