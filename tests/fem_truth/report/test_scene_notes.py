"""What reports say about scenes that no static model can follow, and about scenes without contact."""

from types import SimpleNamespace

import numpy as np
import pytest

from softprint.fem_truth.report.assemble import JudgedScene
from softprint.fem_truth.report.measurements.comparison import measure_frame
from softprint.fem_truth.report.scene_notes import scene_notes


def judged(comparison, n_left_out=0):
    return JudgedScene("press", None, comparison, {}, n_left_out)


def with_statics(share):
    """A scene in which the static solution leaves this share of the bare error."""
    bare, full = np.zeros((4, 2)), np.ones((4, 2))
    found = full + share * (bare - full)
    frames = measure_frame(0, found, bare, full, np.ones(4, dtype=bool), np.zeros(1), 0)
    return judged(SimpleNamespace(solved={"statics": frames}))


@pytest.mark.parametrize(("share", "said"), [(0.0, False), (0.05, False), (0.48, True)])
def test_the_floor_of_every_correction_is_told(share, said):
    notes = scene_notes([with_statics(share)])
    assert len(notes) == said
    assert not said or "leaves 48% of the bare error" in notes[0]


def test_a_scene_without_contact_says_why():
    (never,) = scene_notes([judged(None)])
    assert "never touches" in never
    (pierced,) = scene_notes([judged(None, n_left_out=3)])
    assert "pierced" in pierced


def test_without_full_space_solves_there_is_nothing_to_tell():
    assert scene_notes([judged(SimpleNamespace(solved={}))]) == []
