"""The cache folder of compiled forms. One process at a time compiles; unfinished files of killed processes are removed.

FFCx takes the existence of `NAME.c` to mean that a form is compiled or being compiled, and waits for `NAME.c.cached`.
If a process is killed between the two, others would wait for ever. Therefore Softprint has its own folder, and the
compiling process holds a lock that the operating system releases when a process ends: the holder knows that
every unfinished form is left over from a killed process.

What is compiled with -march=native ends with an illegal instruction on a lesser processor, and machines of several
kinds may share a home directory. So each kind of processor has a folder of its own.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from softprint.runtime.errors import SoftprintError


def cache_folder() -> Path:
    """$XDG_CACHE_HOME/softprint/forms/PROCESSOR; under ~/.cache if that variable is not set."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(home) / "softprint" / "forms" / hashlib.sha256(_processor().encode()).hexdigest()[:16]


def _processor() -> str:
    """What determines the meaning of -march=native."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return " ".join(sorted({line for line in lines if line.startswith(("model name", "flags", "Features"))}))


@contextmanager
def form_cache() -> Iterator[Path]:
    """The folder, locked for this process, without unfinished files."""
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
