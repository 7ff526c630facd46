"""Rigid colliders as smooth signed distances, their poses and their paths.

`kinds/` has one file for each kind of collider that experiment files can name. What a collider offers to everything
else: `collider.py`.
"""

from softprint.runtime.colliders.collider import Collider, SdfDerivatives
from softprint.runtime.colliders.combine import Placed, SmoothDifference, SmoothUnion
from softprint.runtime.colliders.kinds.box import Box
from softprint.runtime.colliders.kinds.cone import Capsule, Cone
from softprint.runtime.colliders.kinds.cylinder import Cylinder
from softprint.runtime.colliders.kinds.plane import Plane
from softprint.runtime.colliders.kinds.sphere import Sphere
from softprint.runtime.colliders.path import KeyframedPath
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.colliders.sampled.grid import GridCollider
from softprint.runtime.colliders.sampled.polygon import load_polygon, polygon_collider
from softprint.runtime.colliders.surface_mesh.mesh_collider import load_mesh_collider, mesh_collider

__all__ = [
    "Box",
    "Capsule",
    "Collider",
    "Cone",
    "Cylinder",
    "GridCollider",
    "KeyframedPath",
    "Placed",
    "Plane",
    "RigidPose",
    "SdfDerivatives",
    "SmoothDifference",
    "SmoothUnion",
    "Sphere",
    "load_mesh_collider",
    "load_polygon",
    "mesh_collider",
    "polygon_collider",
]
