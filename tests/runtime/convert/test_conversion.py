"""Which frames are converted, what is refused, and what an interrupted conversion leaves."""

from __future__ import annotations

import os
import subprocess
import sys
import weakref
from dataclasses import replace

import numpy as np
import pytest

from softprint import PenaltyContact, PlacedCollider, Recording, RigidPose, Simulator, colliders
from softprint.runtime.convert.film import FilmLook
from softprint.runtime.convert.formats import FORMATS, convert_motion, plan_conversion
from softprint.runtime.convert.frames import surface_motion
from softprint.runtime.convert.sampling import Moment, Sampling
from softprint.runtime.errors import SoftprintError
from tests.conftest import REPOSITORY

TIMES = np.arange(16) / 50  # [s]


def times(**given):
    return Sampling(**given).times(TIMES, "x.h5")


def test_all_frames_are_those_of_the_motion():
    np.testing.assert_array_equal(times(), TIMES)
    np.testing.assert_array_equal(times(every=4), TIMES[::4])


def test_a_part_has_both_its_ends():
    np.testing.assert_array_equal(times(begin=Moment(0.1), end=Moment(0.2)), TIMES[5:11])
    np.testing.assert_array_equal(times(begin=0.1, end=0.2), TIMES[5:11])
    np.testing.assert_array_equal(times(begin=Moment(5, True), end=Moment(10, True)), TIMES[5:11])
    np.testing.assert_array_equal(times(begin=Moment(5, True), every=5), TIMES[5::5])


def test_a_rate_of_ones_own_covers_the_motion():
    np.testing.assert_allclose(times(rate=30.0), np.arange(10) / 30)
    np.testing.assert_allclose(times(rate=20.0, begin=Moment(0.1)), 0.1 + np.arange(5) / 20)
    assert len(times(rate=50.0)) == 16  # the last frame is not lost to rounding


@pytest.mark.parametrize(
    ("text", "moment"),
    [("0.5", (0.5, False)), ("1.5s", (1.5, False)), ("30f", (30, True)), (" 0F ", (0, True))],
)
def test_moments_are_seconds_or_frames(text, moment):
    assert Moment.parse(text) == moment


@pytest.mark.parametrize("text", ["", "f", "-1", "nan", "inf", "1.5f", "1 2", "-3f"])
def test_other_moments_are_refused(text):
    with pytest.raises(ValueError, match=r"."):
        Moment.parse(text)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"begin": Moment(0.31)}, "0.31 s is not in the motion, which lasts from 0 to 0.3 s"),
        ({"end": Moment(16, True)}, "no frame 16; they are numbered 0 to 15"),
        ({"begin": Moment(0.2), "end": Moment(0.1)}, "the end, 0.1 s, is before the beginning, 0.2 s"),
        ({"begin": Moment(0.101), "end": Moment(0.109)}, "has no frame from 0.101 to 0.109 s"),
        ({"every": 0}, "--every must be 1 or more"),
        ({"every": 2, "rate": 10.0}, "--rate and --every exclude each other"),
        ({"rate": 0.0}, "--rate is in frames a second"),
        ({"rate": float("nan")}, "--rate is in frames a second"),
    ],
)
def test_frames_that_are_not_there_are_refused(given, message):
    with pytest.raises(SoftprintError, match=message):
        times(**given)


def test_in_between_frames_lie_on_straight_lines(motion):
    surface = surface_motion(motion, Sampling(rate=100.0))
    assert len(surface) == 31
    frames = list(surface.frames())
    for k in (0, 4, 13):
        early, middle, late = frames[2 * k : 2 * k + 3]
        np.testing.assert_array_equal(early.points, motion.positions(k)[surface.nodes])
        np.testing.assert_allclose(middle.points, 0.5 * (early.points + late.points), atol=1e-15)
        for name, pose in middle.poses.items():
            own = motion.colliders[name].poses
            middle_of = 0.5 * (own[k].translation + own[k + 1].translation)
            np.testing.assert_allclose(pose.translation, middle_of, atol=1e-15)


def test_the_extent_holds_every_frame(motion):
    surface = surface_motion(motion)
    seen = surface.extent.outermost
    for frame in surface.frames():
        placed = [pose.apply(surface.solids[name][0]) for name, pose in frame.poses.items()]
        points = np.concatenate([frame.points, *placed])
        assert (points >= seen.min(axis=0) - 1e-12).all()
        assert (points <= seen.max(axis=0) + 1e-12).all()


def test_a_simulation_that_broke_down_is_named(motion, tmp_path):
    class Broken:
        label, rest, contact, times = "broken.h5", motion.rest, motion.contact, motion.times
        poses, build_colliders = motion.poses, motion.build_colliders

        def positions(self, frame):
            return motion.positions(frame) * (np.nan if frame == 9 else 1.0)

    with pytest.raises(SoftprintError, match=r"broken.h5: frame 9 has positions that are no numbers"):
        convert_motion(Broken(), tmp_path / "press.glb", Sampling(every=1))
    assert list(tmp_path.iterdir()) == []
    convert_motion(Broken(), tmp_path / "press.glb", Sampling(end=Moment(8, True), every=1))


@pytest.mark.parametrize("ending", [".pc2", ".glb", ".obj", ".usda"])
def test_few_frames_are_in_memory_at_a_time(ending, motion, tmp_path):
    """Counts the arrays of positions that are alive whenever another one is read."""
    alive, most = weakref.WeakSet(), []

    class Counted(np.ndarray):
        """An array that a weak set can hold."""

        __hash__ = object.__hash__

    class Long:
        label, rest, contact = "long", motion.rest, motion.contact
        times = np.arange(100) / 50

        def positions(self, frame):
            found = motion.positions(frame % 16).view(Counted)
            alive.add(found)
            most.append(len(alive))
            return found

        def poses(self):
            return {name: 7 * track.poses for name, track in motion.colliders.items()}

        def build_colliders(self):
            return motion.build_colliders()

    convert_motion(Long(), tmp_path / f"long{ending}", Sampling(every=1))
    assert len(most) >= 100
    assert max(most) <= 3


@pytest.mark.parametrize("ending", sorted(FORMATS))
def test_an_interrupted_conversion_leaves_what_was_there(ending, motion, tmp_path):
    kept = {f"press{ending}": b"earlier", "press_0001.obj": b"# Softprint: earlier", "press.bin": b"earlier"}
    for name, content in kept.items():
        (tmp_path / name).write_bytes(content)

    small = FilmLook(width=64) if FORMATS[ending].film else None

    def interrupt(done):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        plan_conversion(motion, tmp_path / f"press{ending}", Sampling(every=4), look=small).write(interrupt)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == kept


KILLED = """
import os, signal, sys
from softprint import load_motion
from softprint.runtime.convert.formats import plan_conversion
plan_conversion(load_motion(sys.argv[1]), sys.argv[2]).write(lambda n: os.kill(os.getpid(), signal.SIGKILL))
"""


@pytest.mark.parametrize("ending", [".glb", ".obj"])
def test_the_next_conversion_removes_what_a_killed_one_left(ending, motion3d, tmp_path):
    out = tmp_path / f"press{ending}"
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    command = [sys.executable, "-c", KILLED, str(motion3d.path), str(out)]
    assert subprocess.run(command, env=environment, check=False, timeout=120).returncode == -9
    left = {path.name for path in tmp_path.iterdir()}
    assert all(name.startswith(".press.") for name in left)
    convert_motion(motion3d, out, Sampling(every=8))
    assert not {path.name for path in tmp_path.iterdir()} & left


@pytest.mark.parametrize("ending", sorted(FORMATS))
def test_a_file_that_cannot_be_written_is_an_error_of_one_sentence(ending, motion3d, tmp_path):
    (tmp_path / "taken").write_text("a file, not a folder")
    with pytest.raises(SoftprintError, match="taken"):
        convert_motion(motion3d, tmp_path / "taken" / f"press{ending}", Sampling(every=8))


def test_names_without_a_format_and_colours_without_room_are_refused(motion, tmp_path):
    with pytest.raises(SoftprintError, match=r"press.fbx: motions are converted to .glb, .gltf"):
        convert_motion(motion, tmp_path / "press.fbx")
    with pytest.raises(SoftprintError, match="a sequence of OBJ files has no colours"):
        convert_motion(motion, tmp_path / "press.obj", colour="pressure")
    with pytest.raises(SoftprintError, match="there is no colour 'red'; the colours: none"):
        convert_motion(motion, tmp_path / "press.glb", colour="red")


def test_a_missing_package_is_named(motion, tmp_path, monkeypatch):
    monkeypatch.setattr("softprint.runtime.convert.formats.find_spec", lambda name: None)
    with pytest.raises(SoftprintError, match="needs the package pxr: pip install"):
        convert_motion(motion, tmp_path / "press.usda")


def test_a_collider_whose_file_is_gone_can_be_left_out(motion3d, tmp_path):
    lost = replace(motion3d, collider_tables=motion3d.collider_tables.replace("ball.stl", "gone.stl"))
    with pytest.raises(SoftprintError, match="one of its colliders cannot be built"):
        convert_motion(lost, tmp_path / "press.glb")
    assert convert_motion(lost, tmp_path / "press.glb", with_colliders=False) == [tmp_path / "press.glb"]


def test_planes_have_no_surface(jelly_body, tmp_path):
    dim = jelly_body.dim
    floor = colliders.Plane(np.eye(dim)[-1], 0.0)
    simulator = Simulator(jelly_body, [PlacedCollider("floor", floor)], contact=PenaltyContact(1e9))
    recording = Recording(simulator)
    recording.add(simulator.rest_state(poses={"floor": RigidPose.identity(dim)}))
    assert surface_motion(recording).solids == {}
    convert_motion(recording, tmp_path / "floor.glb")


def test_what_is_no_state_of_the_simulator_is_not_recorded(jelly2d_body):
    ball = PlacedCollider("ball", colliders.Sphere(0.02, 2, "ball"))
    law, poses = PenaltyContact(1e10), {"ball": RigidPose.identity(2)}
    simulator, other = (Simulator(jelly2d_body, own, contact=law) for own in ([ball], []))
    recording = Recording(simulator)
    for thing, told in [
        (simulator.step(simulator.rest_state(poses=poses), poses), "give result.state"),
        (other.rest_state(), "no state of the recorded simulator, whose colliders are ball"),
        (None, "no state of the recorded simulator"),
    ]:
        with pytest.raises(SoftprintError, match=told):
            recording.add(thing)
    assert len(recording) == 0


def test_a_recording_is_shown_and_converted_as_a_motion(jelly_body, tmp_path):
    dim = jelly_body.dim
    ball = PlacedCollider("ball", colliders.Sphere(0.02, dim, "ball"))
    simulator = Simulator(jelly_body, [ball], contact=PenaltyContact(1e10))
    recording = Recording(simulator, "press")
    with pytest.raises(SoftprintError, match="press: nothing has been recorded"):
        recording.show()
    places = [np.append(np.zeros(dim - 1), z) for z in (0.085, 0.082)]
    for k, place in enumerate(places):
        state = simulator.rest_state(0.1 * k, {"ball": RigidPose(np.eye(dim), place)})
        recording.add(state)
    with pytest.raises(SoftprintError, match=r"at 0.1 s is not later"):
        recording.add(state)
    assert len(recording) == 2
    frames = list(surface_motion(recording).frames())
    np.testing.assert_allclose(frames[1].poses["ball"].translation, places[1])
    np.testing.assert_allclose(
        frames[0].points, surface_motion(recording).rest, atol=1e-8
    )  # float32 of 0.1 m
    assert convert_motion(recording, tmp_path / "press.pc2")
    assert recording.show(width=120)._repr_png_()
