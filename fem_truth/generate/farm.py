"""Dynamic distribution of units of work over groups of MPI ranks: a free group takes the next unit.

A group is one rank, or several ranks that each have a part of the body and solve together. The number of the next unit
is a counter in the memory of rank 0. The first rank of a group reads and increments it with one atomic, one-sided
operation (MPI_Fetch_and_op) and broadcasts it to its group. There is no master rank, so no rank is idle; at the end,
groups differ by at most one unit. The result of a unit must not depend on the group that computes it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar, cast

import numpy as np
from mpi4py import MPI

from softprint.runtime.errors import SoftprintError

T = TypeVar("T")


@dataclass(frozen=True)
class Budget:
    """When to stop taking new units: after ``units`` units in total, or at ``deadline`` (time.monotonic()
    [s])."""

    units: int | None = None
    deadline: float | None = None

    @property
    def is_over(self) -> bool:
        return self.deadline is not None and time.monotonic() >= self.deadline


@dataclass(frozen=True)
class Groups:
    """The ranks of a run (``world``) in groups of equal size; solve: the communicator of this rank's group."""

    world: MPI.Intracomm
    solve: MPI.Intracomm

    @classmethod
    def of(cls, world: MPI.Intracomm, ranks_per_solve: int = 1) -> Groups:
        """Collective. Consecutive ranks form a group, because launchers place those on one machine. Raises
        SoftprintError if the number of ranks is not a multiple of the group size."""
        if ranks_per_solve < 1:
            raise SoftprintError(f"--ranks-per-solve {ranks_per_solve}: must be at least 1")
        if world.size % ranks_per_solve:
            raise SoftprintError(
                f"--ranks-per-solve {ranks_per_solve}: {world.size} rank(s) do not divide into groups of that size; "
                f"start a multiple of it (mpirun -n {ranks_per_solve * (1 + world.size // ranks_per_solve)}), "
                f"or choose a divisor of {world.size}"
            )
        if ranks_per_solve == 1:
            return cls(world, MPI.COMM_SELF)
        return cls(world, cast(MPI.Intracomm, world.Split(world.rank // ranks_per_solve, world.rank)))

    @property
    def leads(self) -> bool:
        """Whether this rank is the first of its group: the one that writes the group's results."""
        return self.solve.rank == 0


class Counter:
    """A counter shared by all ranks. Creating and freeing it is collective."""

    def __init__(self, comm: MPI.Intracomm) -> None:
        size = MPI.INT64_T.Get_size()
        self._window = MPI.Win.Allocate(size if comm.rank == 0 else 0, size, comm=comm)
        if comm.rank == 0:
            self._window.Lock(0)
            self._window.Put(np.zeros(1, dtype=np.int64), 0)
            self._window.Unlock(0)
        comm.Barrier()

    def next(self) -> int:
        """Increment the counter and return its previous value."""
        one, before = np.ones(1, dtype=np.int64), np.empty(1, dtype=np.int64)
        self._window.Lock(0, lock_type=MPI.LOCK_SHARED)
        self._window.Fetch_and_op(one, before, 0, 0, MPI.SUM)
        self._window.Unlock(0)
        return int(before[0])

    def free(self) -> None:
        self._window.Free()


def share_units(
    groups: Groups,
    units: Sequence[int],
    work: Callable[[int], None],
    budget: Budget = Budget(),
    progress: Callable[[int], None] = lambda taken: None,
) -> None:
    """Call work(unit) once for each of ``units``, in order, on all ranks of one of the groups, until the budget is
    spent.

    Collective, with the same ``units`` on every rank; returns on all ranks when all are done. progress(n) is called
    when this rank's group takes a unit, where n is the number of units that all groups have taken before. After an
    exception in ``work``, the other ranks (also those of the same group) wait for ever: the command line ends them all
    (`runtime.cli.ranks.end_all_ranks`).
    """
    last = len(units) if budget.units is None else min(len(units), budget.units)
    counter = Counter(groups.world)

    def take() -> int:
        number = last
        if groups.leads and not budget.is_over:
            number = counter.next()
        return int(groups.solve.bcast(number))

    while (number := take()) < last:
        progress(number)
        work(units[number])
    wait_idly(groups.world)
    counter.free()


def wait_idly(comm: MPI.Comm) -> None:
    """A barrier that sleeps. MPI's own barrier spins and would take a core from a rank that still works."""
    request = comm.Ibarrier()
    while not request.Test():
        time.sleep(0.01)


def on_first_rank(comm: MPI.Intracomm, work: Callable[[], T]) -> T:
    """Call ``work`` on rank 0 only; all ranks return its result, or raise its SoftprintError."""
    outcome: tuple[T | None, str | None] = (None, None)
    if comm.rank == 0:
        try:
            outcome = (work(), None)
        except SoftprintError as error:
            outcome = (None, str(error))
    wait_idly(comm)
    result, trouble = comm.bcast(outcome, root=0)
    if trouble is not None:
        raise SoftprintError(trouble)
    return cast(T, result)


def first_rank_first(comm: MPI.Intracomm, work: Callable[[], T]) -> T:
    """Call ``work`` on all ranks, on rank 0 before the others: for work that fills a shared cache."""
    made: list[T] = []
    on_first_rank(comm, lambda: made.append(work()))
    return made[0] if made else work()
