"""The pace that the window shows is that of the steps, slow ones included."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from softprint.runtime.viewer.processes import clock as module
from softprint.runtime.viewer.processes.clock import Clock

STEP = 1.0 / 60.0


@pytest.mark.parametrize("cost", [0.01, 0.4, 3.0])  # s: real time, slower, and slower than the window of the mean
def test_the_pace_is_that_of_the_steps(monkeypatch, cost):
    now = [0.0]
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: now[0]))
    clock = Clock(STEP)
    for _ in range(12):
        now[0] += cost
        clock.stepped(cost, speed=1.0)
    assert clock.pace.steps == pytest.approx(1.0 / cost)
    assert clock.pace.cost == pytest.approx(cost)
    assert clock.pace.real == pytest.approx(STEP / cost)
