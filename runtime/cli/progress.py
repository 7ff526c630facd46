"""Progress of long work: a bar on a terminal, or log lines at intervals.

A thread keeps the clock of the bar going, and writes the lines of the log, while one unit of work takes long. A
process that started this one, `softprint run`, may follow it by a file that the environment variable FOLLOWED names:
lines of count, total, unit and description, and a line of FAILED and the reason where it fails.
"""

from __future__ import annotations

import logging
import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any

log = logging.getLogger(__name__)

LOG_AFTER = 10.0  # s until the first line in a log
LOG_INTERVAL = 30.0  # s between two lines
_TICK = 1.0  # s between two looks at the clock
FOLLOWED = "SOFTPRINT_PROGRESS"
FAILED = "failed"
_TELL_INTERVAL = 0.5  # s between two lines for the process that follows


def tell_failure(message: str) -> None:
    """Tell a process that follows this one why it fails: what it prints may be among lines of MPI."""
    path = os.environ.get(FOLLOWED)
    if path:
        with open(path, "a", encoding="utf-8") as file:
            file.write(f"{FAILED}\t{' '.join(message.split())}\n")


class Progress:
    """Counts finished units of work and shows their rate and the remaining time. Has to be closed: it is a context
    manager."""

    # How tqdm draws the bar; None: its own way. Whether a finished bar stays on the screen.
    _format: str | None = None
    _stays = True

    def __init__(
        self, total: int | None, unit: str = "it", desc: str = "", quiet: bool = False, silent: bool = False
    ) -> None:
        self.total, self.unit, self.desc, self.silent = total, unit, desc, silent
        self.count = 0
        self._started = self._touched = time.monotonic()
        self._due = self._started + LOG_AFTER
        self._resumed = 0
        self._note = ""
        self._bar: Any = None
        self._lock, self._closed = threading.RLock(), threading.Event()
        self._clock: threading.Thread | None = None
        self._told = 0.0
        if silent:
            return
        self._tell()
        if not quiet and sys.stderr.isatty():
            from tqdm import tqdm

            style = {"bar_format": self._format, "leave": self._stays}
            self._bar = tqdm(total=total, unit=unit, desc=desc, dynamic_ncols=True, smoothing=0.1, **style)
        self._clock = threading.Thread(target=self._keep_time, name="progress", daemon=True)
        self._clock.start()

    def skip(self, n: int) -> None:
        """Count n units that an earlier run finished: they advance the bar without affecting the rate."""
        with self._lock:
            self.count += n
            self._resumed += n
            if self._bar is not None:
                self._bar.initial += n
                self._bar.n += n
                self._bar.refresh()

    def update(self, n: int = 1, note: str = "") -> None:
        """Count n more units; note: a short text after the bar, such as the current loss."""
        with self._lock:
            self.count += n
            self._note = note or self._note
            self._touched = time.monotonic()
            if self._bar is not None:
                if note:
                    self._bar.set_postfix_str(note, refresh=False)
                self._bar.update(n)
            else:
                self._log_if_due()
            if time.monotonic() - self._told > _TELL_INTERVAL:
                self._tell()

    def _tell(self) -> None:
        """A line for the process that follows this one, if there is one."""
        path = os.environ.get(FOLLOWED)
        if self.silent or not path:
            return
        self._told = time.monotonic()
        with open(path, "a", encoding="utf-8") as file:
            file.write(f"{self.count}\t{self.total or 0}\t{self.unit}\t{self.desc}\n")

    def close(self) -> None:
        """Keep the finished bar on screen, or log the last line."""
        self._closed.set()
        if self._clock is not None:
            self._clock.join()
        self._tell()
        if self._bar is not None:
            self._bar.close()
        elif not self.silent and self._is_worth_a_last_line():
            self._log()

    def _keep_time(self) -> None:
        while not self._closed.wait(_TICK):
            with self._lock:
                if self._bar is None:
                    self._log_if_due()
                elif time.monotonic() - self._touched > _TICK:
                    self._bar.refresh()

    def _log_if_due(self) -> None:
        if not self.silent and time.monotonic() >= self._due:
            self._log()

    def _is_worth_a_last_line(self) -> bool:
        return self.count > self._resumed

    def _log(self) -> None:
        now = time.monotonic()
        self._due = now + LOG_INTERVAL
        log.info("%s", self._line(now - self._started))

    def _line(self, elapsed: float) -> str:
        """The state after `elapsed` [s], for a log."""
        rate = (self.count - self._resumed) / elapsed if elapsed > 0 else 0.0
        line = f"{self.desc or 'progress'}: {self.count}"
        line += f" {self.unit}" if self.total is None else f"/{self.total} {self.unit}"
        line += f", {rate:.3g}/s" if rate > 0 else f", {elapsed:.0f} s so far"
        if self.total is not None and rate > 0:
            line += f", {(self.total - self.count) / rate:.0f} s left"
        return f"{line}, {self._note}" if self._note else line

    def __enter__(self) -> Progress:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class Stage(Progress):
    """Work of unknown length, such as a factorisation: shows how long it has taken. Leaves nothing on the screen, and
    nothing in a log if it is quick."""

    _format = "{desc}: {elapsed}"
    _stays = False

    def __init__(self, desc: str, quiet: bool = False, silent: bool = False) -> None:
        super().__init__(None, desc=desc, quiet=quiet, silent=silent)

    def _is_worth_a_last_line(self) -> bool:
        return self._due > self._started + LOG_AFTER  # it has logged before

    def _line(self, elapsed: float) -> str:
        return f"{self.desc}: {elapsed:.0f} s" + ("" if self._closed.is_set() else " so far")


@contextmanager
def beside_bars() -> Iterator[None]:
    """Where something is printed: bars on the screen are cleared before, and drawn again after it."""
    tqdm = sys.modules.get("tqdm")
    if tqdm is None:
        yield
        return
    with tqdm.tqdm.external_write_mode(file=sys.stderr):
        yield


def print_beside_bars(text: str) -> None:
    """Print a line to stdout."""
    with beside_bars():
        print(text)


class LogHandler(logging.StreamHandler[Any]):
    """Writes a log to stderr, beside bars."""

    def emit(self, record: logging.LogRecord) -> None:
        with beside_bars():
            super().emit(record)
