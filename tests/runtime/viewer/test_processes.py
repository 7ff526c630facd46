"""Simulation, drawing and window in processes of their own: none waits for another, and what ends is seen."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from softprint.runtime.viewer.processes.frame_board import FrameBoard
from softprint.runtime.viewer.processes.frame_info import FrameInfo
from softprint.runtime.viewer.processes.painting_process import PaintingProcess
from softprint.runtime.viewer.processes.simulation_process import SimulationProcess
from softprint.runtime.viewer.session import commands as ask
from softprint.runtime.viewer.session.follower import Follower
from softprint.runtime.viewer.session.painting import Order

# s that anything here may take on a machine that is busy with other work.
PATIENCE = 60.0


def wait_for(what, patience: float = PATIENCE):
    """The first true value of a function."""
    end = time.monotonic() + patience
    while not (found := what()):
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.01)
    return found


def test_a_reader_sees_whole_frames_only():
    """While a writer pins frames as fast as it can, every frame that is taken is of one piece."""
    board, n, stop = FrameBoard(2000), 2000, threading.Event()

    def write():
        number = 0
        while not stop.is_set():
            number += 1
            board.publish(np.full((n, 3), number, np.float32), np.full(n, number, np.float32), number)

    writer = threading.Thread(target=write)
    writer.start()
    seen = 0
    try:
        for _ in range(300):
            picture = wait_for(partial(board.newest, seen))
            assert picture.number > seen
            assert (picture.vertices == picture.meta).all()
            assert (picture.values == picture.meta).all()
            seen = picture.number
    finally:
        stop.set()
        writer.join()


def test_what_does_not_fit_on_the_board_is_refused():
    board = FrameBoard(2)
    with pytest.raises(ValueError, match="room"):
        board.publish(np.zeros((2, 3), np.float32), np.zeros(2, np.float32), bytes(2 << 20))


class SlowPainter:
    """Takes a fifth of a second for a picture."""

    def paint(self, order):
        time.sleep(0.2)
        return np.full((1, 3), order.meta, np.float32), np.zeros(1, np.float32)

    def confidences(self, state):
        return {}


def test_a_slow_painter_holds_nobody_up_and_shows_the_newest():
    board = FrameBoard(1)
    painting = PaintingProcess(SlowPainter(), board)
    began = time.monotonic()
    for number in range(200):
        painting.show(Order(None, {}, "nothing", number))
    assert time.monotonic() - began < 5.0  # painted one by one they would take 40 s

    def last():
        painting.push()
        picture = board.newest(0)
        return picture if picture is not None and picture.meta["info"] == 199 else None

    wait_for(last)
    assert board.newest(0).number <= 4
    painting.close()


def test_a_follower_forgets_neither_rotation_nor_target(dim):
    from softprint.runtime.colliders import RigidPose

    turn = 1.0 if dim == 2 else [0.0, 0.0, 1.0]
    follower = Follower(RigidPose.identity(dim), 1.0)
    follower.target = RigidPose.from_rotation_vector(turn, np.full(dim, 0.01))
    for _ in range(200):
        pose = follower.advance(1 / 60)
    assert np.allclose(pose.rotation, follower.target.rotation)
    assert np.allclose(pose.translation, follower.target.translation)


@pytest.fixture
def simulation(toy3d):
    with SimulationProcess(toy3d.workshop()) as process:
        yield process


def info(process: SimulationProcess, board: int = 0) -> FrameInfo | None:
    picture = process.boards[board].newest(0)
    return None if picture is None else picture.meta["info"]


def press(process: SimulationProcess) -> None:
    process.send(ask.LeadCollider("ball", np.array([0.01, 0.01, 0.076])))


def test_a_press_is_drawn(simulation):
    rest = wait_for(lambda: simulation.boards[0].newest(0))
    press(simulation)
    wait_for(lambda: np.abs(simulation.boards[0].newest(0).vertices - rest.vertices).max() > 1e-3)  # m
    pressed = simulation.boards[0].newest(0)
    assert pressed.meta["info"].forces["ball"][2] > 0.5  # N
    assert pressed.meta["info"].good
    assert len(pressed.meta["info"].points)


def test_two_models_are_drawn_on_two_boards(simulation):
    simulation.send(ask.SetModels(("bare", "ours")))
    press(simulation)
    wait_for(lambda: info(simulation, 1) is not None and info(simulation, 1).forces["ball"][2] > 0.1)
    assert info(simulation, 0).model == "bare"
    assert info(simulation, 1).model == "ours"


def test_nothing_stops_a_session_that_no_window_looks_at(simulation):
    """The window takes neither pictures nor events for a while."""
    wait_for(lambda: info(simulation))
    before = info(simulation).time
    time.sleep(0.5)
    simulation.send(ask.SetColour("strain"))
    for _ in range(300):
        simulation.send(ask.LeadCollider("ball", np.full(3, np.nan)))
    wait_for(lambda: info(simulation).time > before + 0.5)
    heard: list[ask.Event] = []

    def all_heard():
        heard.extend(simulation.events())
        return sum(isinstance(event, ask.Notice) for event in heard) >= 300

    wait_for(all_heard)


def test_a_recording_in_progress_is_kept_at_the_end(toy3d):
    folder = toy3d.out / "recordings"
    earlier = set(folder.glob("*"))  # of other tests
    with SimulationProcess(toy3d.workshop()) as process:
        wait_for(lambda: info(process))
        process.send(ask.Record(True))
        press(process)
        before = info(process).time
        wait_for(lambda: info(process).time > before + 0.2)
    names = {path.name for path in set(folder.iterdir()) - earlier}
    notices = [event.text for event in process.events() if isinstance(event, ask.Notice)]
    assert any("recorded" in text and "softprint convert" in text for text in notices)
    assert {name[len("hand_001") :] for name in names} == {"_bare.h5", "_bare.xdmf", ".toml"}


def test_a_simulation_that_is_killed_is_noticed(toy3d):
    process = SimulationProcess(toy3d.workshop())
    wait_for(lambda: info(process))
    os.kill(process._process.pid, signal.SIGKILL)
    wait_for(lambda: not process.alive)
    press(process)  # is not heard, and harms nothing
    process.close()


def test_a_session_ends_with_its_window(toy3d):
    """The window's process is killed."""

    def window(told):
        process = SimulationProcess(toy3d.workshop())
        wait_for(lambda: info(process))
        told.send(process._process.pid)
        time.sleep(PATIENCE)

    forked = multiprocessing.get_context("fork")
    ours, theirs = forked.Pipe()
    killed = forked.Process(target=window, args=(theirs,))
    killed.start()
    simulation = ours.recv()
    killed.kill()
    killed.join()
    wait_for(lambda: not runs(simulation))


def runs(process: int) -> bool:
    """Whether a process is there, and has not ended unnoticed by its parent."""
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"
