"""Times of steps in the report: of steps in contact, without the first ones, in which kernels may be compiled."""

from types import SimpleNamespace

import numpy as np
import pytest

from softprint.fem_truth.report.measurements.motions import timing_rows
from softprint.runtime.scenes.speed import WARM


def motion(seconds, penetration):
    return SimpleNamespace(
        colliders=("ball",),
        in_contact=np.array(penetration) > 0,
        timings={"total": np.array(seconds)},
        iterations=np.ones(len(seconds)),
        converged=np.array([True, True, True, False]),
    )


def test_a_step_with_compilation_does_not_count():
    slow = motion([0.0, 0.002, 5.0, 0.01], [0.0, 0.0, 1e-3, 1e-3])
    bare = motion([0.0, 0.002, 0.004, 0.004], [0.0, 0.0, 1e-3, 1e-3])
    rows = timing_rows({"bare": [bare], "ours": [slow]})
    assert rows["ours"]["step"] == pytest.approx(0.01)
    assert (rows["ours"]["steps"], rows["ours"]["converged"]) == (1, 0.0)
    assert rows["ours"]["cost_of_bare"] == pytest.approx(2.5)


def test_the_only_step_in_contact_counts():
    once = motion([0.0, 0.002, 0.5, 0.01], [0.0, 0.0, 1e-3, 0.0])
    assert timing_rows({"ours": [once]})["ours"]["step"] == pytest.approx(0.5)


def test_slow_steps_show_in_the_95th_percentile_and_not_in_the_median():
    seconds = [0.0] + WARM * [1.0] + 8 * [0.002] + 2 * [0.02]  # the first ones in contact do not count
    n = len(seconds)
    long = SimpleNamespace(
        colliders=("ball",),
        in_contact=np.arange(n) > 0,
        timings={"total": np.array(seconds)},
        iterations=np.ones(n),
        converged=np.ones(n, dtype=bool),
    )
    row = timing_rows({"ours": [long]})["ours"]
    assert row["step"] == pytest.approx((8 * 0.002 + 2 * 0.02) / 10)
    assert row["median"] == pytest.approx(0.002)
    assert row["p95"] == pytest.approx(0.02)


def test_a_model_that_never_touches_has_no_line():
    assert timing_rows({"ours": [motion([0.0] * 4, [0.0] * 4)]}) == {}
