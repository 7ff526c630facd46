"""A body's nodes among the ranks of a communicator: sums and exchanges by MPI."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from softprint.fem_truth.parts.share import Numbers, Share
from softprint.runtime.arrays import Array, BoolArray, IntArray


class GroupShare(Share):
    """This rank's share of a body that is partitioned over the ranks of ``comm``.

    present: (n_ranks, n_nodes) whether a node of the body is on a rank. Constructed without communication.
    """

    def __init__(self, comm: MPI.Intracomm, present: BoolArray) -> None:
        self._comm = comm
        owner = present.argmax(axis=0)  # the first rank that has the node
        on_rank = present[comm.rank]
        own = np.flatnonzero(owner == comm.rank)
        foreign = np.flatnonzero(on_rank & (owner != comm.rank))
        #: Nodes of the body on this rank, owned nodes first.
        self.nodes: IntArray = np.concatenate([own, foreign])
        self.owned = slice(0, len(own))
        self.runs = (self.owned, slice(len(own), None))
        number = np.empty(present.shape[1], dtype=np.int64)
        number[self.nodes] = np.arange(len(self.nodes))
        together = {rank: np.flatnonzero(on_rank & present[rank]) for rank in range(comm.size)}
        #: Neighbours in rank order, and the nodes (this rank's numbers) that both have.
        self._common = {
            rank: number[nodes] for rank, nodes in together.items() if len(nodes) and rank != comm.rank
        }
        self._meeting = number[np.flatnonzero(on_rank & (present.sum(axis=0) > 1))]
        self._owned_by_rank = np.argsort(owner, kind="stable")
        self._counts = np.bincount(owner, minlength=comm.size)

    def total(self, numbers: Numbers) -> Numbers:
        """Each rank adds the contributions in rank order, so that all get the same bits; MPI's own sums do not ensure
        this."""
        added = self._from_all(numbers).sum(axis=0)
        return float(added) if isinstance(numbers, float) else added

    def smallest(self, number: float) -> float:
        return float(self._from_all(number).min())

    def largest(self, number: float) -> float:
        return float(self._from_all(number).max())

    def stacked(self, rows: Array) -> Array:
        return np.concatenate(self._comm.allgather(rows))

    def assemble(self, shares: Array) -> None:
        own = shares[self._meeting]
        received = self._exchange(shares)
        shares[self._meeting] = 0.0
        for rank in range(self._comm.size):  # in rank order, so that all get the same sum
            if rank == self._comm.rank:
                shares[self._meeting] += own
            elif rank in received:
                shares[self._common[rank]] += received[rank]

    def assembled(self, shares: Array) -> Array:
        values = shares.copy()
        self.assemble(values)
        return values

    def agreed(self, values: Array) -> Array:
        of_owners = np.zeros_like(values)
        of_owners[self.owned] = values[self.owned]
        self.assemble(of_owners)
        return of_owners

    def take(self, values: Array) -> Array:
        return np.asarray(values[self.nodes])

    def gather(self, values: Array) -> Array:
        own = np.ascontiguousarray(values[self.owned])
        by_rank = np.empty((len(self._owned_by_rank), *values.shape[1:]), dtype=values.dtype)
        sizes = self._counts * (by_rank.nbytes // len(by_rank))
        self._comm.Allgatherv([own, MPI.BYTE], [by_rank, sizes.tolist(), MPI.BYTE])
        gathered = np.empty_like(by_rank)
        gathered[self._owned_by_rank] = by_rank
        return gathered

    def _from_all(self, numbers: float | Array) -> Array:
        mine = np.ascontiguousarray(numbers)
        every = np.empty((self._comm.size, *mine.shape), dtype=mine.dtype)
        self._comm.Allgather([mine, MPI.BYTE], [every, MPI.BYTE])
        return every

    def _exchange(self, values: Array) -> dict[int, Array]:
        """The neighbours' values at the nodes they share with this rank."""
        sent = {rank: values[nodes] for rank, nodes in self._common.items()}
        received = {rank: np.empty_like(buffer) for rank, buffer in sent.items()}
        requests = [self._comm.Irecv([buffer, MPI.BYTE], source=rank) for rank, buffer in received.items()]
        requests += [self._comm.Isend([buffer, MPI.BYTE], dest=rank) for rank, buffer in sent.items()]
        MPI.Request.Waitall(requests)
        return received


def nodes_of_parts(cells: IntArray, part: IntArray, n_parts: int, n_nodes: int) -> BoolArray:
    """(n_parts, n_nodes): whether a cell of the part has the node. cells: (n_cells, dim + 1); part: (n_cells,)."""
    present = np.zeros((n_parts, n_nodes), dtype=bool)
    for number in range(n_parts):
        present[number, cells[part == number]] = True
    return present
