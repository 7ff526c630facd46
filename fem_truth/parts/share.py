"""The nodes of a body that are on this rank, and sums over all of its nodes.

A body that several ranks solve together is cut into parts by its cells. A rank holds the cells of its part and the
nodes of these cells. Where parts meet, a node is on several ranks, and *owned* by the first of them; a rank counts
its own nodes first. A vector over the nodes of a rank, (n, dim), is one of two things:

    values   positions, steps, residuals: at a node that is on several ranks, the same on all of them;
    shares   of a gradient or a product with the Hessian: what the cells of this rank contribute, and for terms
             that sum over nodes what its own nodes do. `assemble` adds them up and so makes values of them.

Matrices and energies are always shares. So elements, contact and their matrices know nothing of other ranks.

**The rule:** what decides the course of a solve (a branch, the end of a loop) is computed from numbers that `total`,
`smallest`, `largest` or another method here has returned, which are the same on all ranks to the last bit. Where
ranks decide by numbers of their own, one leaves a loop in which the others wait for it for ever.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from runtime.arrays import Array

Numbers = TypeVar("Numbers", float, Array)


class Share:
    """All nodes are on this rank: each sum is complete as it is.

    owned: the rows of a node vector that this rank owns; runs: `owned`, then the other nodes, if there are any.
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
        """The rows (k, ...) of all ranks, k differing, below each other."""
        return rows

    def assemble(self, shares: Array) -> None:
        """Make values of shares (n, ...), in place."""

    def assembled(self, shares: Array) -> Array:
        """The values that belong to shares (n, ...), which stay as they are."""
        return shares

    def agreed(self, values: Array) -> Array:
        """Values (n, ...) with those of the owner where round-off has made them differ."""
        return values

    def n_nodes(self, values: Array) -> int:
        """How many nodes the body has. values: any (n, ...)."""
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
