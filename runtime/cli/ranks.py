"""Which MPI rank this process is, asked of the launcher and not of MPI, so that nothing is loaded for it."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time

_LOOK = 0.5  # s between two looks at whether the launcher is alive

_RANK = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK")


def launched_rank() -> int:
    """Rank of this process under mpirun or srun; 0 without."""
    for name in _RANK:
        if os.environ.get(name, "").isdigit():
            return int(os.environ[name])
    return 0


def is_launched() -> bool:
    """Whether this process is a rank under mpirun or srun."""
    return any(name in os.environ for name in _RANK)


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


def end_with_launcher() -> None:
    """From now on, end this process when its parent does. Of ranks whose launcher was killed, Open MPI 5 ends none:
    they would wait for each other for ever. For ranks only: a process alone may outlive the shell that began it."""
    launcher = os.getppid()

    def watch() -> None:
        while os.getppid() == launcher:
            time.sleep(_LOOK)
        os.kill(os.getpid(), signal.SIGKILL)  # what is finished is on disk, whole

    threading.Thread(target=watch, daemon=True).start()
