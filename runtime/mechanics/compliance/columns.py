"""Columns of the null-space compliance, solved for some at a time, and on all cores."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from softprint.runtime.forked_workers import ForkedWorkers, worker_count
from softprint.runtime.mechanics.compliance.null_space_compliance import NullSpaceCompliance

Result = TypeVar("Result")
Progress = Callable[[int], None]

# Columns solved at a time, to bound memory.
_COLUMNS = 240


def all_columns(
    response: NullSpaceCompliance, spread: sp.csr_matrix, progress: Progress | None
) -> NDArray[np.float32]:
    """Columns (n, dim, n_nodes, dim) of contact nodes, see `compliance_columns`."""

    def work(rows: slice, progress: Progress) -> NDArray[Any]:
        return np.concatenate(list(compliance_columns(response, spread[rows], progress)))

    return np.concatenate(shared_rows(work, spread.shape[0], response.shape[1], progress))


def shared_rows(
    work: Callable[[slice, Progress], Result], n: int, dim: int, progress: Progress | None
) -> list[Result]:
    """Work on n contact nodes, in order, some by each core; those whose columns one process solves for together stay
    together, so that the columns are the same to the bit."""
    step = _nodes_at_a_time(dim)
    batches = -(-n // step)
    count = worker_count(batches)
    edges = [min(n, step * (batches * k // count)) for k in range(count + 1)]
    blocks = [slice(start, stop) for start, stop in pairwise(edges)]
    with ForkedWorkers(work, count) as workers:
        return workers.map(blocks, progress)


def compliance_columns(
    response: NullSpaceCompliance, spread: sp.csr_matrix, progress: Progress | None
) -> Iterator[NDArray[np.float32]]:
    """Columns (k, dim, n_nodes, dim), some at a time, of contact nodes whose forces are distributed over the nodes by
    spread (n, n_nodes). progress: called with the number of nodes done."""
    n_nodes, dim = response.shape
    step = _nodes_at_a_time(dim)
    for start in range(0, spread.shape[0], step):
        weights = spread[start : start + step].toarray()
        forces = np.einsum("kn,ab->nakb", weights, np.eye(dim)).reshape(n_nodes, dim, -1)
        moved = response.solve(forces).reshape(n_nodes, dim, len(weights), dim)
        yield np.ascontiguousarray(moved.transpose(2, 3, 0, 1), dtype=np.float32)
        if progress is not None:
            progress(len(weights))


def _nodes_at_a_time(dim: int) -> int:
    return max(1, _COLUMNS // dim)
