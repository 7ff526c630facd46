"""Motion and truth files in the window, and what cannot be played."""

from __future__ import annotations

import numpy as np
import pytest

from softprint.runtime.cli.main import main
from softprint.runtime.errors import SoftprintError
from softprint.runtime.scenes.motion_file import load_motion
from softprint.runtime.viewer.page.palette import Scale, colours, rounded_up
from softprint.runtime.viewer.playback.page import PlaybackPage, read_reels
from softprint.runtime.viewer.playback.reel import DIFFERENCE, DISPLACEMENT, STRAIN


@pytest.fixture(scope="module")
def motions(toy3d):
    """The held-out scene of the toy, played by two models."""
    assert (
        main(
            [
                "simulate",
                str(toy3d.experiment),
                "--out",
                str(toy3d.out),
                "--model",
                "bare",
                "--model",
                "ours",
                "--quiet",
            ]
        )
        == 0
    )
    return [toy3d.out / "motions" / f"held_out_{model}.h5" for model in ("bare", "ours")]


def test_a_reel_shows_what_the_file_contains(motions):
    (reel,) = read_reels(motions[:1])
    motion = load_motion(motions[0])
    assert reel.count == motion.n_frames
    still = reel.still(7)
    assert np.array_equal(still.positions, motion.positions(7))
    assert np.array_equal(still.poses["ball"].translation, motion.colliders["ball"].poses[7].translation)
    moved = motion.positions(7)[reel.rest.surface_nodes] - reel.rest.points[reel.rest.surface_nodes]
    assert np.allclose(reel.values(7, still, DISPLACEMENT), 1e3 * np.linalg.norm(moved, axis=1))


def test_strain_of_a_homogeneous_stretch(motions):
    """x = (1 + e) X has the Green strain (e + e^2 / 2) I, whose norm is that times sqrt(3)."""
    (reel,) = read_reels(motions[:1])
    stretched = reel.still(0)
    object.__setattr__(stretched, "positions", 1.1 * reel.rest.points)
    assert np.allclose(reel.values(0, stretched, STRAIN), np.sqrt(3.0) * (0.1 + 0.005), rtol=1e-9)


def test_motions_play_beside_each_other(motions):
    page = PlaybackPage(read_reels(motions), 0)
    try:
        page.tick(0.1)
        assert page.at == pytest.approx(0.1)
        bare, ours = page._views
        assert bare.offset[0] == 0.0 < ours.offset[0]
        assert not np.allclose(bare.mesh.vertices, ours.mesh.vertices)
        page._quantity.value = DIFFERENCE
        page.tick(0.1)
        assert "held_out" not in page._status.content
        assert "bare" in page._status.content
        # At the end it begins again, or stops.
        page.tick(page.end)
        assert page.at == 0.0
        page._again.value = False
        page.tick(2.0 * page.end)
        page.tick(0.1)
        assert page.at == page.end
    finally:
        page.close()


def test_samples_of_a_truth_file(toy3d, tmp_path):
    from softprint.runtime.body import load_body
    from softprint.runtime.viewer.playback.truth_reel import TruthReel
    from tests.toy_truth import write_truth

    truth = tmp_path / "truth.h5"
    write_truth(truth, load_body(toy3d.out / "body.h5"))
    reel = TruthReel(truth, toy3d.experiment)
    assert reel.count == 5  # one of its six samples has failed
    still = reel.still(0)
    assert still.poses
    for quantity in reel.quantities:
        values = reel.values(0, still, quantity)
        assert len(values) == len(reel.rest.surface_nodes if reel.rest.dim == 3 else reel.rest.points)
    page = PlaybackPage([reel], 0)
    try:
        page.tick(0.0)
        assert "sample" in page._status.content
    finally:
        page.close()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["{motion}", "{experiment}"], "one experiment at a time"),
        (["{experiment}", "--port", "99999"], "0 to 65535"),
        (["{experiment}", "--scene", "nothing"], "no scene 'nothing'"),
        (["{experiment}", "--model", "theirs"], "no model 'theirs'"),
        (["{motion}", "--scene", "held_out"], "belongs to an experiment"),
        (["{motion}", "--set", "dynamics.max_iterations=2"], "belongs to an experiment"),
        (["{body}"], "plays motion files and truth files"),
        (["{missing}"], "no such file"),
        (["{missing_toml}"], "no such experiment"),
        (["{motion}"] * 7, "at most 6"),
    ],
)
def test_what_cannot_be_shown_is_one_sentence(toy3d, motions, tmp_path, capsys, arguments, sentence):
    known = {
        "motion": motions[0],
        "experiment": toy3d.experiment,
        "body": toy3d.out / "body.h5",
        "missing": tmp_path / "missing.h5",
        "missing_toml": tmp_path / "missing.toml",
    }
    out = ["--out", str(toy3d.out)] if "{experiment}" in arguments and len(arguments) != 2 else []
    status = main(["view", *(own.format(**known) for own in arguments), *out, "--no-open", "--quiet"])
    said = capsys.readouterr().err
    assert status == 1
    assert sentence in said
    assert "Traceback" not in said


def test_a_port_in_use_is_said_before_any_work(toy3d, tmp_path, capsys):
    from softprint.runtime.viewer.page.server import bound_socket

    with bound_socket(0) as taken:
        port = str(taken.getsockname()[1])
        out = tmp_path / "new"
        assert main(["view", str(toy3d.experiment), "--out", str(out), "--port", port, "--no-open"]) == 1
    assert "cannot be used" in capsys.readouterr().err
    assert not (out / "body.h5").exists()


def test_an_experiment_without_scenes_says_what_is_missing(toy3d, tmp_path):
    from softprint.runtime.experiment import load_experiment
    from softprint.runtime.viewer.live import the_scene

    text = toy3d.experiment.read_text()
    bare = toy3d.experiment.with_name("no_scenes.toml")
    bare.write_text(text[: text.index("[[scenes]]")])
    with pytest.raises(SoftprintError, match="scenes"):
        the_scene(load_experiment(bare), None)


def test_colours_go_from_the_lowest_to_the_highest_and_none_is_the_bodys():
    from softprint.runtime.drawing.colours import BODY, ERROR_COLOURS
    from softprint.runtime.viewer.page.palette import rgb

    found = colours(np.array([0.0, 2.0, 9.0, np.nan]), 2.0)
    assert tuple(found[0]) == rgb(ERROR_COLOURS[0])
    assert tuple(found[1]) == tuple(found[2]) == rgb(ERROR_COLOURS[-1])
    assert tuple(found[3]) == rgb(BODY)


def test_the_end_of_a_scale_is_round_and_falls_slowly():
    assert [rounded_up(x) for x in (0.3, 1.0, 1.01, 7.0)] == pytest.approx([0.5, 1.0, 2.0, 10.0])
    scale = Scale()
    assert scale.fit(DISPLACEMENT, np.full(9, 3.0), 0.0) == pytest.approx(5.0)
    assert scale.fit(DISPLACEMENT, np.full(9, 0.1), 0.1) == pytest.approx(5.0)
    assert scale.fit(DISPLACEMENT, np.full(9, 0.1), 60.0) == pytest.approx(0.1)
    assert scale.fit(DISPLACEMENT, np.full(9, np.nan), 0.1) > 0.0
