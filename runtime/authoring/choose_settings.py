"""Settings of an experiment for a body: what holds it, handles, stiffness, contact, and the sizes of colliders.

Everything scales with the body. The numbers are those of the small Jelly (`examples/jelly_library_small.toml`), 0.1 m
large, whose errors and penetrations are known (`docs/results.md`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.farthest_points import farthest_points
from softprint.runtime.body.placement import frame_in_box, in_box, in_general_position
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mechanics.rest_response import RestResponse
from softprint.runtime.mesh import Mesh
from softprint.runtime.mesh.nearest_facets import SurfaceSearch

GRAVITY, DENSITY, POISSON = 9.81, 1000.0, 0.4
# The Jelly's: Young's modulus [Pa], size of colliders over the middle extent of the body, deepest contact over size
# of the collider, and what penetration by the penalty is allowed to be, over the collider's whole extent, at a
# pressure of 2 E as on its tips.
_YOUNG = 2e4
_COLLIDER, _DEPTH, _PENETRATION, _PRESSURE = 0.3, 0.18, 0.0065, 2.0
# Half of the extent of colliders: over the body's thickness where it is thin; at least so many distances between
# surface nodes; at most this share of the body.
_THICKNESSES, _SPACINGS, _LARGEST = 1.5, 3.0, 0.5
# Deepest contact, as a share of the body's thickness where it is thin: deeper, colliders come out at the other side.
_OF_THICKNESS = 0.2
# Under its own weight no node may move by more than this share of the body's size: Young's modulus is raised until
# then.
SAG = 0.03
# What is held reaches this far from its side, at least, as a share of the body's extent there; and at most.
_HELD, _MOST_HELD = 0.1, 0.45
_POINTS = {2: 8, 3: 18}  # as in the thesis
#: What may hold a body: the axis of a side, -1 for the last, and whether it is at its upper end. The last two in 3D.
SIDES = {
    "bottom": (-1, 0),
    "top": (-1, 1),
    "left": (0, 0),
    "right": (0, 1),
    "front": (1, 0),
    "back": (1, 1),
}


@dataclass(frozen=True)
class Settings:
    """hold: the box of the rigid frame, [lower, upper] [m]; points: number of point handles; young [Pa]; sag: largest
    displacement under its own weight over the body's size; stiffness: of contact [N/m^4]; thickness: of the body
    where it is thin [m]; collider: half of the extent of colliders [m]; max_depth: of contacts [m]; clearance: of
    contact places from the frame, in sizes of the collider; pace: times of scenes relative to the Jelly's."""

    hold: Array
    points: int
    young: float
    sag: float
    stiffness: float
    thickness: float
    collider: float
    max_depth: float
    clearance: float
    pace: float


def choose_settings(mesh: Mesh, hold: str | Array, young: float | None) -> Settings:
    """Settings for a body that stands on the ground. hold: a side or a box (2, dim) [m]; young: to use instead [Pa].
    Raises SoftprintError if what is held is empty, flat or everything."""
    box = hold_box(mesh, hold)
    frame = frame_in_box(mesh, "base", box)
    sag = RestResponse(mesh, frame.nodes, POISSON).sag(GRAVITY * DENSITY)
    chosen = young or rounded_up(max(_YOUNG, sag / (SAG * mesh.size)))
    thickness = float(np.quantile(thicknesses(mesh, _sample(mesh, frame.nodes)), 0.25))
    collider = _collider_size(mesh, thickness)
    depth = min(_DEPTH * collider, _OF_THICKNESS * thickness)
    return Settings(
        hold=box,
        points=_POINTS[mesh.dim],
        young=chosen,
        sag=sag / chosen / mesh.size,
        stiffness=rounded_up(_PRESSURE * chosen / (_PENETRATION * 2.0 * collider) ** 2),
        thickness=thickness,
        collider=float(f"{collider:.3g}"),
        max_depth=float(f"{depth:.3g}"),
        clearance=0.5 if _is_roomy(mesh, frame.nodes, 0.5 * collider) else 0.0,
        pace=float(np.clip(np.sqrt(mesh.size / 0.1), 0.5, 2.0)),
    )


def _collider_size(mesh: Mesh, thickness: float) -> float:
    """Half of the extent of colliders [m]: as large as what they touch is thick, within shares of the body's middle
    extent, and not finer than the surface can show."""
    middle = float(np.sort(np.ptp(mesh.points, axis=0))[-2])
    fitting = float(np.clip(_THICKNESSES * thickness, 0.5 * _COLLIDER * middle, _COLLIDER * middle))
    return min(max(fitting, _SPACINGS * mesh.surface_spacing), _LARGEST * middle)


def hold_box(mesh: Mesh, hold: str | Array) -> Array:
    """The box of a side, just thick enough that its nodes can be a rigid frame; a box is returned as it is."""
    lower, upper = mesh.points.min(axis=0), mesh.points.max(axis=0)
    room = 0.05 * mesh.size
    if not isinstance(hold, str):
        return hold
    axis, high = _side(hold, mesh.dim)
    for share in np.linspace(_HELD, _MOST_HELD, 8):
        box = np.array([lower - room, upper + room])
        depth = share * (upper - lower)[axis]
        box[1 - high, axis] = upper[axis] - depth if high else lower[axis] + depth
        nodes = np.flatnonzero(in_box(mesh.points, box))
        if len(nodes) >= 4 * mesh.dim and in_general_position(mesh.points[nodes]):
            digits = max(0, 3 - int(np.floor(np.log10(mesh.size))))
            return np.round(box, digits)
    raise SoftprintError(
        f"--hold {hold}: the body has too few nodes within {_MOST_HELD:.0%} of that side; give more "
        "--cells, or another side"
    )


def _side(name: str, dim: int) -> tuple[int, int]:
    """The axis of a side, and whether it is at its upper end."""
    sides = list(SIDES)[: 2 * dim]
    if name not in sides:
        raise SoftprintError(
            f"--hold {name}: must be one of {', '.join(sides)}, or a box such as "
            + ("-1,-1:1,0.01" if dim == 2 else "-1,-1,-1:1,1,0.01")
        )
    axis, high = SIDES[name]
    return axis % dim, high


def thicknesses(mesh: Mesh, nodes: IntArray) -> Array:
    """(n,) thickness [m] of the body below surface nodes (n,): how far one gets from there against the normal before
    one comes out."""
    search = SurfaceSearch(mesh.points, mesh.facets)
    number = np.searchsorted(mesh.surface_nodes, nodes)
    start, inward = mesh.points[nodes], -mesh.surface_normals[number]
    steps = (
        0.25
        * mesh.surface_spacing
        * np.arange(1, int(4.0 * mesh.size * np.sqrt(mesh.dim) / mesh.surface_spacing) + 2)
    )
    result, going = np.full(len(nodes), steps[-1]), np.arange(len(nodes))
    for step in steps:
        inside = search.nearest(start[going] + step * inward[going], mesh.points).depth > 0.0
        result[going[~inside]] = step
        going = going[inside]
        if not len(going):
            break
    return result


def _sample(mesh: Mesh, held: IntArray) -> IntArray:
    free = np.setdiff1d(mesh.surface_nodes, held)
    return free[farthest_points(mesh.points[free], 200)]


def _is_roomy(mesh: Mesh, held: IntArray, clearance: float) -> bool:
    """Whether most of the surface is farther than that [m] from what is held."""
    distance, _ = cKDTree(mesh.points[held]).query(mesh.points[mesh.surface_nodes])
    return float((distance > clearance).mean()) > 0.5


def rounded_up(value: float) -> float:
    """To two digits."""
    unit = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(f"{np.ceil(value / unit - 1e-9) * unit:.2g}")
