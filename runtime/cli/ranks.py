"""Which MPI rank this process is, asked of the launcher and not of MPI, so that nothing is loaded for it."""

from __future__ import annotations

import os
import sys

_RANK = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK")


def launched_rank() -> int:
    """Rank of this process under mpirun or srun; 0 without."""
    for name in _RANK:
        if os.environ.get(name, "").isdigit():
            return int(os.environ[name])
    return 0


def end_all_ranks(status: int) -> None:
    """End every rank of an MPI run at once: one that stopped alone would leave the others waiting for ever.

    Does nothing in a process that runs alone, or that never loaded MPI: there, mpirun itself ends the rest when a
    process exits with a status other than 0.
    """
    mpi = sys.modules.get("mpi4py.MPI")
    if mpi is not None and mpi.COMM_WORLD.size > 1:
        sys.stdout.flush()
        sys.stderr.flush()
        mpi.COMM_WORLD.Abort(status)
