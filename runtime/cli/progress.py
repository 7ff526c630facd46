"""Progress of long work: a bar on a terminal, or log lines at intervals."""

from __future__ import annotations

import logging
import sys
import time
from types import TracebackType
from typing import Any

log = logging.getLogger(__name__)

LOG_INTERVAL = 30.0  # s between two lines in a log


class Progress:
    """Counts finished units of work and shows their rate and the remaining time."""

    def __init__(
        self, total: int | None, unit: str = "it", desc: str = "", quiet: bool = False, silent: bool = False
    ) -> None:
        self.total, self.unit, self.desc, self.silent = total, unit, desc, silent
        self.count = 0
        self._started = self._logged = time.monotonic()
        self._resumed = 0
        self._note = ""
        self._bar: Any = None
        if not silent and not quiet and sys.stderr.isatty():
            from tqdm import tqdm

            self._bar = tqdm(total=total, unit=unit, desc=desc, dynamic_ncols=True, smoothing=0.1)

    def skip(self, n: int) -> None:
        """Count n units that an earlier run finished: they advance the bar without affecting the rate."""
        self.count += n
        self._resumed += n
        if self._bar is not None:
            self._bar.initial += n
            self._bar.n += n
            self._bar.refresh()

    def update(self, n: int = 1, note: str = "") -> None:
        """Count n more units; note: a short text after the bar, such as the current loss."""
        self.count += n
        self._note = note or self._note
        if self._bar is not None:
            if note:
                self._bar.set_postfix_str(note, refresh=False)
            self._bar.update(n)
        elif not self.silent and time.monotonic() - self._logged >= LOG_INTERVAL:
            self._log()

    def close(self) -> None:
        """Keep the finished bar on screen, or log the last line."""
        if self._bar is not None:
            self._bar.close()
        elif not self.silent and self.count > self._resumed:
            self._log()

    def _log(self) -> None:
        self._logged = time.monotonic()
        elapsed = self._logged - self._started
        rate = (self.count - self._resumed) / elapsed if elapsed > 0 else 0.0
        of_total = f"/{self.total}" if self.total is not None else ""
        rest = (
            f", {(self.total - self.count) / rate:.0f} s left" if self.total is not None and rate > 0 else ""
        )
        note = f", {self._note}" if self._note else ""
        log.info(
            "%s: %d%s %s, %.3g/s%s%s",
            self.desc or "progress",
            self.count,
            of_total,
            self.unit,
            rate,
            rest,
            note,
        )

    def __enter__(self) -> Progress:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
