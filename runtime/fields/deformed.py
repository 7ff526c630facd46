"""All fields of one deformed body, for pictures of a sample or a frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.sharp_planes import SharpSurface, undented_normals
from softprint.runtime.contact.surface_quadrature import SurfaceQuadrature
from softprint.runtime.elasticity.invariants import determinant
from softprint.runtime.fields.tensors import cauchy_stress, green_strain, in_three_dimensions, von_mises
from softprint.runtime.mesh import Mesh


@dataclass(frozen=True, eq=False)
class Deformed:
    """A body at positions (n_nodes, dim) [m], and its colliders at their poses.

    label: what it is ("sample_12"); time [s], or the number of the sample; node_values: further fields at
    the nodes, by name, such as the contact displacement of a sample.
    """

    label: str
    time: float
    positions: Array
    colliders: Sequence[tuple[Collider, RigidPose]] = ()
    node_values: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class FieldSet:
    """Fields by name: at the nodes (n_nodes,) or (n_nodes, dim), in the cells (n_cells,) or (n_cells, 3, 3)."""

    mesh: Mesh
    positions: Array
    nodes: Mapping[str, Array]
    cells: Mapping[str, Array]


def fields_of(body: ReducedBody, contact: PenaltyContact, deformed: Deformed) -> FieldSet:
    """Displacement from rest [m], Green strain, Cauchy and von Mises stress [Pa], det F, contact pressure [Pa].

    The pressure at a surface node is the mean of k depth^2 for each unit of *rest* area (see
    :mod:`runtime.contact.penalty`) over the contact points around it; with the node's own share of that area it gives
    the normal force. The sum of ``contact_force`` [N], the force on the body, over the nodes is the total force.
    Contact is that of full space at these positions: a reduced model has other points on the facets, and another force.
    """
    x = deformed.positions
    F = in_three_dimensions(body.mesh.deformation_gradients(x))
    stress = cauchy_stress(body.material, F)
    normals = undented_normals(body, body.project(x))
    pressure, force = contact_fields(body.mesh, contact, deformed, normals)
    return FieldSet(
        mesh=body.mesh,
        positions=x,
        nodes={
            "displacement": x - body.mesh.points,
            **deformed.node_values,
            "contact_pressure": pressure,
            "contact_force": force,
        },
        cells={
            "green_strain": green_strain(F),
            "cauchy_stress": stress,
            "von_mises_stress": von_mises(stress),
            "det_F": determinant(F),
        },
    )


@lru_cache(maxsize=8)
def _sharp_surface(collider: Collider, contact: PenaltyContact, mesh: Mesh) -> SharpSurface | None:
    """The same for all frames of a series."""
    return SharpSurface.of(collider, contact, mesh)


def contact_fields(
    mesh: Mesh, contact: PenaltyContact, deformed: Deformed, normals: Array
) -> tuple[Array, Array]:
    """Pressure (n_nodes,) [Pa] and force (n_nodes, dim) [N] of all colliders on every surface node; normals: (n_nodes,
    dim) outward, along which sharp points of colliders press."""
    normal, force = np.zeros((mesh.n_nodes, 1)), np.zeros((mesh.n_nodes, mesh.dim))
    points, x = SurfaceQuadrature.of(mesh, contact.refinement), deformed.positions
    for collider, pose in deformed.colliders:
        near = points.near(x, collider, pose)
        terms = contact.terms(points.points(near).positions(x), points.area(near), collider, pose)
        touching = [(points.points(near[terms.index]), terms.gradient)]
        sharp = _sharp_surface(collider, contact, mesh)
        if sharp is not None:
            pressed = sharp.held(x, pose, normals).terms(sharp.weight, x, pose)
            touching.append((pressed.points, pressed.gradient))
        for at, gradient in touching:
            pushed = np.linalg.norm(gradient, axis=1, keepdims=True)
            normal += at.gradient(pushed, mesh.n_nodes)
            force -= at.gradient(gradient, mesh.n_nodes)
    pressure = np.zeros(mesh.n_nodes)
    pressure[mesh.surface_nodes] = normal[mesh.surface_nodes, 0] / mesh.surface_areas
    return pressure, force
