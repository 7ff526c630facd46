"""Colliders from triangle meshes: STL, OBJ or PLY, checked, and sampled on a grid with exact distances."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.sampled.grid import GridCollider
from softprint.runtime.colliders.surface_mesh.mesh_distance import MeshDistance
from softprint.runtime.colliders.surface_mesh.ply_strips import read_ply_strips
from softprint.runtime.colliders.surface_mesh.rebuild import misplaced
from softprint.runtime.colliders.surface_mesh.repair import OR_REBUILD, closed_surface
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.memory_bound import memory_bound

log = logging.getLogger(__name__)

# Plausible sizes of colliders [m]: one that is larger or smaller is more likely in another unit.
SMALLEST, LARGEST = 1e-4, 10.0
SUFFIXES = (".stl", ".obj", ".ply")
_OPTIONS: dict[str, dict[str, bool]] = {".obj": {"skip_materials": True}, ".glb": {"skip_materials": True}}


def read_surface(path: Path) -> tuple[Array, IntArray]:
    """Vertices (v, 3) and triangles (t, 3) of a collider's mesh file, unchanged."""
    if path.suffix.lower() not in SUFFIXES:
        raise SoftprintError(f"{path}: a mesh collider is an STL, OBJ or PLY file")
    if not path.is_file():
        raise SoftprintError(f"{path}: there is no such collider mesh")
    return read_triangles(path)


def read_triangles(path: Path) -> tuple[Array, IntArray]:
    """Vertices (v, 3) and triangles (t, 3) of a file of any format that trimesh reads, unchanged. Several meshes of a
    scene are one."""
    import trimesh  # slow to load, and few runs need it

    try:
        with memory_bound(path):
            # Without materials: an OBJ file may name any file of the machine as one.
            mesh = trimesh.load_mesh(path, process=False, **_OPTIONS.get(path.suffix.lower(), {}))
            if path.suffix.lower() == ".ply" and not len(getattr(mesh, "faces", ())):
                mesh = trimesh.Trimesh(*read_ply_strips(path), process=False)
    except Exception as error:  # trimesh's readers raise different exceptions for bad files
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
    """The smooth signed distance of a surface [m], repaired as in `repair.py`.

    Raises SoftprintError for meshes that cannot be repaired, and if parts of the surface overlap: the distance to faces
    buried in the solid would be zero inside it.
    """
    called = source or f"collider '{name}'"
    vertices, triangles = closed_surface(vertices, triangles, called)
    buried = int(misplaced(vertices, triangles).sum())
    if buried:
        raise SoftprintError(
            f"{called}: {buried} of its {len(triangles)} faces lie within the solid or pass through others; "
            f"join its solids in a modeller, {OR_REBUILD}"
        )
    return surface_collider(vertices, triangles, resolution, name)


def surface_collider(
    vertices: Array, triangles: IntArray, resolution: int = 48, name: str = "mesh"
) -> GridCollider:
    """`mesh_collider` of a surface known to be closed, to face outward and to be free of self-intersections."""
    exact = MeshDistance(vertices, triangles)
    return GridCollider(exact, vertices, triangles, resolution, name, exact.on_grid)


def load_mesh_collider(
    path: Path | str, scale: float = 1.0, resolution: int = 48, name: str = "mesh"
) -> GridCollider:
    """`mesh_collider` of a file whose unit is `scale` metres."""
    return placed_mesh_collider(Path(path), lambda vertices: scale * vertices, resolution, name)


def placed_mesh_collider(
    path: Path, in_metres: Callable[[Array], Array], resolution: int, name: str
) -> GridCollider:
    """`mesh_collider` of a file whose vertices (v, 3) in_metres brings to where they belong."""
    vertices, triangles = read_surface(path)
    collider = mesh_collider(in_metres(vertices), triangles, resolution, name, source=str(path))
    if hint := unit_hint(2.0 * collider.size):
        log.warning("%s: a collider of %.3g m; %s", path, 2.0 * collider.size, hint)
    return collider


def unit_hint(extent: float) -> str:
    """A hint at a wrong unit of a collider of this largest extent [m]; empty if the size is plausible."""
    if extent >= LARGEST:
        return "if the file is in millimetres, its scale is 0.001"
    return "" if extent > SMALLEST else "is its scale the length in metres of one unit of the file?"
