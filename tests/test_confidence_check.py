"""Promised errors: found again where they hold, and never negative."""

import numpy as np
import pytest

from reproduction.confidence_check import Frames, calibrated, promised


def frames(t, squared):
    return Frames("some", np.asarray(t), {"ours": np.asarray(squared)})


def test_errors_that_are_as_promised_are_found_again():
    t = np.linspace(0.0, 1.0, 9)
    exact = promised(t, (0.1, 0.4))
    assert exact[0] == pytest.approx(0.4)
    assert exact[-1] == pytest.approx(0.1)
    assert (np.diff(exact) < 0.0).all()
    found = calibrated([frames(t[:4], exact[:4] ** 2), frames(t[4:], exact[4:] ** 2)], "ours")
    assert found == pytest.approx((0.1, 0.4))


def test_no_error_is_promised_below_nothing():
    """Frames that are right where the model is least sure."""
    sure, unsure = calibrated([frames([0.5, 1.0], [0.0, 0.09])], "ours")
    assert unsure == 0.0
    assert sure > 0.0


def test_some_of_the_frames():
    some = frames([0.2, 0.9], [0.16, 0.01]).of(np.array([False, True]))
    assert some.confidence.tolist() == [0.9]
    assert some.squared["ours"].tolist() == [0.01]
