"""Where the sharp points of one collider meet the deformed surface of a body: the nearest point of the surface to each.

Both laws of sharp points begin here: that of full space (`sharp_planes.py`), and that of reduced bodies without
mechanics (`sharp_contact.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.colliders.sharp_points import away_from, radii_of_curvature, sharp_points
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.contact.piercing_kernels import bounds, in_box
from softprint.runtime.contact.stretched_gaps import bearing_share, longest_edges
from softprint.runtime.contact.surface_quadrature import FacetPoints
from softprint.runtime.mesh.mesh import Mesh
from softprint.runtime.mesh.nearest_facets import SurfaceSearch

# The largest radius that fits between the contact points on facets, over their spacing. Twice that of the largest
# circle on the surface without one is 1 and 1.15: with that the legs of a chair slip through a surface of fine facets.
_FITS = {2: 1.3, 3: 1.5}


@dataclass(frozen=True, eq=False)
class Met:
    """k sharp points near the surface. place: p (k, dim) [m], in the collider's coordinates; world: p (k, dim) [m];
    facet: (k,) of the surface, the nearest; points: c on it, the nearest; depth: of p below the surface (k,) [m],
    negative outside; share: (k,) of the area of p that bears (`stretched_gaps.py`)."""

    place: Array
    world: Array
    facet: IntArray
    points: FacetPoints
    depth: Array
    share: Array

    def where(self, chosen: BoolArray) -> Met:
        """Some of them: chosen (k,)."""
        points = FacetPoints(self.points.nodes[chosen], self.points.shares[chosen])
        return Met(
            self.place[chosen],
            self.world[chosen],
            self.facet[chosen],
            points,
            self.depth[chosen],
            self.share[chosen],
        )


class SharpPointSearch:
    """The sharp points of a collider, found once, and the surface that they press. spacing: of the points [m];
    weight: a k [N/m^2], of a law W = a (k/3) d^3 for each."""

    def __init__(self, collider: Collider, law: PenaltyContact, mesh: Mesh, blunt: float = 1.0) -> None:
        """law: with contact on facets; blunt: parts with radii up to so many times that of sharp ones have points, too,
        which bear where the surface is stretched."""
        self.spacing = law.sharp_spacing(mesh)
        self.weight = law.stiffness * self.spacing ** (mesh.dim - 1)
        sharp = sharp_points(collider, self.spacing)
        others = sharp[:0]
        if blunt > 1.0:
            others = sharp_points(collider, self.spacing, blunt * self.spacing)
            others = away_from(others, sharp, 0.5 * self.spacing)
        self._points = np.concatenate([sharp, others])
        fits = _FITS[mesh.dim] * self.spacing
        stretch = radii_of_curvature(collider, others, self.spacing) / fits
        self._stretch = np.concatenate([np.zeros(len(sharp)), stretch])
        self._facets, self._rest = mesh.facets, longest_edges(mesh.points, mesh.facets)
        self._search = SurfaceSearch(mesh.points, mesh.facets)
        # Where the search began to find points last time; this changes the cost and never the result.
        self._near = np.zeros(len(self._points), dtype=np.int64)

    def __len__(self) -> int:
        """How many sharp points there are."""
        return len(self._points)

    def met(self, x: Array, pose: RigidPose, margin: float) -> Met:
        """Those deeper than -margin [m] under the surface, with nodes at x (n_nodes, dim) [m]."""
        stretch = longest_edges(x, self._facets) / self._rest
        p = pose.apply(self._points)
        lower, upper = bounds(x)
        about = in_box(p, lower - margin, upper + margin)
        about = about[self._stretch[about] < stretch.max()]
        facet, shares, depth = self._search.nearest(p[about], x, self._near[about], margin)
        self._near[about] = facet
        share = bearing_share(self._stretch[about], stretch[facet])
        points = FacetPoints(self._facets[facet], shares)
        found = Met(self._points[about], p[about], facet, points, depth, share)
        return found.where((depth > -margin) & (share > 0.0))
