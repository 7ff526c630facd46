"""What reports say about scenes that no static model can follow, and about scenes without contact."""

from types import SimpleNamespace

import numpy as np
import pytest

from softprint.fem_truth.report.measurements.comparison import measure_frame
from softprint.fem_truth.report.scene_notes import scene_note


def with_statics(share):
    """The comparison of a scene in which the static solution leaves this share of the bare error."""
    bare, full = np.zeros((4, 2)), np.ones((4, 2))
    found = full + share * (bare - full)
    frames = measure_frame(0, found, bare, full, np.ones(4, dtype=bool), np.zeros(1), 0)
    return SimpleNamespace(solved={"statics": frames})


@pytest.mark.parametrize(("share", "said"), [(0.0, False), (0.05, False), (0.48, True)])
def test_the_floor_of_every_correction_is_told(share, said):
    note = scene_note("press", with_statics(share), 0)
    assert bool(note) == said
    assert not said or "leaves 48% of the bare error" in note


def test_a_scene_without_contact_says_why():
    assert "never touches" in scene_note("press", None, 0)
    assert "pierced" in scene_note("press", None, 3)


def test_without_full_space_solves_there_is_nothing_to_tell():
    assert scene_note("press", SimpleNamespace(solved={}), 0) == ""
