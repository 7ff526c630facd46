"""The search for contact candidates of one collider."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact.solver import contact_node_kernels as kernels
from softprint.runtime.contact.solver.candidates import ActiveSet, Candidates
from softprint.runtime.contact.solver.contact_nodes import CorotatedNodes

# A dent may push in neighbouring nodes that are outside the collider by up to this fraction of its depth. Farther out
# this is rare (under thin and curved colliders, one in fifty active nodes); those are found after the solve.
_MARGIN = 0.25
# The search distance exceeds that of the last depth by this factor, since the next contact is usually about as deep.
_AHEAD = 1.2


@dataclass(frozen=True, eq=False)
class CandidateSearch:
    """Finds the contact nodes near one collider. band: [m], the least search distance outside the collider."""

    collider: Collider
    band: float

    def find(
        self,
        nodes: CorotatedNodes,
        rows: Array,
        pose: RigidPose,
        bounded: tuple[Array, Array],
        active: ActiveSet | None,
        last_depth: float,
    ) -> Candidates | None:
        """The candidates at handle rows (n_rows, dim); None where no node is inside. bounded: see
        `CorotatedNodes.bounded_positions`; active: the active set of a nearby state. Its nodes that the collider pushes
        into the body stay candidates even where their reduced position has passed the collider, so that a thin wall
        stays on its side. last_depth: of the contact of that state [m]; it changes the cost and not the result."""
        searched = max(self.band, _AHEAD * _MARGIN * last_depth)
        index, distance, x = self._near(nodes, rows, pose, searched, bounded)
        depth = max(-float(distance.min(initial=0.0)), 0.0)
        wanted = max(self.band, _MARGIN * depth)
        if wanted > searched:
            index, distance, x = self._near(nodes, rows, pose, wanted, bounded)
        elif wanted < searched:
            near = distance < wanted
            index, distance, x = index[near], distance[near], x[near]
        found = Candidates(index, distance, x, depth, distance < _MARGIN * depth)
        if active is not None:
            found = _with_active_set(found, active, nodes, rows)
        return found if found.depth > 0.0 else None

    def _near(
        self,
        nodes: CorotatedNodes,
        rows: Array,
        pose: RigidPose,
        distance: float,
        bounded: tuple[Array, Array],
    ) -> tuple[IntArray, Array, Array]:
        """The nodes closer to the collider than `distance` [m], their signed distance and position (m, dim) [m]. Exact
        positions are computed only for nodes whose bounds allow this."""
        x, reach = bounded
        if np.isfinite(self.collider.upper).all():
            box = self.collider.lower - distance, self.collider.upper + distance
            close = kernels.near_box(x, pose.rotation, pose.translation, *box, reach)
        else:  # a half-space, whose bounds exclude nothing
            close = np.flatnonzero(self.collider.sdf(pose.apply_inverse(x)) < distance + reach)
        x = x[close] if nodes.condensation is None else nodes.positions(rows, close)
        closer, _, value = self.collider.closer_to(x, pose, distance)
        return close[closer], value, x[closer]


def _with_active_set(found: Candidates, active: ActiveSet, nodes: CorotatedNodes, rows: Array) -> Candidates:
    """The candidates with the active set of a nearby state added. Their depth is zero where no node is inside and the
    collider pushes none of the active set into the body."""
    surface_normal = nodes.nodes.points.surface_normal
    if found.depth == 0.0 and not active.pushed_in(surface_normal).any():
        return found
    found = replace(found, depth=max(found.depth, active.displacement))
    found = found.with_possibly_active(kernels.are_among(found.index, active.index))
    there = kernels.are_among(active.index, found.index)
    if there.all():
        return found
    lost = active.take(~there)
    kept = lost.index[lost.pushed_in(surface_normal)]
    return found.extended(kept, nodes.positions(rows, kept)) if kept.size else found
