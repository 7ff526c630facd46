"""Read any mesh as a body in metres: a surface that is filled, tetrahedra or triangles as they are, or an outline."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.authoring.fidelity import Fidelity, fidelity
from softprint.runtime.authoring.fill_outline import filled_outline
from softprint.runtime.authoring.fill_surface import RIGHT, filled, refuse_count
from softprint.runtime.authoring.outline import OUTLINES, read_outline
from softprint.runtime.authoring.pieces import largest_piece
from softprint.runtime.authoring.solid_surface import joined, solid_surface
from softprint.runtime.colliders.surface_mesh.mesh_collider import read_triangles
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import Mesh, in_morton_order, oriented_mesh
from softprint.runtime.mesh.mesh_file import lies_in_plane, read_cells, simplices

SURFACES = (".stl", ".obj", ".ply", ".glb", ".off")
_Y_UP = (".glb",)  # as the format says
# Bodies outside of these sizes [m] are more likely in another unit.
SMALLEST, LARGEST = 2e-3, 10.0
_AXES = {"x": 0, "y": 1, "z": 2}

Stage = Callable[[str], AbstractContextManager[Any]]


@dataclass(frozen=True)
class Placing:
    """How a file becomes a body in metres. scale: metres for each unit of the file; size: its longest side [m]
    instead; up: the axis that points up, such as "z" or "-y", empty for that of the format."""

    scale: float | None = None
    size: float | None = None
    up: str = ""


@dataclass(frozen=True, eq=False)
class MadeBody:
    """A body that stands on the ground, centred; said: what was done, a sentence each; apart: the distances between the
    file's surface and the body's [m], where it was filled."""

    mesh: Mesh
    said: list[str] = field(default_factory=list)
    apart: Fidelity | None = None


def made_body(path: Path, placing: Placing, cells: int, stage: Stage) -> MadeBody:
    """The body of a file: of about so many cells if it is a surface or an outline. Raises SoftprintError with one
    sentence if none can be made."""
    if not path.is_file():
        raise SoftprintError(f"{path}: there is no such mesh file")
    refuse_count(cells)
    suffix = path.suffix.lower()
    if suffix in OUTLINES:
        return _of_outline(path, placing, cells, stage)
    if suffix in SURFACES:
        with stage(f"reading {path.name}"):
            vertices, triangles = read_triangles(path)
        return _of_surface(path, vertices, triangles, placing, cells, stage)
    with stage(f"reading {path.name}"):
        points, blocks = read_cells(path)
    if "triangle" in blocks and "tetra" not in blocks and not lies_in_plane(points, blocks["triangle"]):
        return _of_surface(path, points, blocks["triangle"], placing, cells, stage)
    return _of_cells(path, *simplices(path, points, blocks), placing)


def _of_surface(
    path: Path, vertices: Array, triangles: IntArray, placing: Placing, cells: int, stage: Stage
) -> MadeBody:
    used = np.unique(triangles)
    vertices, how = placed(path, vertices, vertices[used], placing)
    with stage(f"examining {path.name}"):
        solid = solid_surface(vertices, triangles, str(path), cells)
    with stage("filling it with tetrahedra"):
        found = filled(solid.vertices, solid.triangles, cells, solid.volume, str(path))
    kept, pieces = largest_piece(found.points, found.cells)
    if not pieces.one_is_enough:
        with stage("joining its pieces"):
            solid = joined(solid, pieces, str(path), cells)
            found = filled(solid.vertices, solid.triangles, cells, solid.volume, str(path))
        kept, pieces = largest_piece(found.points, found.cells)
    if not pieces.one_is_enough:
        raise SoftprintError(
            f"{path}: filled, it is in {pieces}: parts of it are thinner than {cells:,} cells can fill; ask "
            "for more --cells"
        )
    mesh = in_morton_order(oriented_mesh(found.points, kept, str(path)))
    off = _how_far_off(mesh.n_cells, cells)
    said = [
        how,
        *solid.done,
        f"filled with {mesh.n_cells:,} tetrahedra by fTetWild; {cells:,} were wanted{off}",
    ]
    if pieces.count > 1:
        said.append(f"it is in {pieces}: the largest is kept")
    with stage("comparing the surfaces"):
        apart = fidelity((vertices, triangles), (mesh.points, mesh.facets), found.edge)
    return MadeBody(_standing(mesh), said, apart)


def _how_far_off(got: int, wanted: int) -> str:
    """Why the number of cells is not about the one wanted; empty where it is."""
    if got > (1.0 + RIGHT) * wanted:
        return "; its thin parts and fine features need that many"
    if got < (1.0 - RIGHT) * wanted:
        return "; no edge length that was tried came nearer"
    return ""


def _of_cells(path: Path, points: Array, cells: IntArray, placing: Placing) -> MadeBody:
    """Tetrahedra, or triangles in the plane, of the largest piece."""
    if not len(cells) or cells.min() < 0 or cells.max() >= len(points):
        oriented_mesh(points, cells, str(path))  # raises the error
    points, how = placed(path, points, points[np.unique(cells)], placing)
    kept, pieces = largest_piece(points, cells)
    if not pieces.one_is_enough:
        raise SoftprintError(f"{path}: is in {pieces}; a body is one piece: join them, or export one of them")
    mesh = in_morton_order(oriented_mesh(points, kept, str(path)))
    kind = "triangles" if mesh.dim == 2 else "tetrahedra"
    said = [how, f"its {mesh.n_cells:,} {kind} are kept as they are (--cells is for surfaces and outlines)"]
    if pieces.count > 1:
        said.append(f"it is in {pieces}: the largest is kept")
    return MadeBody(_standing(mesh), said)


def _of_outline(path: Path, placing: Placing, cells: int, stage: Stage) -> MadeBody:
    with stage(f"reading {path.name}"):
        loops = read_outline(path)
    corners, how = placed(path, np.vstack(loops), np.vstack(loops), placing)
    loops = np.split(corners, np.cumsum([len(loop) for loop in loops])[:-1])
    with stage("filling it with triangles"):
        mesh = filled_outline(loops, cells, str(path))
    holes = f" with {len(loops) - 1} hole(s)" if len(loops) > 1 else ""
    said = [how, f"an outline{holes}, filled with {mesh.n_cells:,} triangles by gmsh; {cells:,} were wanted"]
    return MadeBody(_standing(in_morton_order(mesh)), said)


def placed(path: Path, points: Array, used: Array, placing: Placing) -> tuple[Array, str]:
    """Points (n, dim) of a file in metres, turned so that the last axis is up, and a sentence about it. used: those
    that belong to cells."""
    if not np.isfinite(used).all():
        raise SoftprintError(f"{path}: has coordinates that are not finite numbers; export the mesh again")
    extent = float(np.ptp(used, axis=0).max()) if len(used) else 0.0
    if not 0.0 < extent < np.inf:
        raise SoftprintError(f"{path}: all its points are in one place, or too far apart for numbers")
    scale = placing.scale or 1.0
    if placing.size is not None:
        scale = placing.size / extent
    size = scale * extent
    if not SMALLEST <= size <= LARGEST:
        unit = "" if placing.size or placing.scale else ", if its unit is the metre"
        raise SoftprintError(
            f"{path}: is {size:.3g} m large{unit}, and a body is from {SMALLEST:g} to {LARGEST:g} m large: "
            "give the unit of "
            "the file with --units mm (or cm, in) or --scale, or the size wanted with --size"
        )
    dim = points.shape[1]
    up = placing.up or ("y" if dim == 2 or path.suffix.lower() in _Y_UP else "z")
    axis, sign = _AXES[up[-1]], -1.0 if up.startswith("-") else 1.0
    if axis >= dim:
        raise SoftprintError(f"--up {up}: {path.name} is flat, so up is x, y, -x or -y")
    turned = _turned(points, axis, sign)
    made = f"{path.name}: {scale:.4g} m for each unit, {up} up"
    return scale * turned, made


def _turned(points: Array, axis: int, sign: float) -> Array:
    """A rotation that takes an axis to the last one."""
    dim = points.shape[1]
    order = [(axis + 1 + k) % dim for k in range(dim)]
    turned = points[:, order] * 1.0
    if dim == 2 and axis == 0:  # a cyclic exchange of two axes is a reflection
        turned[:, 0] *= -1.0
    if sign < 0:
        turned[:, [0, -1]] *= -1.0
    return turned


def _standing(mesh: Mesh) -> Mesh:
    """The mesh on the ground, the middle of its bounding box above the origin."""
    lower, upper = mesh.points.min(axis=0), mesh.points.max(axis=0)
    origin = np.append(0.5 * (lower + upper)[:-1], lower[-1])
    return Mesh(mesh.points - origin, mesh.cells)
