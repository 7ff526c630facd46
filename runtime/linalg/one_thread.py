"""One thread of linear algebra for a process that computes beside others on the same cores."""

from __future__ import annotations

import os
import sys

#: How many threads linear algebra uses, where one of them is set in the environment.
VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def one_thread() -> None:
    """From now on BLAS, OpenMP and torch, where it is loaded, use one thread in this process. The matrices of a step
    gain nothing from more, and threads that wait for each other take the cores from the process beside: with two cores
    a step beside the drawing of its surface takes up to half as long again. A process forked from several threads of
    OpenMP may hang."""
    from threadpoolctl import threadpool_limits

    threadpool_limits(1)
    if "torch" in sys.modules:  # loading it takes a second, which drawing without a network need not wait for
        sys.modules["torch"].set_num_threads(1)


def one_thread_by_default() -> None:
    """`one_thread`, unless the environment says how many threads linear algebra uses."""
    if not any(os.environ.get(name) for name in VARIABLES):
        one_thread()


def blas_threads() -> int:
    """How many threads BLAS uses in this process."""
    from threadpoolctl import threadpool_info

    return max((pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"), default=1)
