"""GIF and MP4: number of frames, duration, what is drawn; and pictures in notebooks."""

from __future__ import annotations

import io
from itertools import pairwise

import av
import numpy as np
import pytest
from PIL import Image

from softprint.runtime.convert.film import FilmLook
from softprint.runtime.convert.formats import convert_motion
from softprint.runtime.convert.sampling import Moment, Sampling
from softprint.runtime.drawing.film.rest_grid import RestGrid
from softprint.runtime.drawing.film.subject import Cut
from softprint.runtime.errors import SoftprintError

WARM, COOL = np.array([229, 138, 107]), np.array([81, 97, 124])  # body and collider


def gif_frames(source):
    """Pixels (h, w, 3) and seconds of every frame."""
    image = Image.open(source)
    found = []
    for number in range(image.n_frames):
        image.seek(number)
        found.append((np.asarray(image.convert("RGB")).astype(int), image.info["duration"] / 1000))
    assert image.info["loop"] == 0  # for ever
    return found


def share_like(pixels, colour, tolerance=60):
    return float((np.abs(pixels - colour).max(axis=2) < tolerance).mean())


@pytest.fixture(scope="module")
def whole_gif(motion, tmp_path_factory):
    """The frames of the motion as it is converted by default."""
    path = tmp_path_factory.mktemp("film") / "press.gif"
    convert_motion(motion, path)
    return gif_frames(path)


def test_a_gif_shows_the_motion_at_its_speed(whole_gif):
    frames = whole_gif
    assert len(frames) == 10  # 0.3 s at 30 a second, and the first
    # In whole hundredths of a second.
    assert sum(seconds for _, seconds in frames) == pytest.approx(10 / 30, abs=0.01)
    assert frames[0][0].shape == (480, 640, 3)
    assert all(np.abs(one - other).max() > 20 for (one, _), (other, _) in pairwise(frames))
    for pixels, _ in frames:
        assert (pixels[[0, 0, -1, -1], [0, -1, 0, -1]] == 255).all()  # white to the corners
        assert share_like(pixels, WARM) > 0.1


def test_the_camera_stays_and_nothing_leaves_the_picture(whole_gif):
    frames = np.array([pixels for pixels, _ in whole_gif])
    drawn = (frames < 250).any(axis=(0, 3))
    assert not drawn[[0, -1]].any()
    assert not drawn[:, [0, -1]].any()
    # It fills the height or the width.
    assert (
        max(np.ptp(np.flatnonzero(drawn.any(axis=1))) / 480, np.ptp(np.flatnonzero(drawn.any(axis=0))) / 640)
        > 0.85
    )
    # What is held below does not move: the lowest rows are the same in all frames.
    lowest = np.flatnonzero(drawn.any(axis=1))[-12:]
    assert np.ptp(frames[:, lowest], axis=0).max() < 25  # palettes and blending


def test_coloured_and_plain_films_differ(motion3d, tmp_path):
    for colour in ("none", "displacement"):
        convert_motion(motion3d, tmp_path / f"{colour}.gif", Sampling(every=15), colour=colour)
    plain, coloured = (gif_frames(tmp_path / f"{c}.gif")[-1][0] for c in ("none", "displacement"))
    assert share_like(plain, WARM) > 0.1
    assert np.abs(plain - coloured).mean() > 10
    assert share_like(coloured[-60:], np.array([63, 15, 88]), 20) > 0.001  # the end of the scale below


def test_colliders_can_be_left_out(motion, tmp_path):
    for name, with_colliders in (("with", True), ("without", False)):
        convert_motion(motion, tmp_path / f"{name}.gif", Sampling(every=15), with_colliders=with_colliders)
    shown, alone = (gif_frames(tmp_path / f"{name}.gif")[0][0] for name in ("with", "without"))
    bluish = [float((frame[..., 2] > frame[..., 0] + 5).mean()) for frame in (shown, alone)]
    assert bluish[0] > 0.01
    assert bluish[1] < 0.001


def test_a_body_is_cut_open(motion3d, tmp_path):
    last = Sampling(Moment(15, True))
    for name, cut in (("whole", None), ("open", Cut(1, 0.0))):
        convert_motion(motion3d, tmp_path / f"{name}.gif", last, look=FilmLook(width=320, cut=cut))
    whole, cut_open = (gif_frames(tmp_path / f"{name}.gif")[0][0] for name in ("whole", "open"))
    section = np.array([240, 179, 154])
    assert share_like(cut_open, section, 8) > 0.1
    assert share_like(whole, section, 8) < 0.02
    assert (cut_open < 250).any(axis=2).mean() < (whole < 250).any(axis=2).mean()  # half is taken away


def test_a_look_that_cannot_be_is_refused(motion, tmp_path):
    with pytest.raises(SoftprintError, match="--width must be from 64 to 4096 pixels, not 8"):
        convert_motion(motion, tmp_path / "press.gif", look=FilmLook(width=8))
    with pytest.raises(SoftprintError, match="is no film: leave out --width"):
        convert_motion(motion, tmp_path / "press.glb", look=FilmLook(width=320))
    if motion.rest.dim == 2:
        with pytest.raises(SoftprintError, match="is in 2D, where nothing is cut open"):
            convert_motion(motion, tmp_path / "press.gif", look=FilmLook(cut=Cut(1, 0.0)))
    else:
        with pytest.raises(SoftprintError, match=r"--cut y=5: the plane misses the body, .* from -0.05 to 0.05 m"):
            convert_motion(motion, tmp_path / "press.gif", look=FilmLook(cut=Cut(1, 5.0)))
    for text in ("y", "w=1", "y=", "y=nan", "0.01", "=1"):
        with pytest.raises(ValueError, match=r"."):
            Cut.parse(text)
    assert Cut.parse(" z = -0.5") == (2, -0.5)


def test_an_mp4_has_every_frame_and_the_rate(motion, tmp_path):
    convert_motion(motion, tmp_path / "press.mp4", Sampling(rate=20.0))
    with av.open(str(tmp_path / "press.mp4")) as container:
        stream = container.streams.video[0]
        frames = [frame.to_ndarray(format="rgb24").astype(int) for frame in container.decode(stream)]
        assert (stream.codec_context.name, stream.average_rate) == ("h264", 20)
        assert float(stream.duration * stream.time_base) == pytest.approx(7 / 20)
    assert len(frames) == 7
    assert frames[0].shape == (960, 1280, 3)
    assert np.abs(frames[0] - frames[-1]).max() > 60
    assert share_like(frames[-1], WARM) > 0.1
    assert frames[0][0, 0].min() > 245


def test_a_gif_faster_than_players_is_refused(motion, tmp_path):
    with pytest.raises(SoftprintError, match="60 frames a second are more than the 50 that players"):
        convert_motion(motion, tmp_path / "fast.gif", Sampling(rate=60.0))


def test_a_film_of_one_frame(motion, tmp_path):
    only = Sampling(Moment(0.1), Moment(0.1))
    for name in ("one.gif", "one.mp4"):
        convert_motion(motion, tmp_path / name, only)
    assert len(gif_frames(tmp_path / "one.gif")) == 1
    with av.open(str(tmp_path / "one.mp4")) as container:
        assert len(list(container.decode(video=0))) == 1


def test_a_notebook_shows_a_motion(motion):
    shown = motion.show(width=200)
    html = shown._repr_html_()
    assert html.startswith('<img src="data:image/gif;base64,')
    frames = gif_frames(io.BytesIO(shown.gif))
    assert len(frames) == 7  # 0.3 s at 20 a second, and the first
    assert frames[0][0].shape == (150, 200, 3)
    still = np.asarray(Image.open(io.BytesIO(shown._repr_png_())).convert("RGB"))
    assert still.shape == (150, 200, 3)
    assert "kB of GIF" in repr(shown)


def test_what_is_shown_can_be_saved(motion3d, tmp_path):
    shown = motion3d.show(width=160)
    shown.save(tmp_path / "press.gif")
    shown.still.save(tmp_path / "press.png")
    assert (tmp_path / "press.gif").read_bytes() == shown.gif
    assert (tmp_path / "press.png").read_bytes() == shown.still.png
    with pytest.raises(SoftprintError, match=r"saved as press.gif"):
        shown.save(tmp_path / "press.webp")


def test_lines_lie_at_levels_of_the_rest_position_and_move_with_the_surface():
    """On an inclined surface under an affine map, which takes straight lines to straight lines."""
    corners = np.array([[x, y, 0.3 * x] for x in (0.0, 0.1) for y in (0.0, 0.1)])
    grid = RestGrid.of(corners, np.array([[0, 2, 3], [0, 3, 1]]))
    ends = grid.points(corners)
    segments = ends.reshape(-1, 2, 3)
    assert len(segments) > 20
    assert (
        np.isclose(segments[:, 0], segments[:, 1], atol=1e-15).any(axis=1).all()
    )  # one coordinate is constant
    A, b = np.array([[1.0, 0.2, 0.1], [0.0, 0.8, -0.3], [0.4, 0.0, 1.1]]), np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(grid.points(corners @ A + b), ends @ A + b, atol=1e-14)
