"""Mesh files through meshio: any format that holds triangles or tetrahedra."""

from __future__ import annotations

import contextlib
import io
import logging
from pathlib import Path

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import atomic_path
from softprint.runtime.io.memory_bound import memory_bound
from softprint.runtime.mesh.check import oriented_mesh
from softprint.runtime.mesh.mesh import Mesh

log = logging.getLogger(__name__)

_LOWER = {"vertex", "line"}  # that gmsh writes in addition to the cells of the body
_HINT_SURFACE = "a body needs its inside meshed too: `softprint new` fills a surface with tetrahedra"


def read_mesh(path: Path | str) -> Mesh:
    """Read, repair and check a body's mesh [m].

    Tetrahedra make a 3D body; triangles, all with the same z, a 2D body. Cells of lower dimension are
    ignored. Raises SoftprintError for a missing or unreadable file, other or mixed kinds of cells, a
    triangle surface in 3D, and for every defect that :func:`runtime.mesh.oriented_mesh` refuses.
    """
    source = Path(path)
    points, cells = simplices(source, *read_cells(source))
    mesh = oriented_mesh(points, cells, str(source))
    log.info(
        "%s: %d nodes, %d %s",
        source,
        mesh.n_nodes,
        mesh.n_cells,
        "triangles" if mesh.dim == 2 else "tetrahedra",
    )
    return mesh


def simplices(source: Path, points: Array, blocks: dict[str, IntArray]) -> tuple[Array, IntArray]:
    """Points (n, dim) [m] and the cells (m, dim+1) that make a body, of the content of a file. Raises SoftprintError
    for other or mixed kinds of cells, and for a triangle surface in 3D."""
    if "tetra" in blocks:
        cells, foreign = blocks["tetra"], set(blocks) - _LOWER - {"tetra", "triangle"}
        if points.shape[1] != 3:
            raise SoftprintError(
                f"{source}: tetrahedra need points in 3D, these have {points.shape[1]} coordinates"
            )
    elif "triangle" in blocks:
        cells, foreign = blocks["triangle"], set(blocks) - _LOWER - {"triangle"}
    else:
        found = ", ".join(sorted(blocks)) or "no cells at all"
        raise SoftprintError(
            f"{source}: holds {found}; a body needs linear triangles (2D) or linear tetrahedra (3D)"
        )
    if foreign:
        raise SoftprintError(
            f"{source}: mixes cells of several kinds ({', '.join(sorted(foreign))} besides the simplices): "
            "export linear triangles or tetrahedra only"
        )
    if cells.shape[1] == 3 and points.shape[1] == 3:
        if not lies_in_plane(points, cells):
            raise SoftprintError(f"{source}: is a triangle surface in 3D, not a solid; {_HINT_SURFACE}")
        points = points[:, :2]
    return points, cells


def lies_in_plane(points: Array, cells: IntArray) -> bool:
    """Whether all corners of the cells (m, k) at points (n, 2 or 3) have the same z, so that they are a 2D mesh."""
    if points.shape[1] == 2:
        return True
    used = points[np.unique(cells)]
    return bool(np.ptp(used[:, 2]) <= 1e-9 * max(np.ptp(used, axis=0).max(), np.finfo(float).tiny))


def read_cells(source: Path) -> tuple[Array, dict[str, IntArray]]:
    """The points (n, 2 or 3) of a file and its cells of each kind. Raises SoftprintError for a missing or unreadable
    file, and for cells of nodes that are not there."""
    import meshio

    if not source.is_file():
        raise SoftprintError(f"{source}: there is no such mesh file")
    try:
        # meshio prints errors and calls sys.exit when no reader accepts the file.
        with (
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(io.StringIO()),
            memory_bound(source),
        ):
            raw = meshio.read(source)
    except MemoryError as error:
        raise SoftprintError(
            f"{source}: asks for far more memory than a mesh of its size can need"
        ) from error
    except (SystemExit, Exception) as error:
        raise SoftprintError(
            f"{source}: cannot be read as a mesh: empty, truncated, or of a format that meshio does not know"
        ) from error
    blocks: dict[str, list[IntArray]] = {}
    for block in raw.cells:
        data = np.asarray(block.data, dtype=np.int64)
        if data.size:
            if data.max() >= len(raw.points) or data.min() < 0:
                raise SoftprintError(
                    f"{source}: a cell names node {data.max()}, but there are only {len(raw.points)} nodes"
                )
            blocks.setdefault(block.type, []).append(data)
    return np.asarray(raw.points, dtype=np.float64), {
        kind: np.concatenate(parts) for kind, parts in blocks.items()
    }


def write_mesh(path: Path | str, mesh: Mesh) -> None:
    """Write the mesh (atomically) in the format of the suffix.

    .vtu is compressed and has 32-bit numbers: for a body of 0.1 m float32 coordinates round at 1e-8 m.
    """
    import meshio

    compact = Path(path).suffix == ".vtu"  # other writers of meshio, such as gmsh's, need 64-bit coordinates
    points = np.zeros((mesh.n_nodes, 3), dtype=np.float32 if compact else np.float64)
    points[:, : mesh.dim] = mesh.points
    cells = mesh.cells.astype(np.int32) if compact else mesh.cells
    with atomic_path(path) as temporary:
        meshio.write(temporary, meshio.Mesh(points, [("triangle" if mesh.dim == 2 else "tetra", cells)]))
