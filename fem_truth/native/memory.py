"""Freed memory stays with the process.

A solve makes and drops vectors of some hundred kilobytes all the time. The C library gives memory of that size back
to the system at once, and the system has to clear every page of it again: eight copies of a 60,000-cell body's
positions took 0.8 ms, and 0.08 ms where memory is kept.
"""

from __future__ import annotations

import ctypes
import sys

# From malloc.h of the GNU C library, for which alone the call is made.
_TRIM_THRESHOLD, _TOP_PAD, _MMAP_THRESHOLD = -1, -2, -3
_KEPT = 512 * 2**20  # bytes that may lie idle before any are given back
_STEP = 16 * 2**20  # bytes asked of the system at a time
_LARGE = 32 * 2**20  # from here on an array gets pages of its own


def keep_freed_memory() -> None:
    """For the whole process; does nothing on systems with another C library."""
    if not sys.platform.startswith("linux"):
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        for setting, value in ((_TRIM_THRESHOLD, _KEPT), (_TOP_PAD, _STEP), (_MMAP_THRESHOLD, _LARGE)):
            mallopt(setting, value)
