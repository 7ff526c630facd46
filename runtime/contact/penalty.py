"""Penalty contact of surface points with one collider (W_contact of thesis eq. 5.5).

    W(x) = sum_i a_i (k/3) depth_i^3,   depth_i = max(0, -s(T^-1 x_i)),

a_i [m^2; in 2D m, a metre of thickness] being the lumped surface area of point i and k [N/m^4; Pa/m^2] the
stiffness, so that the contact pressure is k depth^2. With n the world gradient and H the world Hessian of the
signed distance s:

    gradient  dW/dx_i      = -a_i k depth_i^2 n_i                                  [N]
    Hessian   d2W/dx_i^2   =  a_i k (2 depth_i n_i n_i^T - depth_i^2 H_i)          [N/m]

W is C2 in depth. The second term of the Hessian is the curvature of the collider: without it Newton converges
only linearly. It makes the Hessian indefinite where the collider is convex; solvers must expect that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact import point_kernels as kernels
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh.mesh import Mesh

#: Points along an edge of a facet at most, as in the [contact] table of an experiment.
MOST_REFINED = 64


@dataclass(frozen=True, eq=False)
class ContactTerms:
    """Penalty contact of the m penetrating points among n points; world coordinates.

    energy [J]; index (m,) of the points; gradient (m, dim) [N], the contact force being its negative;
    hessian (m, dim, dim) [N/m]; depth (m,) [m]; normal (m, dim), the unit outward normal of the collider.
    """

    energy: float
    index: IntArray
    gradient: Array
    hessian: Array
    depth: Array
    normal: Array

    @classmethod
    def none(cls, dim: int) -> ContactTerms:
        """No contact."""
        no_vectors, no_depths = np.empty((0, dim)), np.empty(0)
        hessian = np.empty((0, dim, dim))
        return cls(0.0, np.empty(0, dtype=np.int64), no_vectors, hessian, no_depths, no_vectors)


def penetrating_points(x: Array, collider: Collider, pose: RigidPose) -> tuple[IntArray, Array, Array]:
    """The world points x (n, dim) that lie inside the collider: their indices (m,), collider coordinates (m, dim) and
    signed distances (m,), all negative."""
    return collider.closer_to(x, pose, 0.0)


class ContactTable(Protocol):
    """What a penalty contact needs of an experiment's [contact] table."""

    @property
    def stiffness(self) -> float: ...
    @property
    def refinement(self) -> int: ...
    @property
    def reduced_refinement(self) -> int: ...


# The version of contact and friction: motions and solves of another version are made again.
CONTACT_VERSION = 10


@dataclass(frozen=True)
class PenaltyContact:
    """Contact energy (stiffness / 3) depth^3 per unit of surface area; stiffness in N/m^4.

    Contact is evaluated on facets: in full space at refinement^(dim-1) points of every facet of the surface
    (`surface_quadrature.py`), in reduced models at reduced_refinement^(dim-1) points, for 1 at the middle and the
    corners (`runtime/mechanics/loaded_points.py`), and in both at tips, edges and thin limbs of colliders
    (`sharp_planes.py`). refinement = 0: at nodes, as in the thesis; what is thinner than their distance passes between.
    """

    stiffness: float
    refinement: int = 2
    reduced_refinement: int = 1

    @classmethod
    def of(cls, table: ContactTable) -> PenaltyContact:
        """That of the [contact] table of an experiment."""
        return cls(table.stiffness, table.refinement, table.reduced_refinement)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.stiffness) and self.stiffness > 0):
            raise SoftprintError(
                f"contact stiffness must be a positive number of N/m^4, not {self.stiffness}"
            )
        if self.refinement != int(self.refinement) or not 0 <= self.refinement <= MOST_REFINED:
            raise SoftprintError(
                f"the refinement of contact must be a whole number from 0 to {MOST_REFINED}, not {self.refinement}"
            )
        if self.reduced_refinement < 1:
            raise SoftprintError(
                f"the refinement of contact in reduced models must be at least 1, not {self.reduced_refinement}"
            )

    @property
    def reduced_points(self) -> int:
        """The contact points of reduced models along an edge of a facet; 1: middles and corners, 0: at nodes."""
        return self.reduced_refinement if self.refinement else 0

    def sharp_spacing(self, mesh: Mesh) -> float:
        """How far apart the points on tips and edges of a collider are [m] (`runtime/colliders/sharp_points.py`): as
        the points of full space on the facets of the mesh, in reduced models too."""
        return mesh.surface_spacing / self.refinement

    def energy(self, x: Array, areas: Array, collider: Collider, pose: RigidPose) -> float:
        """The contact energy [J] without derivatives, for line searches; arguments as for `terms`."""
        index, _, distance = penetrating_points(x, collider, pose)
        return float(self.stiffness / 3.0 * (areas[index] @ (-distance) ** 3))

    def terms(self, x: Array, areas: Array, collider: Collider, pose: RigidPose) -> ContactTerms:
        """Energy, gradient and Hessian at world points x (n, dim) [m] with lumped areas (n,)."""
        index, z, _ = penetrating_points(x, collider, pose)
        if not len(index):
            return ContactTerms.none(x.shape[1])
        distance = collider.sdf_derivatives(z)
        weight = self.stiffness * areas[index]
        energy, gradient, hessian, depth, normal = kernels.penalty(weight, *distance, pose.rotation)
        return ContactTerms(energy, index, gradient, hessian, depth, normal)
