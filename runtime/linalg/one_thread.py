"""One thread of linear algebra for a process that computes beside others on the same cores."""

from __future__ import annotations


def one_thread() -> None:
    """From now on BLAS, OpenMP and torch use one thread in this process. The matrices of a step gain nothing from more,
    and threads that wait for each other take the cores from the process beside: with two cores a step beside the
    drawing of its surface takes up to half as long again. A process forked from several threads of OpenMP may hang."""
    import torch
    from threadpoolctl import threadpool_limits

    torch.set_num_threads(1)
    threadpool_limits(1)
