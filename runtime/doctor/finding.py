"""The result of a check."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Level(Enum):
    """OK: works. WARN: works, but not as well as it could. MISSING, BROKEN: does not work."""

    OK = "OK"
    WARN = "WARN"
    MISSING = "MISSING"
    BROKEN = "BROKEN"


@dataclass(frozen=True)
class Finding:
    """subject: what was checked; detail: what was found; remedy: what to do about it; needed: whether the runtime
    requires it."""

    subject: str
    level: Level
    detail: str
    remedy: str = ""
    needed: bool = False

    @property
    def is_fatal(self) -> bool:
        """Whether something required does not work, or something installed is broken."""
        return self.level is Level.BROKEN or (self.needed and self.level is Level.MISSING)
