"""The nodes of a body that are on this rank, and sums over all of its nodes.

A body that several ranks solve together is partitioned by cells. A rank has the cells of its part and the nodes of
these cells. A node on the boundary between parts is on several ranks, and *owned* by the first of them; a rank numbers
its owned nodes first. A vector over the nodes of a rank, (n, dim), is one of two things:

    values   positions, steps, residuals: at a node that is on several ranks, the same on all of them;
    shares   of a gradient or a product with the Hessian: the contributions of this rank's cells, and for terms
             that sum over nodes those of its owned nodes. `assemble` adds them up, which makes them values.

Matrices and energies are always shares. Therefore elements, contact and their matrices need no data of other ranks.

**The rule:** everything that controls a solve (a branch, the end of a loop) is computed from numbers that `total`,
`smallest`, `largest` or another method here has returned, which are bitwise equal on all ranks. If ranks decided by
their local numbers, one could leave a loop in which the others wait for it for ever.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from softprint.runtime.arrays import Array

Numbers = TypeVar("Numbers", float, Array)


class Share:
    """All nodes are on this rank: each sum is complete as it is.

    owned: the rows of a node vector that this rank owns; runs: the ranges `owned` and, if there are any, the other
    nodes.
    """

    owned: slice = slice(None)
    runs: tuple[slice, ...] = (slice(None),)

    def total(self, numbers: Numbers) -> Numbers:
        """The sum of a number, or of an array, over the ranks."""
        return numbers

    def smallest(self, number: float) -> float:
        """The smallest of a number over the ranks."""
        return number

    def largest(self, number: float) -> float:
        """The largest of a number over the ranks."""
        return number

    def stacked(self, rows: Array) -> Array:
        """The rows (k, ...) of all ranks stacked; k may differ."""
        return rows

    def assemble(self, shares: Array) -> None:
        """Turn shares (n, ...) into values, in place."""

    def assembled(self, shares: Array) -> Array:
        """The values of shares (n, ...), which are not changed."""
        return shares

    def agreed(self, values: Array) -> Array:
        """Values (n, ...) replaced by those of the owner, in case round-off has made them differ."""
        return values

    def n_nodes(self, values: Array) -> int:
        """Number of nodes of the body. values: any (n, ...)."""
        return round(self.total(float(len(values[self.owned]))))

    def take(self, values: Array) -> Array:
        """Values at the nodes on this rank (n, ...), from those at all nodes of the body (n_nodes, ...)."""
        return values

    def gather(self, values: Array) -> Array:
        """Values at all nodes of the body, (n_nodes, ...) in its order, on every rank."""
        return values

    def dot(self, v: Array, w: Array) -> float:
        """v . w over all nodes, of values."""
        return self.total(float(np.vdot(v[self.owned], w[self.owned])))

    def norm(self, v: Array) -> float:
        """|v| over all nodes, of values."""
        return float(np.sqrt(self.dot(v, v)))


#: The share of a rank that holds the whole body.
WHOLE = Share()
