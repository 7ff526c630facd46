"""Surfaces drawn by a second process, from a process with PETSc, which treats signals as errors."""

import numpy as np
import pytest
from petsc4py import PETSc

from softprint.runtime.errors import SoftprintError
from softprint.runtime.scenes.background_drawing import BackgroundDrawing


class Doubled:
    """Draws twice the state."""

    def surface_snapshot(self, state):
        return state

    def surface_drawn(self, snapshot):
        return 2.0 * snapshot


def test_a_killed_drawing_process_does_not_end_this_one():
    assert PETSc.COMM_WORLD.size == 1
    state = np.arange(6.0).reshape(2, 3)
    with BackgroundDrawing(Doubled()) as drawer:
        assert drawer.next(state) is None
        np.testing.assert_array_equal(drawer.next(3.0 * state), 2.0 * state)
        np.testing.assert_array_equal(drawer.last(), 6.0 * state)
        drawer._process.kill()
        drawer._process.join()
        with pytest.raises(SoftprintError, match="has ended"):
            drawer.next(state)
