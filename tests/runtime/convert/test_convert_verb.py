"""`softprint convert` from the command line."""

from __future__ import annotations

import pytest
from PIL import Image

from tests.runtime.convert.gltf_reader import Gltf


def test_a_motion_is_converted(softprint_here, motion3d, tmp_path):
    result = softprint_here(
        "convert", motion3d.path, "out/press.glb", "--from", "5f", "--to", "0.2", "--every", "1"
    )
    assert result.returncode == 0, result.stderr
    assert "out/press.glb: glTF 2.0 with morph targets, 6 frames at 50 a second" in result.stdout
    assert len(Gltf(tmp_path / "out" / "press.glb").primitive("body")["targets"]) == 6


def test_a_film_is_drawn(softprint_here, motion3d, tmp_path):
    result = softprint_here(
        "convert", motion3d.path, "press.gif", "--rate", "10", "--colour", "pressure", "--width", "200"
    )
    assert result.returncode == 0, result.stderr
    picture = Image.open(tmp_path / "press.gif")
    assert (picture.n_frames, picture.size) == (4, (200, 150))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("MOTION", "press.fbx"), "press.fbx: motions are converted to .glb"),
        (("MOTION", "press"), "press: motions are converted to .glb"),
        (("MOTION", "a.glb", "--from", "late"), "--from late: this is neither a time in seconds"),
        (("MOTION", "a.gif", "--cut", "here"), "--cut here: this is no plane; one is an axis"),
        (("MOTION", "a.obj", "--width", "100"), "a sequence of OBJ files is no film"),
        (("MOTION", "a.glb", "--to", "99f"), "no frame 99; they are numbered 0 to 15"),
        (("none.h5", "a.glb"), "none.h5: there is no such motion file; `softprint simulate` makes one"),
        (("BODY", "a.glb"), "this is a body file; a motion file was expected"),
        (("MOTION", "a.pc2", "--colour", "displacement"), "has no colours"),
    ],
)
def test_bad_input_is_one_sentence(softprint_here, motion3d, tmp_path, arguments, message):
    stand_ins = {"MOTION": motion3d.path, "BODY": motion3d.path.parent.parent / "body.h5"}
    result = softprint_here("convert", *(stand_ins.get(word, word) for word in arguments))
    assert result.returncode == 1
    assert message in result.stderr
    assert "Traceback" not in result.stderr
    assert list(tmp_path.iterdir()) == []
