"""Contact and friction of the body with one collider that moves freely.

The potentials are those of a collider that is led (`surface_contact.py`); here the pose is an argument. They are
invariant under a common rigid motion of body and collider, so that their derivatives by the nodes give those by the
twist of the collider: moving the collider is moving the nodes the other way, while the forces turn with it
(`runtime/rigid/twist.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from softprint.fem_truth.energy.surface_contact import LaggedFriction, SurfaceContact
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.collider_coupling import Coupling, node_coupling, twist_gradient
from softprint.runtime.contact.sharp_planes import SharpPlanes
from softprint.runtime.contact.surface_quadrature import SurfaceQuadrature

#: The nodes (t, c) of t facets, and blocks (t, c, c, dim, dim) by pairs of them.
Blocks = tuple[IntArray, Array]


class CoupledContact(NamedTuple):
    """The second derivatives of contact with one collider. blocks: by the nodes; nodes: (k,) those in contact;
    coupling: with the collider, its rows being the coordinates of these nodes."""

    blocks: Sequence[Blocks]
    nodes: IntArray
    coupling: Coupling


class MovingContact:
    """Contact with one collider, by name, during one step; sharp: the planes of its sharp points, which move with it;
    friction: that of the step, None without."""

    def __init__(
        self,
        name: str,
        law: PenaltyContact,
        points: SurfaceQuadrature,
        collider: Collider,
        sharp: SharpPlanes | None,
        friction: LaggedFriction | None,
    ) -> None:
        self.name, self.friction = name, friction
        self._of = law, points, collider
        self._sharp = sharp
        self._at: SurfaceContact | None = None

    def at(self, pose: RigidPose) -> SurfaceContact:
        """With the collider at a pose; friction is at the same."""
        if self._at is None or self._at.pose is not pose:
            self._at = SurfaceContact(*self._of, pose, self._sharp)
            if self.friction is not None:
                self.friction.carry(pose)
        return self._at

    def lag(self, x: Array, pose: RigidPose) -> None:
        """Update the normal forces of friction to those at x (n_nodes, dim) [m]."""
        bearing = self.at(pose).bearing(x)
        if self.friction is not None:
            self.friction.lag(bearing)

    def energies(self, x: Array, pose: RigidPose) -> tuple[float, float]:
        """Of contact and of friction [J]."""
        normal = self.at(pose).energy(x)
        return normal, 0.0 if self.friction is None else self.friction.energy(x)

    def gradient(self, x: Array, pose: RigidPose, centre: Array) -> tuple[Array, Array]:
        """By the nodes (n_nodes, dim) [N], and by the twist (n_twist,) about the collider's centre of mass."""
        by_node = self.at(pose).gradient(x)
        if self.friction is not None:
            by_node = by_node + self.friction.gradient(x)
        touched = np.flatnonzero(by_node.any(axis=1))
        return by_node, twist_gradient(x[touched] - centre, by_node[touched])

    def coupled(self, x: Array, pose: RigidPose, centre: Array, convex: bool) -> CoupledContact:
        """convex: of a positive semi-definite matrix close to that of the second derivatives."""
        own = self.at(pose)
        blocks: list[Blocks] = own.blocks(x, convex)
        by_node = own.gradient(x)
        if self.friction is not None:
            blocks.append(self.friction.blocks(x, convex))
            by_node = by_node + self.friction.gradient(x)
        nodes, matrix = assembled(blocks, x.shape[1])
        # Without forces nothing but the positive part of the contact remains.
        slope = np.zeros((len(nodes), x.shape[1])) if convex else by_node[nodes]
        return CoupledContact(blocks, nodes, node_coupling(self.name, x[nodes] - centre, slope, matrix))


def assembled(parts: Sequence[Blocks], dim: int) -> tuple[IntArray, sp.csr_matrix]:
    """The nodes (k,) of all facets, and the sum of their blocks (k*dim, k*dim)."""
    nodes = np.unique(np.concatenate([facets.ravel() for facets, _ in parts]))
    entries: list[Array] = []
    places: list[tuple[Array, Array]] = []
    axis = np.arange(dim)
    for facets, blocks in parts:
        at = np.searchsorted(nodes, facets)[:, :, None] * dim + axis  # (t, c, dim)
        rows, columns = np.broadcast_arrays(at[:, :, None, :, None], at[:, None, :, None, :])
        places.append((rows.ravel(), columns.ravel()))
        entries.append(blocks.ravel())
    rows, columns = (np.concatenate(place) for place in zip(*places, strict=True))
    shape = (len(nodes) * dim,) * 2
    return nodes, sp.csr_matrix((np.concatenate(entries), (rows, columns)), shape=shape)
