"""The MPI rank of this process, from the launcher's environment, so that MPI need not be loaded."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time

_LOOK = 0.5  # s between two checks whether the launcher is alive

_RANK = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK")


def launched_rank() -> int:
    """Rank of this process under mpirun or srun; 0 otherwise."""
    for name in _RANK:
        if os.environ.get(name, "").isdigit():
            return int(os.environ[name])
    return 0


def is_launched() -> bool:
    """Whether this process is a rank under mpirun or srun."""
    return any(name in os.environ for name in _RANK)


def end_all_ranks(status: int) -> None:
    """End every rank of an MPI run at once: if one stopped alone, the others would wait forever.

    Does nothing in a process that runs alone, or that has not loaded MPI: in the latter case mpirun itself ends the
    other ranks when one exits with a nonzero status.
    """
    mpi = sys.modules.get("mpi4py.MPI")
    if mpi is not None and mpi.COMM_WORLD.size > 1:
        sys.stdout.flush()
        sys.stderr.flush()
        mpi.COMM_WORLD.Abort(status)


def end_with_launcher() -> None:
    """From now on, end this process when its parent ends. Open MPI 5 does not end ranks whose launcher was killed: they
    would wait for each other forever. For ranks only: a single process may outlive the shell that started it."""
    launcher = os.getppid()

    def watch() -> None:
        while os.getppid() == launcher:
            time.sleep(_LOOK)
        os.kill(os.getpid(), signal.SIGKILL)  # finished work is complete on disk

    threading.Thread(target=watch, daemon=True).start()
