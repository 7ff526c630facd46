"""Tables of recorded motions: values read, and refusals."""

from __future__ import annotations

import numpy as np
import pytest

from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.recorded_motion import read_recorded_motion

HEADING = "frame,time,x,y,z,rx,ry,rz\n"


def test_poses_are_relative_to_the_first_row(tmp_path):
    file = tmp_path / "motion.csv"
    rows = ("a,0,1,2,3,0,0,0.5", "b,0,0,0,0,0,0,0", "a,0.5,1,2,4,0,0,0.7")
    file.write_text(HEADING + "\n".join(rows))
    a, b = read_recorded_motion(file, 3)
    assert (a.frame, b.frame) == ("a", "b")
    np.testing.assert_array_equal(a.anchor, [1, 2, 3])
    np.testing.assert_allclose(a.path.pose(0.0).rotation, np.eye(3), atol=1e-15)
    # Both rotations are about one axis, so their angles subtract, to round-off.
    np.testing.assert_allclose(a.path.pose(0.5).rotation_vector, [0, 0, 0.2], atol=1e-14)
    np.testing.assert_allclose(a.path.pose(0.5).translation, [1, 2, 4])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "begins with the line frame,time"),
        ("frame,time,x,y,angle\n", "begins with the line frame,time,x,y,z"),
        (HEADING, "has no frames"),
        (HEADING + "a,0,1,2,3\n", "line 2: needs a frame's name and 7 numbers"),
        (HEADING + "a,0,1,2,3,0,0,north\n", "line 2"),
        (HEADING + "a,0,1,2,nan,0,0,0\n", "line 2"),
        (HEADING + "a,1,1,2,3,0,0,0\na,1,1,2,3,0,0,0\n", "times of frame 'a' must increase"),
    ],
)
def test_other_tables_are_refused(tmp_path, text, words):
    file = tmp_path / "motion.csv"
    file.write_text(text)
    with pytest.raises(SoftprintError, match=words):
        read_recorded_motion(file, 3)
