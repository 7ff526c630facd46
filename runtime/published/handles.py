"""Find the points and frames among the columns of a published basis W, and express the basis in our rows.

A point handle is a node whose row of W is a unit vector. A frame is dim+1 adjacent columns; its region is all nodes
whose rows of W vanish in the other columns, where x = W q is an affine map. Let M = [q_ref | c], with the frame's rows
at rest q_ref and the coefficients c with W c = 1. Then

    x = W q = (W M) (M^-1 q)

and W M = [X 1] in the region, M^-1 q = [R^T; t]: the rows of :mod:`runtime.body.handles`, for any order of the
published rows and any origin of the frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.errors import SoftprintError
from softprint.runtime.published.layout import PublishedObject

# Published arrays are float32: weights have errors of 1e-7, and least-squares fits of them slightly larger ones.
TOLERANCE = 1e-4


@dataclass(frozen=True, eq=False)
class FoundHandles:
    """points: nodes, in the order of our rows; frames: the nodes of each region.

    to_published: (n_rows, n_rows) with q = to_published @ rows, so that W @ to_published is our basis.
    """

    points: IntArray
    frames: tuple[IntArray, ...]
    to_published: Array

    def rows(self, q: Array) -> Array:
        """Our handle rows (..., n_rows, dim) of published transformations (..., n_rows, dim)."""
        return np.asarray(np.linalg.solve(self.to_published, q))


def find_handles(body: PublishedObject, source: str) -> FoundHandles:
    """Points and frames of a published body; SoftprintError if a column belongs to neither."""
    dim, n_rows = body.dim, body.basis.shape[1]
    points: list[tuple[int, int]] = []  # column, node
    frames: list[tuple[slice, IntArray]] = []
    column = 0
    while column < n_rows:
        group = slice(column, column + dim + 1)
        region = _region(body.basis, group)
        if len(region) > dim + 1 and np.linalg.matrix_rank(body.basis[region, group], TOLERANCE) == dim + 1:
            frames.append((group, region))
            column += dim + 1
            continue
        unit = np.flatnonzero(_is_unit(body.basis, column))
        if not len(unit):
            raise SoftprintError(
                f"{source}: column {column} of {body.name}/W is neither a point handle (no node follows it alone) nor "
                f"the first of {dim + 1} columns of a frame"
            )
        points.append((column, int(unit[0])))
        column += 1
    return FoundHandles(
        np.array([node for _, node in points], dtype=np.int64),
        tuple(region for _, region in frames),
        _transformation(body, points, frames),
    )


def _region(basis: Array, group: slice) -> IntArray:
    """Nodes that depend on these columns alone."""
    others = np.ones(basis.shape[1], dtype=bool)
    others[group] = False
    elsewhere = np.abs(basis[:, others]).max(axis=1, initial=0.0)
    return np.flatnonzero(elsewhere < TOLERANCE)


def _is_unit(basis: Array, column: int) -> BoolArray:
    unit = np.zeros(basis.shape[1])
    unit[column] = 1.0
    return np.abs(basis - unit).max(axis=1) < TOLERANCE


def _transformation(
    body: PublishedObject, points: list[tuple[int, int]], frames: list[tuple[slice, IntArray]]
) -> Array:
    blocks = []
    for group, region in frames:
        ones = np.linalg.lstsq(body.basis[region, group], np.ones(len(region)), rcond=None)[0]
        blocks.append(np.column_stack([body.reference[group], ones]))
    ours = scipy.linalg.block_diag(np.eye(len(points)), *blocks)
    order = [column for column, _ in points] + [
        k for group, _ in frames for k in range(group.start, group.stop)
    ]
    published = np.empty_like(ours)
    published[order] = ours
    return published
