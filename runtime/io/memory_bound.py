"""A bound on the memory for reading a foreign file, so that a few bytes cannot allocate all of it."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_ROOM = 256 << 20  # bytes of memory for any file ...
_SWELLING = (
    64  # ... and this many times its own size: text in Python lists takes twenty times, compressed data more
)


@contextmanager
def memory_bound(path: Path) -> Iterator[None]:
    """Inside the block, allocations beyond the need of a file of this size raise a MemoryError."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    bound = pages * resource.getpagesize() + _ROOM + _SWELLING * path.stat().st_size
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    given = [limit for limit in (soft, hard) if limit != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_AS, (min([bound, *given]), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
