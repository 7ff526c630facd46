"""Which MPI rank this process is, asked of the launcher and not of MPI, so that nothing is loaded for it."""

from __future__ import annotations

import os
import sys

_RANK = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK")
_SIZE = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE")


def _number(names: tuple[str, ...], default: int) -> int:
    for name in names:
        if os.environ.get(name, "").isdigit():
            return int(os.environ[name])
    return default


def launched_rank() -> int:
    """Rank of this process under mpirun; 0 without."""
    return _number(_RANK, 0)


def launched_size() -> int:
    """Number of processes that mpirun started; 1 without."""
    return _number(_SIZE, 1)


def end_all_ranks(status: int) -> None:
    """End every rank of an MPI run at once: one that stopped alone would leave the others waiting for ever.

    Does nothing in a process that mpirun did not start with others, or that never loaded MPI: there, mpirun
    itself ends the rest when a process exits with a status other than 0.
    """
    if launched_size() > 1 and "mpi4py.MPI" in sys.modules:
        sys.stdout.flush()
        sys.stderr.flush()
        sys.modules["mpi4py.MPI"].COMM_WORLD.Abort(status)
