"""Colliders from triangle meshes: STL, OBJ or PLY, checked, and sampled on a grid with exact distances."""

from __future__ import annotations

from pathlib import Path

import igl
import numpy as np

from runtime.arrays import Array, IntArray
from runtime.colliders.grid import GridCollider
from runtime.colliders.repair import closed_surface
from runtime.errors import SoftprintError
from runtime.memory import memory_bound

SUFFIXES = (".stl", ".obj", ".ply")
_OPTIONS: dict[str, dict[str, bool]] = {".obj": {"skip_materials": True}}


def read_surface(path: Path) -> tuple[Array, IntArray]:
    """Vertices (v, 3) and triangles (t, 3) of a mesh file as they stand in it."""
    import trimesh  # slow to load, and few runs need it

    if path.suffix.lower() not in SUFFIXES:
        raise SoftprintError(f"{path}: a mesh collider is an STL, OBJ or PLY file")
    if not path.is_file():
        raise SoftprintError(f"{path}: there is no such collider mesh")
    try:
        with memory_bound(path):
            # No materials: an OBJ file may name any file of the machine as one.
            mesh = trimesh.load_mesh(path, process=False, **_OPTIONS.get(path.suffix.lower(), {}))
    except Exception as error:  # each of trimesh's readers raises its own kinds for a bad file
        raise SoftprintError(f"{path}: cannot be read as {path.suffix[1:].upper()}: {error}") from error
    vertices = np.asarray(getattr(mesh, "vertices", np.zeros((0, 3))), dtype=float).reshape(-1, 3)
    triangles = np.asarray(getattr(mesh, "faces", np.zeros((0, 3))), dtype=np.int64).reshape(-1, 3)
    if triangles.size == 0:
        raise SoftprintError(f"{path}: holds no triangles: it is empty, cut short, or not a surface mesh")
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise SoftprintError(
            f"{path}: a triangle names vertex {triangles.max()}, but there are only {len(vertices)} vertices"
        )
    return vertices, triangles


def mesh_collider(
    vertices: Array, triangles: IntArray, resolution: int = 48, name: str = "mesh", source: str | None = None
) -> GridCollider:
    """The smooth signed distance of a closed surface [m]; repaired or refused as in `repair.py`.

    Exact distances come from libigl, signed by pseudonormals (Baerentzen and Aanaes 2005).
    """
    vertices, triangles = closed_surface(vertices, triangles, source or f"collider '{name}'")

    def exact(points: Array) -> Array:
        method = igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL
        return np.asarray(igl.signed_distance(points, vertices, triangles, sign_type=method)[0]).reshape(-1)

    return GridCollider(exact, vertices, triangles, resolution, name)


def load_mesh_collider(
    path: Path, scale: float = 1.0, resolution: int = 48, name: str = "mesh"
) -> GridCollider:
    """`mesh_collider` of a file whose unit is `scale` metres."""
    vertices, triangles = read_surface(path)
    return mesh_collider(scale * vertices, triangles, resolution, name, source=str(path))
