"""Surfaces drawn beside the steps that follow, by a process of its own: one frame late, and hardly felt by the steps.

On another thread it would wait for Python's lock, and the steps for it: on the Hand that costs a step 14 %, a process
4 %. The process is a copy of this one, made when it is first asked to draw, so that it shares what the model has read;
what it is sent is a snapshot, some kilobytes, and positions come back through memory that both see.

    with BackgroundDrawing(simulator) as drawer:
        while ...:
            state = simulator.step(state).state
            surface = drawer.next(state)          # of the state before; None at first
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

from runtime.arrays import Array
from runtime.dynamics.corrected_nodes import Snapshot
from runtime.errors import SoftprintError

_ENDED = "the process that draws beside has ended, or was ended: begin another one"


class Drawn(Protocol):
    """What is drawn: a `Simulator` or a `ReducedModel`."""

    def surface_snapshot(self, state: Any) -> Snapshot: ...

    def surface_drawn(self, snapshot: Snapshot) -> Array: ...


class BackgroundDrawing:
    """Draws one surface at a time. Raises what went wrong there when the surface is asked for."""

    def __init__(self, model: Drawn) -> None:
        if "fork" not in multiprocessing.get_all_start_methods():
            raise SoftprintError("drawing beside needs a system that copies processes (fork), as Linux does")
        self._model, self._waiting = model, False
        self._process: BaseProcess | None = None

    def next(self, state: Any) -> Array | None:
        """Begins to draw a state, and returns the surface (s, dim) [m] of the one before; None for the first."""
        snapshot = self._model.surface_snapshot(state)
        if self._process is None:
            self._start(self._model.surface_drawn(snapshot))
        drawn = self.last()
        self._send(snapshot)
        self._waiting = True
        return drawn

    def last(self) -> Array | None:
        """The surface that is being drawn; None where none is."""
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
        # Asked first, for writing to no one is a signal, by which PETSc, where it is loaded, ends this process.
        if self._process is None or not self._process.is_alive():
            raise SoftprintError(_ENDED)
        try:
            self._ours.send(snapshot)
        except ConnectionError:
            raise SoftprintError(_ENDED) from None

    def _start(self, surface: Array) -> None:
        """What a first drawing prepares or compiles is there before the process is copied."""
        shared = mmap.mmap(-1, surface.nbytes)
        self._surface: Array = np.frombuffer(shared, surface.dtype).reshape(surface.shape)
        copied = multiprocessing.get_context("fork")
        self._ours, theirs = copied.Pipe()
        self._process = copied.Process(target=self._draw, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()

    def _draw(self, connection: Connection) -> None:
        """The other process: draws what it is sent, until that is None or nobody is there any more."""
        self._ours.close()
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
