"""A recording is written by a process of its own, while the simulation goes on."""

from __future__ import annotations

import logging
import multiprocessing
import signal
import subprocess
import sys
from collections.abc import Sequence
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
        done = f"{recording.seconds:.1f} s recorded: {', '.join(map(str, motions))}, and the scene {scene}"
        if recording.film:
            notice = Notice(f"{done}; {', '.join(_films(motions))}", "good")
        else:
            first = motions[0]
            film = f"softprint convert {first} {first.with_suffix('.gif')}"
            notice = Notice(f"{done}; as a short film: {film}", "good")
    except SoftprintError as error:
        notice = Notice(f"the recording could not be written: {error}", "bad")
    except Exception as error:
        log.exception("writing a recording has failed")
        notice = Notice(f"the recording could not be written: {type(error).__name__}: {error}", "bad")
    told.send(notice)


def _films(motions: Sequence[Path]) -> list[str]:
    """A GIF of each motion, by `softprint convert` in a process that was not forked from one with windows and threads;
    the paths. Raises SoftprintError with what it says where it fails."""
    films = []
    for motion in motions:
        film = str(motion.with_suffix(".gif"))
        command = [
            sys.executable,
            "-m",
            "softprint.runtime.cli.main",
            "convert",
            str(motion),
            film,
            "--quiet",
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            said = done.stderr.strip().splitlines() or ["no reason given"]
            raise SoftprintError(f"{motion} is there, but not as a GIF: {said[-1]}")
        films.append(film)
    return films
