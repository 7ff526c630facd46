"""A free rigid body: its mass, its initial state, and its contact points against other colliders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.farthest_points import farthest_points
from softprint.runtime.body.rotations import rotation_dofs
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.combine import Placed
from softprint.runtime.colliders.level_set import collider_surface
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.colliders.sampled.grid import GridCollider
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh.mesh import facet_vectors
from softprint.runtime.rigid.flight import RigidMotion
from softprint.runtime.rigid.mass import MassProperties, mass_properties

# Number of contact points on the surface of a collider, and how many times as many candidates they are chosen from.
_POINTS = {2: 128, 3: 400}
_CANDIDATES = 10


@dataclass(frozen=True, eq=False)
class FreeCollider:
    """mass: in the collider's coordinates; pose: of the collider's frame at the start; motion: at the start; points
    (p, dim) [m] on its surface, in its coordinates, with the areas (p,) [m^(dim-1)] they represent."""

    mass: MassProperties
    pose: RigidPose
    motion: RigidMotion
    points: Array
    areas: Array


def free_collider(
    collider: Collider,
    pose: RigidPose,
    *,
    density: float | None = None,
    mass: float | None = None,
    velocity: Sequence[float] | Array | None = None,
    spin: Sequence[float] | Array | None = None,
) -> FreeCollider:
    """A collider of uniform density [kg/m^3], or of a total mass [kg], at a pose. velocity: (dim,) of its centre of
    mass [m/s]; spin: angular velocity [rad/s], one number in 2D, three in 3D. Raises SoftprintError for invalid
    values."""
    dim = collider.dim
    if (density is None) == (mass is None):
        raise SoftprintError(f"give collider {collider.name!r} a density or a mass: one of the two")
    if density is not None:
        properties = mass_properties(collider, density)
    else:
        assert mass is not None
        if not (np.isfinite(mass) and mass > 0):
            raise SoftprintError(
                f"the mass of collider {collider.name!r} must be a positive number of kg, not {mass}"
            )
        unit = mass_properties(collider)
        properties = unit.scaled(mass / unit.mass)
    start = [
        _vector(collider, what, given, size)
        for what, given, size in (("velocity", velocity, dim), ("spin", spin, rotation_dofs(dim)))
    ]
    motion = RigidMotion.spinning(properties, pose, *start)
    return FreeCollider(properties, pose, motion, *surface_points(collider))


def _vector(collider: Collider, what: str, given: Sequence[float] | Array | None, size: int) -> Array:
    vector = np.zeros(size) if given is None else np.atleast_1d(np.asarray(given, dtype=float))
    if vector.shape != (size,) or not np.isfinite(vector).all():
        numbers = "one number" if size == 1 else f"{size} numbers"
        raise SoftprintError(
            f"the {what} of collider {collider.name!r} must be {numbers}, not {vector.tolist()}"
        )
    return vector


def surface_points(collider: Collider, count: int | None = None) -> tuple[Array, Array]:
    """Points (p, dim) [m] spread evenly over the surface, on the zero level of the distance, and the area (p,) nearest
    to each of them."""
    count = _POINTS[collider.dim] if count is None else count
    vertices, facets = _surface(collider)
    areas = np.linalg.norm(facet_vectors(vertices, facets), axis=1)
    candidates = _spread(vertices, facets, areas, _CANDIDATES * count)
    chosen = farthest_points(candidates, count)
    _, nearest = cKDTree(candidates[chosen]).query(candidates)
    share = np.bincount(nearest, minlength=len(chosen)) / len(candidates)
    points = candidates[chosen]
    for _ in range(2):
        value, slope, _ = collider.sdf_derivatives(points)
        points = points - (value / np.maximum((slope**2).sum(axis=1), 1e-6))[:, None] * slope
    # At a corner that the distance rounds off more than the mesh does, the candidate is kept.
    lost = np.linalg.norm(points - candidates[chosen], axis=1) > 0.1 * collider.size
    return np.where(lost[:, None], candidates[chosen], points), share * areas.sum()


def _surface(collider: Collider) -> tuple[Array, IntArray]:
    if isinstance(collider, GridCollider):
        return collider.vertices, collider.facets
    if isinstance(collider, Placed):
        vertices, facets = _surface(collider.part)
        return collider.pose.apply(vertices), facets
    return collider_surface(collider)


def _spread(vertices: Array, facets: IntArray, areas: Array, count: int) -> Array:
    """count points (count, dim), evenly by area: facets by their cumulated area, positions in a facet by a Weyl
    sequence folded into the simplex. Deterministic."""
    steps = np.arange(count)
    facet = np.searchsorted(np.cumsum(areas) / areas.sum(), (steps + 0.5) / count)
    corners = vertices[facets[np.minimum(facet, len(facets) - 1)]]
    # Powers of the inverse plastic number (3D) or golden ratio (2D), which spread evenly.
    ratio = 1.6180339887498949 if vertices.shape[1] == 2 else 1.3247179572447460
    u = np.modf((steps[:, None] + 1) / ratio ** np.arange(1, vertices.shape[1]))[0]
    outside = u.sum(axis=1) > 1.0
    u[outside] = 1.0 - u[outside]
    shares = np.column_stack([1.0 - u.sum(axis=1), u])
    return np.asarray(np.einsum("nc,ncd->nd", shares, corners))
