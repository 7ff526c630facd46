"""Rigid colliders as smooth signed distances, their poses and their paths."""

from runtime.colliders.analytic import Box, Capsule, Cone, Cylinder, Plane, Sphere
from runtime.colliders.collider import Collider, SdfDerivatives
from runtime.colliders.combine import Placed, SmoothDifference, SmoothUnion
from runtime.colliders.grid import GridCollider
from runtime.colliders.mesh_collider import load_mesh_collider, mesh_collider
from runtime.colliders.path import KeyframedPath
from runtime.colliders.polygon import load_polygon, polygon_collider
from runtime.colliders.pose import RigidPose

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
