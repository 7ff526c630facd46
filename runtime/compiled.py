"""Kernels compiled to machine code at their first use (numba), for what a step does to some tens of points: there the
number of numpy's calls is what costs, not the arithmetic.

What is compiled is kept on disk beside the source, or, where that cannot be written, in the user's cache; with neither
it is compiled anew in every process. What was kept (`kernel_cache.py`) is used until its file changes, so a kernel may
call kernels of its own file only. None of them holds Python's lock, so that other threads run beside them.

Beside a kernel stands its reference, the same in a line or a few of numpy, which is never called but by the test that
they agree: it takes the same arguments and returns what the kernel returns, followed by what the kernel writes into its
arguments, in their order. Kernels that are called by others of their file need none of their own.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast, overload

from numba import njit

from softprint.runtime.kernel_cache import keep_by_key

Kernel = TypeVar("Kernel", bound=Callable[..., object])
Reference = Callable[..., object]

#: (kernel, reference) of every kernel imported so far that has a reference, by "module.name".
REFERENCES: dict[str, tuple[Callable[..., object], Reference]] = {}


@overload
def compiled(kernel: Kernel, /) -> Kernel: ...
@overload
def compiled(*, reference: Reference) -> Callable[[Kernel], Kernel]: ...
def compiled(
    kernel: Kernel | None = None, /, *, reference: Reference | None = None
) -> Kernel | Callable[[Kernel], Kernel]:
    """Decorator. Division by zero gives inf or nan, as in numpy."""
    decorate = _decorator(reference)
    return decorate if kernel is None else decorate(kernel)


@overload
def summing(kernel: Kernel, /) -> Kernel: ...
@overload
def summing(*, reference: Reference) -> Callable[[Kernel], Kernel]: ...
def summing(
    kernel: Kernel | None = None, /, *, reference: Reference | None = None
) -> Kernel | Callable[[Kernel], Kernel]:
    """As `compiled`, with sums taken in any order, several terms at once."""
    decorate = _decorator(reference, fastmath={"contract", "nsz", "reassoc"})
    return decorate if kernel is None else decorate(kernel)


def _decorator(reference: Reference | None, **options: Any) -> Callable[[Kernel], Kernel]:
    def decorate(kernel: Kernel) -> Kernel:
        ready = _compiled(kernel, **options)
        if reference is not None:
            REFERENCES[f"{kernel.__module__}.{kernel.__qualname__}"] = (ready, reference)
        return ready

    return decorate


def _compiled(kernel: Kernel, **options: Any) -> Kernel:
    try:
        ready = njit(cache=True, nogil=True, error_model="numpy", **options)(kernel)
    except RuntimeError:  # numba found no place to keep it
        return cast(Kernel, njit(nogil=True, error_model="numpy", **options)(kernel))
    keep_by_key(ready)
    return cast(Kernel, ready)
