"""One side of a body as the skin of a tactile sensor: its plane, and points of the surface over that plane.

A side is named by the axis that it looks along at rest, such as "+z". Its frame has the axes u_1 .. u_(dim-1), n: the
outward normal n and, in its plane, the axes that follow it cyclically, so that the frame is right-handed. For "+z" they
are x, y, z. The origin is the middle of the side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import Mesh

# Facets whose normal is within 60 degrees of the side's.
_FACING = 0.5
# Points on an edge between two facets belong to both, round-off included.
_EDGE = -1e-9
_AT_ONCE = 256  # points that are located together


@dataclass(frozen=True, eq=False)
class PadSide:
    """axes: (dim, dim), the axes of the side as rows, the normal last; origin: (dim,) [m]; facets: (f, dim) those of
    the mesh that look along the normal; lower, upper: (dim-1,) [m] where they are in the plane."""

    mesh: Mesh
    axes: Array
    origin: Array
    facets: IntArray
    lower: Array
    upper: Array

    @classmethod
    def of(cls, mesh: Mesh, side: str | None) -> PadSide:
        """That named such as "+z"; None: up, along the last axis. Raises SoftprintError for any other name, and where
        no facet looks that way."""
        axes = _axes(mesh.dim, "+" + "xyz"[mesh.dim - 1] if side is None else side)
        normals = mesh.facet_vectors / np.linalg.norm(mesh.facet_vectors, axis=1, keepdims=True)
        facets = mesh.facets[normals @ axes[-1] > _FACING]
        if not len(facets):
            raise SoftprintError(f"no facet of the surface looks along {side}")
        at = mesh.points[np.unique(facets)] @ axes.T
        lower, upper = at.min(axis=0), at.max(axis=0)
        middle = np.append(0.5 * (lower + upper)[:-1], upper[-1])
        return cls(mesh, axes, middle @ axes, facets, (lower - middle)[:-1], (upper - middle)[:-1])

    def coordinates(self, points: Array) -> Array:
        """Points (n, dim) at rest in the frame of the side."""
        return (points - self.origin) @ self.axes.T

    def surface(self, plane: Array) -> tuple[sp.csr_matrix, BoolArray]:
        """The outermost points of the side over points (n, dim-1) of its plane, as means over nodes (n, n_nodes), and
        over which of them (n,) there are any."""
        corners = self.coordinates(self.mesh.points)[self.facets]
        first = corners[:, 0, :-1]
        sides = np.linalg.inv((corners[:, 1:, :-1] - first[:, None]).transpose(0, 2, 1))
        nodes, shares = (
            np.zeros((len(plane), self.mesh.dim), dtype=np.int64),
            np.zeros((len(plane), self.mesh.dim)),
        )
        found = np.zeros(len(plane), dtype=np.bool_)
        for start in range(0, len(plane), _AT_ONCE):
            part = slice(start, start + _AT_ONCE)
            inner = np.einsum("fij,pfj->pfi", sides, plane[part, None] - first)
            every = np.concatenate([1.0 - inner.sum(axis=2, keepdims=True), inner], axis=2)
            height = np.where((every >= _EDGE).all(axis=2), (every * corners[..., -1]).sum(axis=2), -np.inf)
            best, own = height.argmax(axis=1), np.arange(len(height))
            found[part] = np.isfinite(height[own, best])
            nodes[part], shares[part] = self.facets[best], every[own, best]
        rows = np.repeat(np.flatnonzero(found), self.mesh.dim)
        entries = shares[found].ravel(), (rows, nodes[found].ravel())
        return sp.csr_matrix(entries, (len(plane), self.mesh.n_nodes)), found


def _axes(dim: int, side: str) -> Array:
    """(dim, dim)."""
    names = "xyz"[:dim]
    if len(side) != 2 or side[0] not in "+-" or side[1] not in names:
        known = ", ".join(sign + name for name in names for sign in "+-")
        raise SoftprintError(f"side {side!r}: the sides of a body in {dim}D are {known}")
    axis, sign = names.index(side[1]), 1.0 if side[0] == "+" else -1.0
    axes = np.roll(np.eye(dim), -axis - 1, axis=0)
    axes[-1] *= sign
    # Turned about the first axis in its plane; in 2D there is one axis in its line, which is turned.
    axes[-2] *= np.sign(np.linalg.det(axes))
    return axes
