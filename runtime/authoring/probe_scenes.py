"""Scenes made automatically: a collider comes to a place of the body along its normal, leans, drags and leaves.

Places are spread over the surface, where it does not just give way: a limb that bends shows no dent. At each, the
collider is led as the reference solutions lead theirs (`runtime/colliders/approach.py`): from outside to a depth below
the body at rest. So no scene begins inside the body, and the depth fits to the body's thickness there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.authoring.choose_settings import POISSON, Settings, thicknesses
from softprint.runtime.body.farthest_points import farthest_points
from softprint.runtime.body.placement import in_box
from softprint.runtime.colliders.approach import Approach, OutOfReach
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mechanics.rest_response import RestResponse
from softprint.runtime.mesh import Mesh

# A place is reached if the collider first touches the body within this many of its sizes from there.
_AT_THE_PLACE = 1.0
# Over the collider's size: distance at the start and the end, way of the drag; angle of the lean [rad].
_AWAY, _DRAG, _LEAN = 0.4, 0.5, 0.3
# Depth of a press over the local thickness of the body, at most; and shares of it: touched, while dragged.
_OF_THICKNESS, _TOUCHED, _DRAGGED = 0.2, 0.3, 0.8
# Depth half way along the drag over that of the press, at most.
_DEEPEST_DRAG = 1.5
# Scenes press deeper than samples: a motion goes through all depths.
_BEYOND = 1.2
TIMES = (0.0, 0.35, 0.7, 1.1, 1.45)  # s, at the pace of the Jelly
# Points of the surface, over the collider's size; parts of an edge of a facet, at most.
_FINE, _MOST_PARTS = 0.1, 6
_CANDIDATES = 4  # places for each one wanted
# So many times as many are looked at. Those stay that move with a force by at most this multiple of how far the firmest
# tenth do.
_SPREAD, _GIVES, _FIRMEST = 4, 3.0, 0.1


@dataclass(frozen=True, eq=False)
class Probe:
    """One scene. collider: its name; poses: at the TIMES times the pace; depth: of the press [m]; place: of the body
    [m]."""

    collider: str
    poses: tuple[RigidPose, ...]
    depth: float
    place: Array


def probe_scenes(
    mesh: Mesh, settings: Settings, colliders: Sequence[tuple[str, Collider]], rng: np.random.Generator
) -> list[Probe]:
    """One probe for each collider, at places spread over the surface. Raises SoftprintError if a collider can reach
    none."""
    places = _places(mesh, settings, _CANDIDATES * len(colliders))
    probes, taken = [], set[int]()
    for name, collider in colliders:
        # Rather a place that is reached beside it, or a place used before, than none.
        tries = [(place, strict) for strict in (True, False) for place in places if place not in taken]
        for place, strict in [*tries, *((place, False) for place in taken)]:
            probe = _probe(mesh, settings, name, collider, int(place), rng, strict)
            if probe is not None:
                probes.append(probe)
                taken.add(int(place))
                break
        else:
            raise SoftprintError(
                f"no place of the body can be reached by collider {name!r}, {2e3 * collider.size:.3g} mm large, "
                "from outside: "
                "hold another side (--hold), or give more --cells"
            )
    return probes


def _places(mesh: Mesh, settings: Settings, count: int) -> IntArray:
    """Surface nodes in farthest-point order, away from what is held and from limbs that give way."""
    nodes = mesh.surface_nodes
    free = nodes[~in_box(mesh.points[nodes], settings.hold)]
    held = mesh.points[in_box(mesh.points, settings.hold)]
    away = cKDTree(held).query(mesh.points[free])[0]
    roomy = free[away > 0.5 * settings.collider]
    chosen = roomy if len(roomy) >= count else free
    spread = chosen[farthest_points(mesh.points[chosen], min(_SPREAD * count, len(chosen)))]
    held_nodes = np.flatnonzero(in_box(mesh.points, settings.hold))
    gives = RestResponse(mesh, held_nodes, POISSON).giving_way(spread, 0.5 * settings.collider)
    firm = gives <= max(_GIVES * np.quantile(gives, _FIRMEST), np.sort(gives)[min(count, len(spread)) - 1])
    return spread[firm][:count]


def _probe(
    mesh: Mesh,
    settings: Settings,
    name: str,
    collider: Collider,
    place: int,
    rng: np.random.Generator,
    strict: bool,
) -> Probe | None:
    """None if the collider cannot come to the place along its normal; strict: or if it touches the body far from
    there."""
    dim, size = mesh.dim, settings.collider
    number = int(np.searchsorted(mesh.surface_nodes, place))
    normal, at = _smooth_normal(mesh, number, size), mesh.points[place]
    thickness = float(thicknesses(mesh, np.array([place]))[0])
    depth = min(_BEYOND * settings.max_depth, _OF_THICKNESS * thickness)
    tangent = _tangent(normal, rng)
    turned = _turn(dim, rng.uniform(-np.pi, np.pi), normal, rng)
    leant = _lean(dim, tangent, normal) @ turned
    surface = surface_points(mesh, _FINE * size)
    aside = _on_surface(surface, at + _DRAG * size * tangent)
    coming = Approach(collider, surface, at, normal, turned)
    pressing = Approach(collider, surface, at, normal, leant)
    leaving = Approach(collider, surface, aside, normal, leant)
    depth = min(way.sensible(depth) for way in (coming, pressing, leaving))
    try:
        away, touched = coming.poses_at(np.array([-_AWAY * size, _TOUCHED * depth]))
        (pressed,) = pressing.poses_at(np.array([depth]))
        gone, dragged = leaving.poses_at(np.array([-_AWAY * size, _DRAGGED * depth]))
    except OutOfReach:
        return None
    between = pressed.towards(dragged, 0.5)
    if -float(collider.sdf(between.apply_inverse(surface)).min()) > _DEEPEST_DRAG * depth:
        return None  # the body bulges on the way
    # Something else, such as another limb, is in the way if the collider meets the body far above the place.
    reach = float(np.linalg.norm(np.maximum(np.abs(collider.lower), np.abs(collider.upper))))
    met = surface[np.argmin(collider.sdf(touched.apply_inverse(surface)))]
    if strict and np.linalg.norm(met - at) > max(_AT_THE_PLACE * size, reach):
        return None
    return Probe(name, (away, touched, pressed, dragged, gone), depth, at)


def _smooth_normal(mesh: Mesh, number: int, size: float) -> Array:
    """The mean normal of the surface within half the size of a collider of a surface node."""
    points = mesh.points[mesh.surface_nodes]
    own = mesh.surface_normals[number]
    near = (np.linalg.norm(points - points[number], axis=1) < 0.5 * size) & (mesh.surface_normals @ own > 0.3)
    mean = (mesh.surface_areas[near, None] * mesh.surface_normals[near]).sum(axis=0)
    return np.asarray(mean / np.linalg.norm(mean))


def _tangent(normal: Array, rng: np.random.Generator) -> Array:
    drawn = rng.standard_normal(len(normal))
    drawn -= drawn @ normal * normal
    return np.asarray(drawn / np.linalg.norm(drawn))


def _turn(dim: int, angle: float, normal: Array, rng: np.random.Generator) -> Array:
    """A rotation of the collider: any in the plane; in space about the normal and a little about another axis."""
    if dim == 2:
        return RigidPose.from_rotation_vector(np.array([angle]), np.zeros(2)).rotation
    aside = 0.4 * rng.standard_normal(3)
    return np.asarray((Rotation.from_rotvec(angle * normal) * Rotation.from_rotvec(aside)).as_matrix())


def _lean(dim: int, tangent: Array, normal: Array) -> Array:
    """A rotation that leans the top of a collider towards the tangent."""
    if dim == 2:
        turn = normal[0] * tangent[1] - normal[1] * tangent[0]
        return RigidPose.from_rotation_vector(np.array([_LEAN * np.sign(turn)]), np.zeros(2)).rotation
    return np.asarray(Rotation.from_rotvec(_LEAN * np.cross(normal, tangent)).as_matrix())


def surface_points(mesh: Mesh, spacing: float) -> Array:
    """(n, dim) points of the surface [m] about `spacing` apart where facets are larger than that: corners, and a grid
    on each facet."""
    parts = int(np.clip(np.ceil(mesh.surface_spacing / spacing), 1, _MOST_PARTS))
    steps = np.array([[i, parts - i] for i in range(parts + 1)])
    if mesh.dim == 3:
        steps = np.array([[i, j, parts - i - j] for i in range(parts + 1) for j in range(parts + 1 - i)])
    points = np.einsum("gk,fkd->fgd", steps / parts, mesh.points[mesh.facets]).reshape(-1, mesh.dim)
    return np.unique(np.round(points, 9), axis=0)


def _on_surface(surface: Array, point: Array) -> Array:
    return surface[np.argmin(np.linalg.norm(surface - point, axis=1))]


def keyframes(probe: Probe, pace: float) -> Iterator[tuple[float, Array, Array]]:
    """(time [s], position [m], rotation vector [rad]) of each keyframe."""
    for time, pose in zip(TIMES, probe.poses, strict=True):
        yield round(time * pace, 3), pose.translation, pose.rotation_vector
