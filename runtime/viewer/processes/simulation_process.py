"""A session in a process of its own. The window sends commands and takes frames; neither waits for the other.

    with SimulationProcess(workshop, models) as simulation:
        simulation.send(LeadCollider(...))
        picture = simulation.boards[0].newest(after)
        events = simulation.events()

If the window's process ends, so does this one, after it has written a recording that is in progress.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from queue import Empty, SimpleQueue
from types import TracebackType

import numpy as np

from softprint.runtime.errors import SoftprintError
from softprint.runtime.linalg.one_thread import one_thread
from softprint.runtime.viewer.processes.clock import Clock
from softprint.runtime.viewer.processes.frame_board import FrameBoard
from softprint.runtime.viewer.processes.frame_info import frame_info
from softprint.runtime.viewer.processes.painting_process import PaintingProcess
from softprint.runtime.viewer.processes.writing_process import WritingProcess
from softprint.runtime.viewer.session import commands as ask
from softprint.runtime.viewer.session.painting import drawn_nodes, order_of
from softprint.runtime.viewer.session.recording import free_name
from softprint.runtime.viewer.session.session import MOST_MODELS, Results, Session
from softprint.runtime.viewer.session.workshop import Workshop

log = logging.getLogger(__name__)

# While nothing runs, commands and finished work are looked for at least so often [s].
_IDLE = 0.02
# How long the window waits for a recording to be written at the end [s].
_PATIENCE = 120.0


class SimulationProcess:
    """The window's side. boards: of the pictures, one for each model that may play side by side."""

    def __init__(self, workshop: Workshop, models: Sequence[str] = ("bare",)) -> None:
        if "fork" not in multiprocessing.get_all_start_methods():
            raise SoftprintError("the window needs a system with fork, such as Linux")
        n = len(drawn_nodes(workshop.body.mesh))
        self.boards = [FrameBoard(n) for _ in range(MOST_MODELS)]
        self._queue: SimpleQueue[ask.Event] = SimpleQueue()
        forked = multiprocessing.get_context("fork")
        self._commands, theirs = forked.Pipe()
        self._process = forked.Process(
            target=_simulate, args=(workshop, tuple(models), self.boards, theirs, self._commands)
        )
        self._process.start()
        theirs.close()
        self._send_lock = threading.Lock()
        self._reader = threading.Thread(target=self._read, name="events", daemon=True)
        self._reader.start()

    @property
    def alive(self) -> bool:
        """Whether the session goes on."""
        return self._process.is_alive()

    def send(self, command: ask.Command) -> None:
        """Ask for something. Without effect once the session has ended."""
        with self._send_lock:
            try:
                self._commands.send(command)
            except (OSError, ValueError):
                log.debug("the session has ended: %s is not heard", type(command).__name__)

    def events(self) -> list[ask.Event]:
        """What has happened since the last call."""
        events = []
        try:
            while True:
                events.append(self._queue.get_nowait())
        except Empty:
            return events

    def close(self) -> None:
        """End the session; a recording in progress is written first."""
        if self._process.is_alive():
            self.send(ask.Quit())
            self._process.join(_PATIENCE)
            if self._process.is_alive():
                self._process.kill()
                self._process.join()
        self._reader.join(timeout=1.0)
        self._commands.close()

    def __enter__(self) -> SimulationProcess:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _read(self) -> None:
        try:
            while True:
                self._queue.put(self._commands.recv())
        except (EOFError, OSError):
            return


def _simulate(
    workshop: Workshop,
    models: tuple[str, ...],
    boards: list[FrameBoard],
    window: Connection,
    others_end: Connection,
) -> None:
    """The process."""
    for number in (signal.SIGINT, signal.SIGTERM):  # the window ends this process
        signal.signal(number, signal.SIG_IGN)
    others_end.close()
    try:
        _Loop(workshop, models, boards, window).run()
    except SoftprintError as error:
        _tell(window, ask.Notice(str(error), "bad"))
    except Exception as error:
        log.exception("the simulation has failed")
        _tell(window, ask.Notice(f"the simulation has ended: {type(error).__name__}: {error}", "bad"))
    os._exit(0)  # threads that make models are not waited for


class _Loop:
    def __init__(
        self, workshop: Workshop, models: tuple[str, ...], boards: list[FrameBoard], window: Connection
    ) -> None:
        import torch  # noqa: F401  # models load it later: it has to be there to be limited

        one_thread()
        self.session = Session(workshop, models)
        self.boards, self.window = boards, window
        self.clock = Clock(workshop.parts.settings.time_step)
        self.painters: list[PaintingProcess] = []
        self.painted: list[object] = []
        self.writers: list[WritingProcess] = []
        self.names: set[str] = set()  # of recordings
        self.results: Results = ()

    def run(self) -> None:
        """Until the window asks to quit, or is gone."""
        session = self.session
        try:
            while not session.ended:
                self._listen()
                if session.running and not self.clock.wait:
                    self._step()
                elif not session.running:
                    self.clock.rest()
                    session.fetch()
                for painter in self.painters:
                    painter.push()
                self._write()
                for event in session.events():
                    _tell(self.window, event)
        finally:
            session.close()
            for painter in self.painters:
                painter.close()
            self._write(wait=True)

    def _listen(self) -> None:
        """Take all commands; wait for one while there is nothing else to do."""
        session = self.session
        wait = self.clock.wait if session.running else _IDLE
        try:
            while self.window.poll(wait):
                session.handle(self.window.recv())
                wait = 0.0
        except (EOFError, OSError):  # the window is gone
            session.ended = True

    def _step(self) -> None:
        began = time.monotonic()
        results = self.session.advance()
        self.clock.stepped(time.monotonic() - began, self.session.pace.speed)
        if results:
            self.results = results
            self._show(began)

    def _show(self, stamp: float) -> None:
        """Have the states painted, by new painters where models have changed."""
        players = self.session.players
        wanted = [player.model.painter for player in players]
        if self.painted != wanted:
            for painter in self.painters:
                painter.close()
            self.painters = [PaintingProcess(own, board) for own, board in zip(wanted, self.boards)]
            self.painted = list(wanted)
        grab = self.session.hands.grab
        pace = self.clock.pace
        for player, result, painter in zip(players, self.results, self.painters, strict=True):
            pull = None
            if grab is not None:
                at = self.session.body.basis[grab.node] @ result.state.rows
                pull = (np.asarray(at), grab.follower.pose.translation)
            info = frame_info(result, player.model.name, pace, pull, stamp)
            painter.show(order_of(result, self.session.quantity, info))

    def _write(self, wait: bool = False) -> None:
        """Begin to write finished recordings, and tell of those that are written."""
        session = self.session
        while session.finished_recordings:
            recording = session.finished_recordings.pop(0)
            name = free_name(session.recordings, self.names)
            self.names.add(name)
            self.writers.append(WritingProcess(recording, session.workshop, session.recordings, name))
        for writer in list(self.writers):
            self._collect(writer, wait)

    def _collect(self, writer: WritingProcess, wait: bool) -> None:
        notice = writer.outcome(wait)
        if notice is not None:
            self.writers.remove(writer)
            _tell(self.window, notice)


def _tell(window: Connection, event: ask.Event) -> None:
    try:
        window.send(event)
    except OSError:
        log.debug("the window is gone")
