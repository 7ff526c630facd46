"""A bound on the memory that reading a foreign file may take, so that a few bytes cannot ask for all there is."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_ROOM = 256 << 20  # bytes that any file may take ...
_SWELLING = (
    64  # ... and so many times its own size: text in Python's lists takes twenty times, compressed data more
)


@contextmanager
def memory_bound(path: Path) -> Iterator[None]:
    """Within, what asks for much more memory than a file of this size can need gets a MemoryError."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    bound = pages * resource.getpagesize() + _ROOM + _SWELLING * path.stat().st_size
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    given = [limit for limit in (soft, hard) if limit != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_AS, (min([bound, *given]), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
