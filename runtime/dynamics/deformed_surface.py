"""The deformed surface of a reduced body, displaced by contact, at a cost that does not grow with the mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.contact.condensed.contact_evaluation import ContactEvaluation
from softprint.runtime.contact.piercing import DeformedSurface
from softprint.runtime.contact.solver.contact_nodes import ContactNodes
from softprint.runtime.dynamics.step.evaluation import BodyEvaluation
from softprint.runtime.elasticity.invariants import cofactor
from softprint.runtime.linalg.row_products import placed


class BodySurface(Protocol):
    """Surface nodes of a body. nodes: without static condensation."""

    @property
    def nodes(self) -> ContactNodes: ...

    def at(self, body: BodyEvaluation) -> DeformedSurface:
        """At a state."""
        ...


class SampledSurface:
    """The surface samples, which are in penalty contact."""

    def __init__(self, body: ReducedBody) -> None:
        self.nodes = _without_condensation(body, body.surface.nodes)

    def at(self, body: BodyEvaluation) -> DeformedSurface:
        """See `BodySurface`."""
        return _SampledAt(self.nodes, body.at.rows, body.positions)


@dataclass(frozen=True, eq=False)
class _SampledAt:
    """approximate: exact in fact."""

    nodes: ContactNodes
    rows: Array
    approximate: Array

    def positions(self, index: IntArray) -> Array:
        """See `DeformedSurface`."""
        return np.asarray(self.approximate[index])

    def normals(self, index: IntArray) -> Array:
        """See `DeformedSurface`."""
        return _normals(self.nodes, self.rows, index)


class CondensedSurface:
    """The nodes of condensed contact, which lie outside rigid frames, and the surface samples in rigid frames."""

    def __init__(self, body: ReducedBody, condensed: CondensedContact) -> None:
        own, samples = condensed.nodes.mesh_nodes, body.surface.nodes
        rigid = samples[np.isin(samples, body.handles.frame_nodes)]
        self.n_contact = len(own)
        self.nodes = _without_condensation(body, np.concatenate([own, rigid]))

    def at(self, body: BodyEvaluation) -> DeformedSurface:
        """See `BodySurface`."""
        contact, rows = body.contact, body.at.rows
        assert contact is not None  # there is condensed contact, so that every evaluation has one
        rigid = placed(self.nodes.points.basis[self.n_contact :], rows)
        approximate = np.concatenate([contact.nodes.bounded_positions(rows)[0], rigid])
        return _CondensedAt(self.nodes, self.n_contact, contact, approximate)


@dataclass(frozen=True, eq=False)
class _CondensedAt:
    nodes: ContactNodes
    n_contact: int
    contact: ContactEvaluation
    approximate: Array

    def positions(self, index: IntArray) -> Array:
        """See `DeformedSurface`."""
        first = np.searchsorted(index, self.n_contact)
        own, rigid = index[:first], self.approximate[index[first:]]
        return np.concatenate([self.contact.deformed_positions(own), rigid])

    def normals(self, index: IntArray) -> Array:
        """See `DeformedSurface`."""
        return _normals(self.nodes, self.contact.rows, index)


def _normals(nodes: ContactNodes, rows: Array, index: IntArray) -> Array:
    """cof(F) N (m, dim): the deformed surface normals, without the displacement by contact."""
    normal = nodes.points.surface_normal[index]
    return np.asarray((cofactor(nodes.deformation(rows, index)) @ normal[..., None])[..., 0])


def _without_condensation(body: ReducedBody, mesh_nodes: IntArray) -> ContactNodes:
    return ContactNodes(body.node_points(mesh_nodes), None, body.handles, mesh_nodes)
