"""Surfaces computed by a background process during the next step: one frame late, at little cost to the steps.

On another thread it would compete with the steps for Python's lock: on the Hand a thread costs a step 14 %, a process 4
%. The process is forked from this one at the first drawing, so it shares the loaded model. It receives a snapshot of
some kilobytes and returns positions in shared memory.

    with BackgroundDrawing(simulator) as drawer:
        while ...:
            state = simulator.step(state).state
            surface = drawer.next(state)          # of the previous state; None at first
"""

from __future__ import annotations

import mmap
import multiprocessing
from contextlib import suppress
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from types import TracebackType
from typing import Any, Protocol

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.dynamics.corrected_nodes import Snapshot
from softprint.runtime.errors import SoftprintError
from softprint.runtime.linalg.one_thread import one_thread

_ENDED = "the background drawing process has ended: start another one"


class Drawn(Protocol):
    """The interface of the model that is drawn: a `Simulator` or a `ReducedModel`."""

    def surface_snapshot(self, state: Any) -> Snapshot: ...

    def surface_drawn(self, snapshot: Snapshot) -> Array: ...


class BackgroundDrawing:
    """Draws one surface at a time. An error of the background process is raised when its surface is requested."""

    def __init__(self, model: Drawn) -> None:
        if "fork" not in multiprocessing.get_all_start_methods():
            raise SoftprintError("background drawing needs a system with fork, such as Linux")
        self._model, self._waiting = model, False
        self._process: BaseProcess | None = None

    def next(self, state: Any) -> Array | None:
        """Starts to draw a state, and returns the surface (s, dim) [m] of the previous one; None for the first."""
        snapshot = self._model.surface_snapshot(state)
        if self._process is None:
            self._start(self._model.surface_drawn(snapshot))
        drawn = self.last()
        self._send(snapshot)
        self._waiting = True
        return drawn

    def last(self) -> Array | None:
        """The surface that is being drawn; None if there is none."""
        if not self._waiting:
            return None
        self._waiting = False
        try:
            error = self._ours.recv()
        except (EOFError, ConnectionError):
            raise SoftprintError(_ENDED) from None
        if error is not None:
            raise error
        return self._surface.copy()

    def close(self) -> None:
        """Ends the process."""
        if self._process is None:
            return
        with suppress(SoftprintError):
            self._send(None)
        self._ours.close()
        self._process.join()
        self._process = None

    def __enter__(self) -> BackgroundDrawing:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _send(self, snapshot: Snapshot | None) -> None:
        # Checked first: writing to a closed pipe raises a signal, and PETSc, if loaded, ends this process on it.
        if self._process is None or not self._process.is_alive():
            raise SoftprintError(_ENDED)
        try:
            self._ours.send(snapshot)
        except ConnectionError:
            raise SoftprintError(_ENDED) from None

    def _start(self, surface: Array) -> None:
        """Draw once before the fork, so that the child process inherits what a first drawing prepares or compiles."""
        shared = mmap.mmap(-1, surface.nbytes)
        self._surface: Array = np.frombuffer(shared, surface.dtype).reshape(surface.shape)
        copied = multiprocessing.get_context("fork")
        self._ours, theirs = copied.Pipe()
        self._process = copied.Process(target=self._draw, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()

    def _draw(self, connection: Connection) -> None:
        """The background process: draws snapshots until it receives None or its parent has ended."""
        self._ours.close()
        one_thread()
        while True:
            try:
                snapshot = connection.recv()
            except (EOFError, ConnectionError, KeyboardInterrupt):
                return
            if snapshot is None:
                return
            try:
                self._surface[:] = self._model.surface_drawn(snapshot)
                connection.send(None)
            except Exception as error:
                connection.send(error)
