"""A recording is written by a process of its own, while the simulation goes on."""

from __future__ import annotations

import logging
import multiprocessing
import signal
from multiprocessing.connection import Connection
from pathlib import Path

from softprint.runtime.errors import SoftprintError
from softprint.runtime.viewer.session.commands import Notice
from softprint.runtime.viewer.session.recording import Recording
from softprint.runtime.viewer.session.workshop import Workshop

log = logging.getLogger(__name__)


class WritingProcess:
    """Writes one recording into a folder, under a name."""

    def __init__(self, recording: Recording, workshop: Workshop, folder: Path, name: str) -> None:
        forked = multiprocessing.get_context("fork")
        self._ours, theirs = forked.Pipe(duplex=False)
        self._process = forked.Process(target=_write, args=(recording, workshop, folder, name, theirs))
        self._process.start()
        theirs.close()

    def outcome(self, wait: bool) -> Notice | None:
        """What it has written, or why it could not; None while it writes."""
        if not wait and not self._ours.poll():
            return None
        try:
            notice: Notice = self._ours.recv()
        except EOFError:
            notice = Notice("the recording could not be written: the process that writes it has ended", "bad")
        self._process.join()
        self._ours.close()
        return notice


def _write(recording: Recording, workshop: Workshop, folder: Path, name: str, told: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        *motions, scene = recording.write(workshop, folder, name)
        first = motions[0]
        notice = Notice(
            f"{recording.seconds:.1f} s recorded: {', '.join(map(str, motions))}, and the scene {scene}; "
            f"as a short film: softprint convert {first} {first.with_suffix('.gif')}",
            "good",
        )
    except SoftprintError as error:
        notice = Notice(f"the recording could not be written: {error}", "bad")
    except Exception as error:
        log.exception("writing a recording has failed")
        notice = Notice(f"the recording could not be written: {type(error).__name__}: {error}", "bad")
    told.send(notice)
