"""Where the collider of a planned contact comes from, and how deep it may go.

A contact is aimed at a place of the deformed surface, along the normal there. It ends at the deepest depth that is
asked for, or sooner where the collider is thinner (`Approach.thickness`), or where it meets a rigid frame: a frame does
not give way, so a contact that presses one says nothing of what is soft, and ends with a collider inside the body.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from softprint.fem_truth.sampling.contact_plan import (
    OTHER_TURNS_STREAM,
    TURN_STREAM,
    ContactPlan,
    PlannedContact,
)
from softprint.fem_truth.sampling.rotations import random_rotation
from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.approach import Approach, OutOfReach
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.mesh import Mesh
from softprint.runtime.mesh.facet_lattice import facet_lattice

# Of the points on facets at which the depth of a collider is measured, relative to its size.
_SPACING = 1.0 / 60.0
# How often the collider of a contact is turned anew because it would meet a frame; and the least share of its depth
# that a frame must leave.
_TURNED_ANEW, _LEAST_DEPTH = 20, 0.1


@dataclass(frozen=True)
class DepthLimits:
    """What limits the depth of a contact [m]. asked: the deepest that is asked for; thickness: of the collider; frame:
    the depth at which the collider meets a rigid frame."""

    asked: float
    thickness: float
    frame: float

    @property
    def without_frames(self) -> float:
        return min(self.asked, self.thickness)

    @property
    def deepest(self) -> float:
        """At least a share of what it would be without frames."""
        return max(min(self.without_frames, self.frame), _LEAST_DEPTH * self.without_frames)

    def require_depth(self, approach: Approach) -> None:
        """Raises OutOfReach if the collider meets a frame before it is at least so deep."""
        if self.frame < self.deepest:
            raise OutOfReach(
                f"However collider {approach.collider.name!r} is turned, it meets a rigid frame, which does not give "
                f"way, when it is {max(self.frame, 0.0):.3g} m deep: keep contacts away from frames with "
                "sampling.frame_clearance or sampling.region."
            )


@dataclass(frozen=True, eq=False)
class ContactApproaches:
    """The approaches of the contacts of a plan.

    colliders: those of the plan, each built at its first use; internal: (n_states, n_nodes, dim) internal equilibria
    [m] of the states; places: (n_states, n_places) mesh nodes; rotations: (n_rotations, dim, dim), None if the
    colliders are not rotated; max_depth: that is asked for [m]; on_facets: whether depths are measured on facets too.
    """

    body: ReducedBody
    colliders: Sequence[Callable[[], Collider]]
    plan: ContactPlan
    internal: Array
    places: IntArray
    rotations: Array | None
    max_depth: float
    on_facets: bool = False
    _surfaces: dict[int, tuple[Array, Array]] = field(default_factory=dict)

    def of(self, contact: PlannedContact) -> tuple[Approach, DepthLimits]:
        """With the first of the collider's rotations in which no frame is in its way; if there is none, with the one in
        which it gets deepest."""
        found: list[tuple[Approach, DepthLimits]] = []
        for rotation in self._rotations(contact):
            approach, limits = self._turned(contact, rotation)
            if limits.frame == np.inf:
                return approach, limits
            found.append((approach, limits))
        return max(found, key=lambda one: one[1].frame)

    def _turned(self, contact: PlannedContact, rotation: Array) -> tuple[Approach, DepthLimits]:
        """With this rotation. What is finer than the mesh goes in between its nodes, so where contact is on facets
        depths are measured at points between them as well: on those facets that the collider can touch."""
        nodes, aimed, normal = self._aimed_at(contact)
        mesh, of_frames = self.body.mesh, self.body.handles.frame_nodes
        approach = Approach(self.colliders[contact.collider](), nodes, nodes[aimed], normal, rotation)
        frames = nodes[np.isin(mesh.surface_nodes, of_frames)]
        if self.on_facets:
            x = self.internal[contact.state]
            facets = mesh.facets[self._in_reach(x, approach)]
            held = np.isin(facets, of_frames).all(axis=1)
            spacing = _SPACING * approach.collider.size
            soft, rigid = facet_lattice(x, facets[~held], spacing), facet_lattice(x, facets[held], spacing)
            approach = replace(approach, surface=np.vstack([nodes, soft, rigid]))
            frames = np.vstack([frames, rigid])
        thickness = approach.thickness(self.max_depth)
        frame = approach.meets(frames, min(self.max_depth, thickness))
        return approach, DepthLimits(self.max_depth, thickness, frame)

    def _in_reach(self, x: Array, approach: Approach) -> BoolArray:
        """Mask of the facets, with nodes at x, that the collider can touch; none for a half space: it meets nodes
        first."""
        facets = self.body.mesh.facets
        if not np.isfinite(approach.collider.upper - approach.collider.lower).all():
            return np.zeros(len(facets), dtype=np.bool_)
        middles = x[facets].mean(axis=1)
        extent = np.linalg.norm(x[facets] - middles[:, None], axis=2).max(axis=1)
        return approach.reached_on_the_way(middles, extent, self.max_depth)

    def _aimed_at(self, contact: PlannedContact) -> tuple[Array, int, Array]:
        """Nodes (n, dim) [m] of the deformed surface, the row of the one aimed at, and the normal (dim,) there."""
        mesh, place = self.body.mesh, self.places[contact.state, contact.place]
        if contact.state not in self._surfaces:
            deformed = Mesh(self.internal[contact.state], mesh.cells)
            self._surfaces[contact.state] = deformed.points[mesh.surface_nodes], deformed.surface_normals
        nodes, normals = self._surfaces[contact.state]
        aimed = int(np.searchsorted(mesh.surface_nodes, place))
        return nodes, aimed, normals[aimed]

    def _rotations(self, contact: PlannedContact) -> Iterator[Array]:
        """Of the collider (dim, dim): the planned one, then some that are drawn for this contact.

        The planned set is rotated as a whole for each state and place: it stays evenly spread, and no two places have
        the same rotations.
        """
        dim = self.body.dim
        if self.rotations is None:
            yield np.eye(dim)
            return
        turn = random_rotation(dim, self.plan.rng_of_place(TURN_STREAM, contact))
        yield self.rotations[contact.rotation] @ turn
        rng = self.plan.rng(OTHER_TURNS_STREAM, contact)
        for _ in range(_TURNED_ANEW):
            yield random_rotation(dim, rng)
