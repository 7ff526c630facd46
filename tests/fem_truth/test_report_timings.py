"""Times of steps in the report: of those in contact, without the first, where kernels may be compiled."""

from types import SimpleNamespace

import numpy as np
import pytest

from fem_truth.report.motions import timing_rows


def motion(seconds, penetration):
    return SimpleNamespace(
        penetration=np.array(penetration),
        timings={"total": np.array(seconds)},
        iterations=np.ones(len(seconds)),
        converged=np.array([True, True, True, False]),
    )


def test_the_step_in_which_something_is_compiled_does_not_count():
    slow = motion([0.0, 0.002, 5.0, 0.01], [0.0, 0.0, 1e-3, 1e-3])
    bare = motion([0.0, 0.002, 0.004, 0.004], [0.0, 0.0, 1e-3, 1e-3])
    rows = timing_rows({"bare": [bare], "ours": [slow]})
    assert rows["ours"]["step"] == pytest.approx(0.01)
    assert (rows["ours"]["steps"], rows["ours"]["converged"]) == (1, 0.0)
    assert rows["ours"]["cost_of_bare"] == pytest.approx(2.5)


def test_the_only_step_in_contact_counts():
    once = motion([0.0, 0.002, 0.5, 0.01], [0.0, 0.0, 1e-3, 0.0])
    assert timing_rows({"ours": [once]})["ours"]["step"] == pytest.approx(0.5)


def test_a_model_that_never_touches_has_no_line():
    assert timing_rows({"ours": [motion([0.0] * 4, [0.0] * 4)]}) == {}
