"""The force of a body on a collider, and the point forces that it is the sum of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, IntArray


class FrictionForces(NamedTuple):
    """Friction forces (k, dim) [N] on the body in rest coordinates, on contact nodes (k,), ascending."""

    nodes: IntArray
    forces: Array


@dataclass(frozen=True, eq=False)
class SurfaceForces:
    """Point forces (m, dim) [N] on a collider at points (m, dim) [m]. Their sum is the contact force.

    nodes: (n,) mesh nodes where such forces can act, each representing the surface area nearest to it; index: (m,)
    which of these nodes carry a force; tangential: whether the forces are friction.
    """

    nodes: IntArray
    index: IntArray
    points: Array
    forces: Array
    tangential: bool = False


@dataclass(frozen=True, eq=False)
class ContactForce:
    """The force of the body on one collider at the end of a step.

    force (dim,) [N] on the collider, friction included; torque (1,) in 2D, (3,) in 3D [N m] about the origin
    of the collider's own frame; penetration: of the deepest point [m]; points: number of surface points in
    contact; parts: the point forces that sum to it.
    """

    force: Array
    torque: Array
    penetration: float
    points: int
    parts: Sequence[SurfaceForces] = ()


def resultant(parts: Sequence[SurfaceForces], origin: Array) -> tuple[Array, Array]:
    """Force (dim,) and torque about ``origin`` of point forces."""
    dim = len(origin)
    force, torque = np.zeros(dim), np.zeros(1 if dim == 2 else 3)
    for part in parts:
        arm, forces = part.points - origin, part.forces
        force += forces.sum(axis=0)
        if dim == 2:
            torque += (arm[:, 0] * forces[:, 1] - arm[:, 1] * forces[:, 0]).sum()
        else:
            torque += np.cross(arm, forces).sum(axis=0)
    return force, torque
