"""The search for contact candidates of one collider."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact.solver import contact_point_kernels as kernels
from softprint.runtime.contact.solver.candidates import MARGIN, ActiveSet, Candidates
from softprint.runtime.contact.solver.contact_points import CorotatedPoints

# A collider is thin where points are displaced by more than this multiple of the depth of the deepest.
_THIN = 1.5
# The search distance exceeds that of the last depth by this factor, since the next contact is usually about as deep.
_AHEAD = 1.2


@dataclass(frozen=True, eq=False)
class CandidateSearch:
    """Finds the contact points near one collider. band: [m], the least search distance outside the collider."""

    collider: Collider
    band: float

    def find(
        self,
        points: CorotatedPoints,
        rows: Array,
        pose: RigidPose,
        bounded: tuple[Array, Array],
        active: ActiveSet | None,
        last_depth: float,
    ) -> Candidates | None:
        """The candidates at handle rows (n_rows, dim); None where no point is inside. bounded: see
        `CorotatedPoints.bounded_positions`; active: the active set of a nearby state. Its points that the collider
        pushes into the body stay candidates even where their reduced position has passed the collider, so that a thin
        wall stays on its side, or has not reached it, so that what another collider's dent pushes into this one stays
        there. last_depth: of the contact of that state [m]; it changes the cost and not the result."""
        searched = max(self.band, _AHEAD * MARGIN * last_depth)
        index, distance, x = self.closer(points, rows, pose, searched, bounded)
        depth = max(-float(distance.min(initial=0.0)), 0.0)
        wanted = max(self.band, MARGIN * depth, _passed(active, depth))
        if wanted > searched:
            index, distance, x = self.closer(points, rows, pose, wanted, bounded)
        elif wanted < searched:
            near = distance < wanted
            index, distance, x = index[near], distance[near], x[near]
        found = Candidates(index, distance, x, depth, distance < MARGIN * depth)
        if active is not None:
            found = _with_active_set(found, active, points, rows)
        return found if found.depth > 0.0 else None

    def closer(
        self,
        points: CorotatedPoints,
        rows: Array,
        pose: RigidPose,
        distance: float,
        bounded: tuple[Array, Array],
    ) -> tuple[IntArray, Array, Array]:
        """The points (m,) closer to the collider than `distance` [m], their signed distance and position (m, dim) [m].
        Exact positions are computed only for points whose bounds allow this."""
        x, reach = bounded
        if np.isfinite(self.collider.upper).all():
            box = self.collider.lower - distance, self.collider.upper + distance
            close = kernels.near_box(x, pose.rotation, pose.translation, *box, reach)
        else:  # a half-space, whose bounds exclude nothing
            close = np.flatnonzero(self.collider.sdf(pose.apply_inverse(x)) < distance + reach)
        x = x[close] if points.bounds_are_exact else points.positions(rows, close)
        closer, _, value = self.collider.closer_to(x, pose, distance)
        return close[closer], value, x[closer]


def _passed(active: ActiveSet | None, depth: float) -> float:
    """How far outside a collider reduced positions may have passed through it [m]: where points are displaced farther
    than any of them is deep, the collider is thin. The dent may then take others along to its far side, from which it
    would push them the wrong way; they are looked for by their displaced positions."""
    if active is None or active.displacement <= _THIN * depth:
        return 0.0
    return active.displacement


def _with_active_set(
    found: Candidates, active: ActiveSet, points: CorotatedPoints, rows: Array
) -> Candidates:
    """The candidates with the active set of a nearby state added. Their depth is zero where no point is inside and the
    collider pushes none of the active set into the body."""
    surface_normal = points.points.material.surface_normal
    if found.depth == 0.0 and not active.pushed_in(surface_normal).any():
        return found
    found = replace(found, depth=max(found.depth, active.displacement))
    found = found.with_possibly_active(kernels.are_among(found.index, active.index))
    there = kernels.are_among(active.index, found.index)
    if there.all():
        return found
    lost = active.take(~there)
    kept = lost.index[lost.pushed_in(surface_normal)]
    return found.extended(kept, points.positions(rows, kept)) if kept.size else found
