"""Colliders from the tables of an experiment file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from runtime.colliders.analytic import Box, Capsule, Cone, Cylinder, Plane, Sphere
from runtime.colliders.collider import Collider
from runtime.colliders.combine import Placed, SmoothDifference, SmoothUnion
from runtime.colliders.library import library_collider
from runtime.colliders.mesh_collider import load_mesh_collider
from runtime.colliders.polygon import load_polygon, polygon_collider
from runtime.colliders.pose import RigidPose
from runtime.errors import SoftprintError
from runtime.experiment import colliders_schema as schema


def build_collider(spec: schema.ColliderSpec, base_dir: Path = Path()) -> Collider:
    """The collider that `spec` describes; files are looked for relative to `base_dir`.

    Raises SoftprintError for missing or unusable files and for shapes that do not fit together.
    """
    collider = _shape(spec, spec.name or spec.shape, base_dir)
    if spec.position is None and spec.rotation is None:
        return collider
    position = [0.0] * collider.dim if spec.position is None else spec.position
    rotation = [0.0] * (1 if collider.dim == 2 else 3) if spec.rotation is None else spec.rotation
    if len(position) != collider.dim:
        raise SoftprintError(
            f"collider '{collider.name}' is {collider.dim}D, so its position needs {collider.dim} numbers; "
            f"got {position}"
        )
    return Placed(collider, RigidPose.from_rotation_vector(rotation, position))


def _shape(spec: schema.ColliderSpec, name: str, base_dir: Path) -> Collider:
    match spec:
        case schema.SphereSpec():
            return Sphere(spec.radius, dim=2 if spec.shape == "circle" else 3, name=name)
        case schema.BoxSpec():
            return Box(spec.half_extents, spec.rounding, name)
        case schema.CapsuleSpec():
            return Capsule(spec.start, spec.end, spec.radius, name)
        case schema.ConeSpec():
            return Cone(spec.start, spec.end, spec.start_radius, spec.end_radius, name)
        case schema.CylinderSpec():
            return Cylinder(spec.radius, spec.half_height, spec.rounding, name)
        case schema.PlaneSpec():
            return Plane(spec.normal, name)
        case schema.PolygonSpec():
            vertices = np.array(spec.vertices) if spec.file is None else load_polygon(base_dir / spec.file)
            return polygon_collider(spec.scale * vertices, spec.rounding, spec.resolution, name)
        case schema.MeshSpec():
            return load_mesh_collider(base_dir / spec.file, spec.scale, spec.resolution, name)
        case schema.LibrarySpec():
            return library_collider(spec.entry_name, spec.size, spec.resolution, name)
        case schema.UnionSpec():
            return SmoothUnion([build_collider(part, base_dir) for part in spec.parts], spec.blend, name)
        case schema.DifferenceSpec():
            parts = [build_collider(part, base_dir) for part in spec.parts]
            return SmoothDifference(build_collider(spec.base, base_dir), parts, spec.blend, name)
