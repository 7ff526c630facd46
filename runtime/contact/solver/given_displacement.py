"""What given forces displace contact points by: those of friction, while the pressure is solved for.

Friction bends the surface as contact does. Where it is known from before, phi on the contact nodes, its displacement
c = G phi, in rest coordinates, is carried along like that by contact: the points are at x(q) + A(q) c. Pressure is on
the surface where friction has dragged it, so that a collider that drags the surface far does not end up inside it.
"""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.linalg.means import means, numbered
from softprint.runtime.mechanics.compliance.local_compliance import LocalCompliance


class GivenDisplacement:
    """The displacement of all contact nodes by forces phi (k, dim) [N] on some of them (k,), at least one, in rest
    coordinates. It is computed where it is asked for, once."""

    def __init__(self, compliance: LocalCompliance, nodes: IntArray, forces: Array) -> None:
        self._compliance, self._nodes, self._forces = compliance, nodes, forces
        self._known = np.zeros(len(compliance), dtype=bool)
        self._displacement = np.zeros((len(compliance), forces.shape[1]))
        #: No node is displaced farther [m].
        self.farthest = compliance.farthest(nodes, forces)

    def of_nodes(self, nodes: IntArray) -> Array:
        """c (m, dim) [m] of contact nodes (m,)."""
        new = np.unique(nodes[~self._known[nodes]])
        if len(new):
            self._displacement[new] = self._compliance.displacement(new, self._nodes, self._forces)
            self._known[new] = True
        return np.asarray(self._displacement[nodes])

    def of_points(self, nodes: IntArray, shares: Array) -> Array:
        """c (m, dim) [m] of points between contact nodes (m, c), with shares (m, c) in these."""
        nodes, corners = numbered(nodes, len(self._known))
        return means(self.of_nodes(nodes), corners, shares)
