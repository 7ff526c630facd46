"""The machine on which a report was made, without which timings are meaningless."""

import os
import platform
from pathlib import Path
from typing import Any


def machine_summary() -> dict[str, Any]:
    """Processor, usable cores, memory [bytes], threads of linear algebra, operating system."""
    return {
        "processor": _field(Path("/proc/cpuinfo"), "model name") or platform.machine(),
        "cores": len(os.sched_getaffinity(0)),
        "memory": os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"),
        "threads": os.environ.get("OMP_NUM_THREADS") or "as many as cores",
        "system": _system(),
    }


def _field(path: Path, name: str) -> str:
    """The first `name : value` of a file of such lines; empty if there is none."""
    if not path.is_file():
        return ""
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        key, _, value = line.partition(":")
        if key.strip() == name:
            return value.strip()
    return ""


def _system() -> str:
    try:
        return platform.freedesktop_os_release()["PRETTY_NAME"]
    except (OSError, KeyError):  # not every system has the file, and not every file has the name
        return platform.platform()
