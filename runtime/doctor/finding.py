"""What a check found."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Level(Enum):
    """OK: as it should be. WARN: it works, but not as well as it could. MISSING, BROKEN: it does not work."""

    OK = "OK"
    WARN = "WARN"
    MISSING = "MISSING"
    BROKEN = "BROKEN"


@dataclass(frozen=True)
class Finding:
    """subject: what was looked at; detail: what was seen; remedy: what to do unless all is well; needed:
    whether the runtime itself cannot do without it."""

    subject: str
    level: Level
    detail: str
    remedy: str = ""
    needed: bool = False

    @property
    def is_fatal(self) -> bool:
        """Whether something that nobody can do without does not work, or something that is there is
        broken.
        """
        return self.level is Level.BROKEN or (self.needed and self.level is Level.MISSING)
