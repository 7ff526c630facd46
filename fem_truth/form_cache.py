"""The folder of compiled forms. One process at a time compiles; what a killed one left half made is removed.

FFCx takes `NAME.c` for a form that is compiled or being compiled, and waits for `NAME.c.cached` to appear.
After a kill between the two it would wait for a process that is no more. So the folder is Softprint's own,
whoever compiles holds a lock that the system takes back from the dead, and its holder knows every unfinished
form for a left-over.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from runtime.errors import SoftprintError


def cache_folder() -> Path:
    """$XDG_CACHE_HOME/softprint/forms, in ~/.cache without that variable."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(home) / "softprint" / "forms"


@contextmanager
def form_cache() -> Iterator[Path]:
    """The folder, locked for this process, with nothing half made in it."""
    folder = cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / ".lock").open("a")
    except OSError as error:
        raise SoftprintError(
            f"{folder}: compiled forms cannot be kept there ({error.strerror}): make it writable, or let "
            "XDG_CACHE_HOME name a folder that is"
        ) from error
    with lock:  # closing it unlocks
        fcntl.flock(lock, fcntl.LOCK_EX)
        _clear_unfinished(folder)
        yield folder


def _clear_unfinished(folder: Path) -> None:
    for source in folder.glob("*.c"):
        if not source.with_name(source.name + ".cached").exists():
            for part in folder.glob(f"{source.stem}.*"):  # .c, .o, .so
                part.unlink(missing_ok=True)
    for library in folder.glob("*.so.unfinished"):  # of `native.library`
        library.unlink()
