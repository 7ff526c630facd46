"""Mass, centre and inertia of solids.

For a closed surface of simplices they are exact: with V_f = det(v_1, ..., v_dim) / dim! the signed volume between the
origin and a facet (the divergence theorem, facet by facet),

    V = sum V_f,   int z = sum V_f sum_a v_a / (dim + 1),
    int z z^T = sum V_f (sum_a v_a v_a^T + (sum_a v_a)(sum_a v_a)^T) / ((dim + 1)(dim + 2)).

Colliders with a mesh are integrated over that mesh. For all others the zero level of the distance is extracted on two
grids and the second-order error is removed by Richardson extrapolation; the remaining error is 1e-4 of the mass and
3e-4 of the inertia for balls, capsules and rounded boxes.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.combine import Placed
from softprint.runtime.colliders.level_set import collider_surface
from softprint.runtime.colliders.sampled.grid import GridCollider
from softprint.runtime.errors import SoftprintError

# Cells along the longest side of the coarser of the two grids; the finer has twice as many.
_CELLS = {2: 120, 3: 36}


@dataclass(frozen=True, eq=False)
class MassProperties:
    """mass [kg; in 2D for one metre of thickness]; centre (dim,) of mass [m] and second_moment J = int rho (z - centre)
    (z - centre)^T (dim, dim) [kg m^2], in the collider's coordinates."""

    mass: float
    centre: Array
    second_moment: Array

    @property
    def dim(self) -> int:
        return int(self.centre.size)

    @property
    def inertia(self) -> Array:
        """About the centre [kg m^2]: (1, 1) in 2D, tr(J) I - J (3, 3) in 3D."""
        J = self.second_moment
        return np.array([[np.trace(J)]]) if self.dim == 2 else np.trace(J) * np.eye(3) - J

    def scaled(self, factor: float) -> MassProperties:
        """The same solid with its density multiplied by the factor."""
        return MassProperties(factor * self.mass, self.centre, factor * self.second_moment)


def surface_moments(vertices: Array, facets: IntArray) -> tuple[float, Array, Array]:
    """V [m^dim], int z (dim,) and int z z^T (dim, dim) of the solid enclosed by outward-facing facets (f, dim) of
    vertices (v, dim)."""
    dim = vertices.shape[1]
    corners = vertices[facets]
    volume = np.linalg.det(corners) / factorial(dim)
    total = corners.sum(axis=1)
    pairs = np.einsum("fai,faj->fij", corners, corners) + total[:, :, None] * total[:, None, :]
    return (
        float(volume.sum()),
        volume @ total / (dim + 1),
        np.tensordot(volume, pairs, 1) / ((dim + 1) * (dim + 2)),
    )


def mass_properties(collider: Collider, density: float = 1.0) -> MassProperties:
    """For a collider of uniform density [kg/m^3]. Raises SoftprintError for one without bounds or volume."""
    if not (np.isfinite(density) and density > 0):
        raise SoftprintError(
            f"the density of collider {collider.name!r} must be a positive number of kg/m^3, not {density}"
        )
    if not np.isfinite(collider.upper).all():
        raise SoftprintError(
            f"collider {collider.name!r} has no bounds, and so no mass: it cannot move freely"
        )
    return _unit(collider).scaled(density)


def _unit(collider: Collider) -> MassProperties:
    """For the density of 1 kg/m^3."""
    if isinstance(collider, Placed):
        part, pose = _unit(collider.part), collider.pose
        rotated = pose.rotation @ part.second_moment @ pose.rotation.T
        return MassProperties(part.mass, pose.apply(part.centre[None])[0], rotated)
    # About the middle of the bounds, against cancellation.
    middle = 0.5 * (collider.lower + collider.upper)
    if isinstance(collider, GridCollider):
        volume, first, second = surface_moments(collider.vertices - middle, collider.facets)
    else:
        cells = _CELLS[collider.dim]
        coarse, fine = (_moments(collider, middle, count) for count in (cells, 2 * cells))
        volume = (4.0 * fine[0] - coarse[0]) / 3.0
        first = (4.0 * fine[1] - coarse[1]) / 3.0
        second = (4.0 * fine[2] - coarse[2]) / 3.0
    if not volume > 0.0:
        raise SoftprintError(f"the surface of collider {collider.name!r} is inside out, or encloses nothing")
    centre = first / volume
    return MassProperties(volume, middle + centre, second - volume * np.outer(centre, centre))


def _moments(collider: Collider, middle: Array, cells: int) -> tuple[float, Array, Array]:
    vertices, facets = collider_surface(collider, cells)
    return surface_moments(vertices - middle, facets)
