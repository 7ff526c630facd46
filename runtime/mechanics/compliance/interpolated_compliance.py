"""The compliance among contact points that lie between the contact nodes: N G N^T (`loaded_points.py`)."""

from __future__ import annotations

from softprint.runtime.arrays import Array, IntArray, same
from softprint.runtime.linalg.means import means
from softprint.runtime.mechanics.compliance.local_compliance import LocalCompliance
from softprint.runtime.mechanics.compliance.surface_compliance_kernels import NodalCompliance
from softprint.runtime.mechanics.loaded_points import LoadedPoints


class InterpolatedCompliance:
    """That of `points`, interpolated from that of the contact nodes. Like `LocalCompliance`, it caches what was last
    asked for; this affects the cost and never the result."""

    def __init__(self, of_nodes: LocalCompliance, points: LoadedPoints) -> None:
        self._of_nodes, self._points = of_nodes, points
        self._last: tuple[IntArray, NodalCompliance] | None = None

    def among(self, points: IntArray) -> NodalCompliance:
        """Among the points (m,)."""
        last = self._last  # read once, as another thread may replace it
        if last is None or not same(points, last[0]):
            nodes, corners, shares = self._points.among(points)
            self._last = last = points.copy(), NodalCompliance(self._of_nodes.among(nodes), corners, shares)
        return last[1]

    def on_nodes(self, points: IntArray, forces: Array) -> tuple[IntArray, Array]:
        """The contact nodes (k,) that forces (m, dim) on points (m,) act on, and their forces (k, dim)."""
        return self._points.to_nodes(points, forces)

    def displacement(self, at: IntArray, nodes: IntArray, forces: Array) -> Array:
        """sum_j G_ij phi_j (n, dim) [m] at points `at` (n,) by forces phi (k, dim) [N] on contact nodes (k,), both in
        rest coordinates."""
        own, corners, shares = self._points.among(at)
        moved = self._of_nodes.displacement(own, nodes, forces)
        return means(moved, corners, shares)

    def farthest(self, nodes: IntArray, forces: Array) -> float:
        """See `LocalCompliance`: no point is displaced farther than the nodes that it is between."""
        return self._of_nodes.farthest(nodes, forces)
