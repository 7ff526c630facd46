"""Kernels compiled to machine code at their first use (numba), for what a step does to some tens of points: there the
number of numpy's calls is what costs, not the arithmetic.

What is compiled is kept on disk beside the source, or, where that cannot be written, in the user's cache; with neither
it is compiled anew in every process. What was kept is used until its file changes, so a kernel may call kernels of its
own file only. None of them holds Python's lock, so that other threads run beside them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

Kernel = TypeVar("Kernel", bound=Callable[..., object])


def compiled(kernel: Kernel) -> Kernel:
    """Decorator. Division by zero gives inf or nan, as in numpy."""
    return _compiled(kernel)


def summing(kernel: Kernel) -> Kernel:
    """As `compiled`, with sums taken in any order, several terms at once."""
    return _compiled(kernel, fastmath={"contract", "nsz", "reassoc"})


def _compiled(kernel: Kernel, **options: Any) -> Kernel:
    try:
        return cast(Kernel, njit(cache=True, nogil=True, error_model="numpy", **options)(kernel))
    except RuntimeError:  # numba found no place to keep it
        return cast(Kernel, njit(nogil=True, error_model="numpy", **options)(kernel))
