"""A painter in a process of its own: beside the next step, on another core, and without Python's lock in common.

As in `runtime/scenes/background_drawing.py` the process is forked, so that it shares the loaded model. Here it pins
what it has painted on a board for the window, and the simulation never waits for it: while a picture is painted, newer
states replace each other.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from multiprocessing.connection import Connection

from softprint.runtime.errors import SoftprintError
from softprint.runtime.viewer.processes.frame_board import FrameBoard
from softprint.runtime.viewer.session.painting import Order, Painter


class PaintingProcess:
    """Paints orders of one painter on a board; a new one after a change of model."""

    def __init__(self, painter: Painter, board: FrameBoard) -> None:
        if "fork" not in multiprocessing.get_all_start_methods():
            raise SoftprintError("the window needs a system with fork, such as Linux")
        self._board = board
        self._latest: Order | None = None
        self._sent = board.done
        forked = multiprocessing.get_context("fork")
        self._ours, theirs = forked.Pipe()
        self._process = forked.Process(target=_paint, args=(painter, board, theirs, self._ours), daemon=True)
        self._process.start()
        theirs.close()

    def show(self, order: Order) -> None:
        """Have this state painted as soon as the picture before is finished; a newer one replaces it."""
        self._latest = order
        self.push()

    def push(self) -> None:
        """Hand the waiting order over if the painter is free."""
        if self._latest is None or self._board.done < self._sent:
            return
        order, self._latest = self._latest, None
        self._sent += 1
        try:
            self._ours.send(order)
        except OSError:
            raise SoftprintError("the process that draws has ended") from None

    def close(self) -> None:
        """End the process; orders that wait are dropped."""
        self._ours.close()
        self._process.join(timeout=1.0)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        # Whatever it has left unfinished no longer counts.
        while self._board.done < self._sent:
            self._board.count()


def _paint(painter: Painter, board: FrameBoard, orders: Connection, others_end: Connection) -> None:
    """The process: paints until the other end is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    others_end.close()
    try:
        while True:
            order = orders.recv()
            try:
                vertices, values = painter.paint(order)
                meta = {"info": order.meta, "confidence": painter.confidences(order.state)}
                board.publish(vertices, values, meta)
            finally:
                board.count()
    except (EOFError, OSError):
        os._exit(0)
