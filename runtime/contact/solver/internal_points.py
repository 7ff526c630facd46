"""An internal correction of a body at contact points that are weighted means of its nodes.

Contact acts at the corrected points, x + u(q). u is not affine in the handle rows q, so that forces f add f . d2u to
the Hessian of contact, besides du to the Jacobian of the points.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.elasticity.displacement_field import BoundInternal, CorrectionField, InternalField
from softprint.runtime.linalg.means import means, numbered


@dataclass(frozen=True, eq=False)
class InternalPoints:
    """u of n points. of_nodes: of k nodes; corners: (n, c) the nodes, among these, that each point is the mean of, with
    weights (n, c)."""

    of_nodes: BoundInternal
    corners: IntArray
    weights: Array
    _last: list[tuple[Array, Array]] = field(default_factory=list, repr=False)

    @classmethod
    def at(
        cls, internal: InternalField, corners: IntArray, weights: Array, nodes: IntArray | None = None
    ) -> InternalPoints:
        """At means of the nodes of a body: corners, weights (n, c). nodes: (k,) those of `of_nodes`, ascending, by
        default the corners."""
        nodes = np.unique(corners) if nodes is None else nodes
        return cls(internal.bind(nodes), np.searchsorted(nodes, corners), weights)

    def of_corners(self, rows: Array) -> Array:
        """u (k, dim) [m] of the nodes at handle rows (n_rows, dim). The last is kept, since a contact solve asks for it
        several times; this affects the cost and never the result."""
        last = self._last[0] if self._last else None  # read once, as another thread may replace it
        if last is None or last[0] is not rows:
            last = rows, self.of_nodes.displacement(rows)
            self._last[:] = [last]
        return last[1]

    def displacement(self, rows: Array, index: IntArray | None = None) -> Array:
        """u (m, dim) [m] of some of the points (all by default) at handle rows (n_rows, dim)."""
        corners, weights = self.corners, self.weights
        if index is not None:
            corners, weights = corners[index], weights[index]
        return means(self.of_corners(rows), corners, weights)

    def motion(
        self, rows: Array, index: IntArray, others: tuple[InternalPoints, IntArray] | None = None
    ) -> InternalMotion:
        """The derivatives of some of the points (m,) at handle rows (n_rows, dim), followed by some of other points of
        the same nodes."""
        corners, weights = self.corners[index], self.weights[index]
        if others is not None:
            points, own = others
            corners = np.concatenate([corners, points.corners[own]])
            weights = np.concatenate([weights, points.weights[own]])
        nodes, corners = numbered(corners, len(self.of_corners(rows)))
        return InternalMotion(self.of_nodes.at(nodes).linearise(rows), corners, weights)


@dataclass(frozen=True, eq=False)
class InternalMotion:
    """How m points move with the handle rows, by the correction alone. of_nodes: of their k corners; corners, weights
    (m, c)."""

    of_nodes: CorrectionField
    corners: IntArray
    weights: Array

    @property
    def jacobian(self) -> Array:
        """du (m, dim, n_rows*dim)."""
        k, dim = self.of_nodes.displacement.shape
        return means(
            self.of_nodes.along(None).astype(np.float64).reshape(k, dim, -1), self.corners, self.weights
        )

    def pulled_back(self, forces: Array) -> Array:
        """sum_j f_j . du_j/drows (n_rows, dim) [N] of forces f (m, dim) [N]."""
        return self.of_nodes.pulled_back(self._on_corners(forces))

    def curvature(self, forces: Array, along: Array | None) -> Array | None:
        """sum_j f_j . d2u_j/drows2, see `CorrectionField.curvature`."""
        return self.of_nodes.curvature(self._on_corners(forces), along)

    def _on_corners(self, forces: Array) -> Array:
        """The same forces on the corners (k, dim)."""
        total = np.zeros_like(self.of_nodes.displacement)
        np.add.at(total, self.corners, self.weights[..., None] * forces[:, None])
        return total
