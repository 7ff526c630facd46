"""One thread of linear algebra for a process that computes beside others on the same cores."""

from __future__ import annotations

import sys


def one_thread() -> None:
    """From now on BLAS, OpenMP and torch, where it is loaded, use one thread in this process. The matrices of a step
    gain nothing from more, and threads that wait for each other take the cores from the process beside: with two cores
    a step beside the drawing of its surface takes up to half as long again. A process forked from several threads of
    OpenMP may hang."""
    from threadpoolctl import threadpool_limits

    threadpool_limits(1)
    if "torch" in sys.modules:  # loading it takes a second, which drawing without a network need not wait for
        sys.modules["torch"].set_num_threads(1)
