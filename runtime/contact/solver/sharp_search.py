"""The search for the points of a reduced body's surface that tips, edges and thin limbs of colliders press.

The surface near the sharp points is deformed as far as it is known before the contact solve: by the handle rows, static
condensation, and the contact forces of the warm start. So a point that is pressed along keeps its side, and few facets
are looked at, whatever the size of the mesh.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.rotations import nearest_rotations
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import Poses, RigidPose
from softprint.runtime.colliders.sharp_points import (
    away_from,
    bearing_normals,
    radii_of_curvature,
    sharp_points,
)
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.contact.piercing_kernels import bounds, in_box
from softprint.runtime.contact.sharp_planes import inward_normals
from softprint.runtime.contact.solver.contact_points import ContactPoints, CorotatedPoints
from softprint.runtime.contact.solver.contact_solve_kernels import to_world
from softprint.runtime.contact.solver.pressed_points import PressedPoints, SurfaceNodes
from softprint.runtime.contact.stretched_gaps import BLUNT, bearing_share, longest_edges
from softprint.runtime.elasticity.invariants import cofactor
from softprint.runtime.linalg.means import numbered
from softprint.runtime.linalg.row_products import deformed_some, placed_some
from softprint.runtime.mechanics.compliance.local_compliance import LocalCompliance
from softprint.runtime.mechanics.loaded_points import Gaps
from softprint.runtime.mesh.mesh import Mesh
from softprint.runtime.mesh.nearest_facets import grouped_by_place, nearest_of

# Facets are looked at around the sharp points as far as the surface may be displaced: this multiple of the last
# displacement by contact, and so many distances between surface nodes.
_DISPLACED, _AROUND = 1.1, 1.5
# A sharp point is pressed, or soon may be, from so many distances between surface nodes above the surface on: on tips
# and edges, and on parts that fit between contact points, which also touch these.
_SOON = 1.0, 0.25
# Parts of a collider fit between contact points if their radius is less than so many gaps between these.
_GAPS = 2.0
# Places of the surface are not the same if they are this many distances between surface nodes apart. On the demo, a
# quarter of that changes the distance from full space by 0.001 N and 0.002 mm, and costs more.
_ANOTHER = 0.2
# A point on a facet at the edge of a rigid frame needs this share of the facet's weights on nodes that can move.
_LEAST_SHARE = 0.05


class Dent(NamedTuple):
    """The displacement by contact that is known before a solve: forces (k, dim) [N] on contact nodes (k,), in rest
    coordinates, and how far no point is displaced by them [m]."""

    nodes: IntArray
    forces: Array
    farthest: float


class _Undented(NamedTuple):
    """The surface about sharp points of a collider, without the displacement by contact. farthest: how far contact may
    displace it [m]; nodes: (k,) of the surface, facets: (f, dim) between these, their longest edges at rest (f,) [m],
    and their groups (f,), in which they are searched; F: (k, dim, dim), positions: (k, dim) [m], and normals: (k, dim),
    outward, of any length, of these nodes."""

    farthest: float
    nodes: IntArray
    facets: IntArray
    longest: Array
    group: IntArray
    F: Array
    positions: Array
    normals: Array


@dataclass(frozen=True, eq=False)
class SharpCollider:
    """One of several colliders, with its number and name. points: (m, dim) [m] its sharp points, in its coordinates,
    spacing: (m,) [m] of these, and group: (m,) of neighbours: first the n_edges on tips and edges, then those on parts
    that fit, or in a stretched surface may fit, between the contact points on facets, and are held where these let them
    through. stretch: (m,) of the surface from which on they fit (`stretched_gaps.py`), 0 on tips and edges."""

    number: int
    name: str
    collider: Collider
    points: Array
    spacing: Array
    group: IntArray
    stretch: Array
    n_edges: int

    @classmethod
    def of(cls, number: int, name: str, collider: Collider, spacing: float, gaps: Gaps) -> SharpCollider:
        """spacing: of the points on tips and edges [m]; gaps: between the contact points on facets."""
        apart, fits = max(spacing, 0.5 * gaps.spacing), _GAPS * gaps.radius
        edges = sharp_points(collider, spacing)
        others = away_from(sharp_points(collider, apart, BLUNT * fits), edges, 0.5 * apart)
        both = np.repeat([spacing, apart], [len(edges), len(others)])
        # Groups are of one kind, and numbered in ascending order.
        (first, of_edges), (second, of_others) = grouped_by_place(edges), grouped_by_place(others)
        points, group = (edges[first], others[second]), (of_edges, len(edges) + of_others)
        stretch = np.zeros(len(edges)), radii_of_curvature(collider, points[1], apart) / fits
        columns = (np.concatenate(points), both, np.concatenate(group), np.concatenate(stretch))
        return cls(number, name, collider, *columns, len(edges))


def sharp_colliders(
    colliders: Mapping[str, Collider], law: PenaltyContact, mesh: Mesh, gaps: Callable[[], Gaps]
) -> list[SharpCollider]:
    """Those of the colliders that have sharp points; none where contact is at nodes. gaps: computes those between the
    contact points."""
    if not law.refinement:
        return []
    between = gaps()
    found = [
        SharpCollider.of(number, name, collider, law.sharp_spacing(mesh), between)
        for number, (name, collider) in enumerate(colliders.items())
    ]
    return [sharp for sharp in found if len(sharp.points)]


class SharpSearch:
    """Finds `PressedPoints`. areas: (m,) that the sharp points of all colliders stand for [m^(dim-1)]; surface: the
    nodes of the facets that can be pressed."""

    def __init__(
        self,
        body: ReducedBody,
        colliders: Sequence[SharpCollider],
        owner: IntArray,
        compliance: LocalCompliance,
        points: ContactPoints,
        nodes: IntArray,
    ) -> None:
        """owner: (n_nodes,) contact node of every node of the mesh, -1 for none; compliance: of the contact nodes;
        points: the contact points on the facets; nodes: (k,) those of the facets, ascending."""
        mesh = body.mesh
        self.areas = np.concatenate([sharp.spacing for sharp in colliders]) ** (mesh.dim - 1)
        self.surface = SurfaceNodes(
            nodes, body.node_points(nodes), points.condensation, points.internal
        )
        self._gradients = np.ascontiguousarray(self.surface.material.basis_gradient.transpose(0, 2, 1))
        self._owner, self._compliance, self._spacing = owner[nodes], compliance, mesh.surface_spacing
        facets = bearing_facets(mesh.facets, owner)
        order, self._group = grouped_by_place(mesh.points[facets].mean(axis=1))
        facets = facets[order]
        self._facets, self._longest = np.searchsorted(nodes, facets), longest_edges(mesh.points, facets)
        # The contact point that is nearest at rest: whether a facet is near is decided by its position.
        self._beside = cKDTree(points.material.rest).query(mesh.points[facets].mean(axis=1))[1]
        self._first = len(points.material)
        counts = np.cumsum([self._first, *(len(sharp.points) for sharp in colliders)])
        self._last: dict[int, tuple[tuple[object, ...], _Undented]] = {}
        self._sharp = list(zip(counts[:-1].tolist(), colliders, strict=True))

    def find(
        self,
        points: CorotatedPoints,
        rows: Array,
        poses: Poses,
        x: Array,
        dent: Dent | None,
    ) -> PressedPoints | None:
        """The points pressed at handle rows (n_rows, dim), and those that soon may be; None where there are none. x:
        approximate positions (n, dim) [m] of the contact points on the facets; dent: None without a warm start."""
        lower, upper = bounds(x)
        margin = 0.0 if dent is None else dent.farthest
        parts = []
        for first, sharp in self._sharp:
            p = poses[sharp.name].apply(sharp.points)
            which = in_box(p, lower - margin, upper + margin)
            if not len(which):
                continue
            own = self._undented(sharp, p[which], points, rows, poses[sharp.name], x, dent)
            part = self._pressed_by(sharp, own, which, p[which], poses[sharp.name], dent)
            if part is not None:
                parts.append((first + part[0], *part[1:]))
        if not parts:
            return None
        return PressedPoints(self._first, *(np.concatenate(column) for column in zip(*parts, strict=True)))

    def have_slid(
        self, pressed: PressedPoints, which: IntArray, y: Array, poses: Sequence[RigidPose]
    ) -> bool:
        """Whether one of some of the pressed points (k,), displaced to y (k, dim) [m], is no longer what its sharp
        point presses, since it has slid along the plane through that. poses: of all colliders, by number."""
        slid = pressed.planes(which).placed(pressed.collider[which], poses).along(y)
        return bool((np.linalg.norm(slid, axis=1) > _ANOTHER * self._spacing).any())

    def _pressed_by(
        self,
        sharp: SharpCollider,
        own: _Undented,
        which: IntArray,
        p: Array,
        pose: RigidPose,
        dent: Dent | None,
    ) -> tuple[Array | IntArray, ...] | None:
        """The columns of `PressedPoints`, with the numbers of its own sharp points, of some of these (j,), at p (j,
        dim) [m]; None where there are none."""
        if not len(own.facets):
            return None
        y = self._dented(own, dent)
        stretch = longest_edges(y, own.facets) / own.longest
        fits = sharp.stretch[which] < stretch.max()
        which, p = which[fits], p[fits]
        soon = self._spacing * np.where(which < sharp.n_edges, *_SOON)
        groups = own.group, sharp.group[which]
        facet, weights, depth = nearest_of(p, y, own.facets, groups, float(soon.max(initial=0.0)))
        of = self._owner[own.nodes[own.facets[facet]]]
        shares = np.where(of >= 0, weights, 0.0)
        share = bearing_share(sharp.stretch[which], stretch[facet])
        kept = np.flatnonzero((depth > -soon) & (shares.sum(axis=1) > _LEAST_SHARE) & (share > 0.0))
        z, corners = sharp.points[which[kept]], own.facets[facet[kept]]
        against = inward_normals(corners, weights[kept], own.normals, pose)
        direction, bearing = bearing_normals(sharp.collider, z, against, sharp.spacing[which[kept]])
        kept, z, corners, direction = kept[bearing], z[bearing], corners[bearing], direction[bearing]
        if not len(kept):
            return None
        return (
            which[kept],
            np.full(len(kept), sharp.number),
            share[kept],
            self.surface.nodes[own.nodes[corners]],
            weights[kept],
            np.maximum(of[kept], 0),
            shares[kept],
            z,
            direction,
        )

    def _undented(
        self,
        sharp: SharpCollider,
        p: Array,
        points: CorotatedPoints,
        rows: Array,
        pose: RigidPose,
        x: Array,
        dent: Dent | None,
    ) -> _Undented:
        """About sharp points of a collider, at p (j, dim) [m]. The last is kept, as these are looked for again with
        another dent."""
        farthest = 0.0 if dent is None else dent.farthest
        farthest += 0.0 if points.given is None else points.given.farthest
        last, key = self._last.get(sharp.number), (points, rows, pose)
        if last is not None and all(map(operator.is_, last[0], key)) and farthest <= last[1].farthest:
            return last[1]
        lower, upper = bounds(p)
        farthest *= _DISPLACED
        margin = _AROUND * self._spacing + farthest
        near = np.zeros(len(x), dtype=bool)
        near[in_box(x, lower - margin, upper + margin)] = True
        beside = near[self._beside]
        nodes, facets = numbered(self._facets[beside], len(self.surface.nodes))
        F = deformed_some(self._gradients, rows, nodes)
        normals = (cofactor(F) @ self.surface.material.surface_normal[nodes][..., None])[..., 0]
        positions, group = self._positions(points, rows, nodes, F), self._group[beside]
        own = _Undented(farthest, nodes, facets, self._longest[beside], group, F, positions, normals)
        self._last[sharp.number] = key, own
        return own

    def _positions(self, points: CorotatedPoints, rows: Array, nodes: IntArray, F: Array) -> Array:
        """(k, dim) [m] of some of the surface nodes (k,), without the displacement by contact; F: (k, dim, dim) of
        these."""
        x = placed_some(self.surface.material.basis, rows, nodes)
        if points.condensation is not None:
            x += points.condensation.of_nodes.displacement(rows, nodes)
        if self.surface.internal is not None:
            x += self.surface.internal.of_corners(rows)[nodes]
        free = np.flatnonzero(self._owner[nodes] >= 0)
        if points.given is not None and len(free):
            given = points.given.of_nodes(self._owner[nodes[free]])
            x[free] += to_world(nearest_rotations(F[free]), given)
        return x

    def _dented(self, own: _Undented, dent: Dent | None) -> Array:
        """(k, dim) [m] of these nodes, with the displacement by contact that is known."""
        of = self._owner[own.nodes]
        free = np.flatnonzero(of >= 0)
        if dent is None or not len(dent.nodes) or not len(free):
            return own.positions
        v = self._compliance.displacement(of[free], dent.nodes, dent.forces)
        y = own.positions.copy()
        y[free] += to_world(nearest_rotations(own.F[free]), v)
        return y


def bearing_facets(facets: IntArray, owner: IntArray) -> IntArray:
    """Those of the facets (f, dim) that have a node which contact can displace. owner: see `SharpSearch`."""
    return facets[(owner[facets] >= 0).any(axis=1)]
