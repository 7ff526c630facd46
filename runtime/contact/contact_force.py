"""The force of a body on a collider, and the point forces that it is the sum of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from runtime.arrays import Array, IntArray


@dataclass(frozen=True, eq=False)
class SurfaceForces:
    """The forces (m, dim) [N] on a collider that a contact force is the sum of, at the points (m, dim) [m].

    nodes: (n,) the nodes of the mesh that could bear such, each for the part of the surface nearest to it; index: (m,)
    which of them do; tangential: whether it is friction.
    """

    nodes: IntArray
    index: IntArray
    points: Array
    forces: Array
    tangential: bool = False


@dataclass(frozen=True, eq=False)
class ContactForce:
    """What the body does to one collider at the end of a step.

    force (dim,) [N] on the collider, friction included; torque (1,) in 2D, (3,) in 3D [N m] about the origin
    of the collider's own frame; penetration: the deepest point [m]; points: how many surface points are in
    contact; loads: what it is the sum of.
    """

    force: Array
    torque: Array
    penetration: float
    points: int
    loads: Sequence[SurfaceForces] = ()


def resultant(loads: Sequence[SurfaceForces], origin: Array) -> tuple[Array, Array]:
    """Force (dim,) and torque about ``origin`` of loads."""
    dim = len(origin)
    force, torque = np.zeros(dim), np.zeros(1 if dim == 2 else 3)
    for load in loads:
        arm, forces = load.points - origin, load.forces
        force += forces.sum(axis=0)
        if dim == 2:
            torque += (arm[:, 0] * forces[:, 1] - arm[:, 1] * forces[:, 0]).sum()
        else:
            torque += np.cross(arm, forces).sum(axis=0)
    return force, torque
