"""The quantity that the surface is coloured by."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.convert.recorded import Recorded
from softprint.runtime.errors import SoftprintError
from softprint.runtime.fields.deformed import Deformed, contact_fields
from softprint.runtime.mesh.mesh import node_normals

NONE, DISPLACEMENT, PRESSURE = "none", "displacement", "pressure"
COLOURS = (NONE, DISPLACEMENT, PRESSURE)


@dataclass(frozen=True, eq=False)
class Colouring:
    """label: with its unit; values: (n_nodes,) at positions (n_nodes, dim), with the colliders at their poses."""

    label: str
    values: Callable[[Array, Mapping[str, RigidPose]], Array]


def colouring_of(name: str, source: Recorded, colliders: Mapping[str, Collider]) -> Colouring | None:
    """The colouring of that name; None for "none". Pressure is that of the penalty law at the drawn positions; sharp
    points press along the normals of the drawn surface there."""
    rest = source.rest
    if name == NONE:
        return None
    if name == DISPLACEMENT:
        return Colouring("displacement [mm]", lambda x, poses: 1e3 * np.linalg.norm(x - rest.points, axis=1))
    if name != PRESSURE:
        raise SoftprintError(f"there is no colour {name!r}; the colours: {', '.join(COLOURS)}")
    contact = source.contact

    def pressure(x: Array, poses: Mapping[str, RigidPose]) -> Array:
        placed = [(colliders[key], pose) for key, pose in poses.items() if key in colliders]
        normals = node_normals(x, rest.facets)
        return 1e-3 * contact_fields(rest, contact, Deformed("", 0.0, x, placed), normals)[0]

    return Colouring("contact pressure [kPa]", pressure)
