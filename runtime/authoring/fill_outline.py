"""Fill a 2D outline with triangles by gmsh."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.authoring.fill_surface import RIGHT, refuse_count
from softprint.runtime.colliders.sampled.polygon import polygon_distance, simple_polygon
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import Mesh, oriented_mesh

_EQUILATERAL = np.sqrt(3.0) / 4.0  # area over the square of the edge
_TRIES = 4


def filled_outline(loops: list[Array], wanted: int, source: str) -> Mesh:
    """About `wanted` triangles inside closed loops of corners (n, 2): one outline, and holes in it.

    Raises SoftprintError for loops that cross, and for several outlines.
    """
    refuse_count(wanted)
    outer, *holes = nested_loops(loops, source)
    area = abs(_area(outer)) - sum(abs(_area(hole)) for hole in holes)
    edge = float(np.sqrt(area / (wanted * _EQUILATERAL)))
    best: Mesh | None = None
    for _ in range(_TRIES):
        mesh = oriented_mesh(*_triangles([outer, *holes], edge, source), source)
        if best is None or abs(np.log(mesh.n_cells / wanted)) < abs(np.log(best.n_cells / wanted)):
            best = mesh
        if abs(best.n_cells / wanted - 1.0) <= RIGHT / 2:
            break
        edge *= float(np.sqrt(mesh.n_cells / wanted))
    assert best is not None
    return best


def nested_loops(loops: list[Array], source: str) -> list[Array]:
    """The outer loop first; all others are directly inside it. Raises SoftprintError for loops that cross."""
    order = sorted((simple_polygon(loop, source) for loop in loops), key=lambda loop: -abs(_area(loop)))
    outer, holes = order[0], order[1:]
    for number, hole in enumerate(holes):
        inside = polygon_distance(hole, outer)
        if not (inside < 0).all():
            raise SoftprintError(
                f"{source}: has several outlines, and one is not inside the largest; a body is one piece: keep "
                "one of them"
            )
        for other in holes[:number]:
            if (polygon_distance(hole, other) <= 0).any() or (polygon_distance(other, hole) <= 0).any():
                raise SoftprintError(
                    f"{source}: two of its holes meet, or one lies in the other; keep one of them"
                )
    return order


def _area(loop: Array) -> float:
    after = np.roll(loop, -1, axis=0)
    return float(0.5 * np.sum(loop[:, 0] * after[:, 1] - loop[:, 1] * after[:, 0]))


def _triangles(loops: list[Array], edge: float, source: str) -> tuple[Array, IntArray]:
    import gmsh

    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MeshSizeMax", edge)
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
        gmsh.option.setNumber("Mesh.Algorithm", 6)  # frontal Delaunay: nearly equilateral
        geometry, curves = gmsh.model.geo, []
        for loop in loops:
            corners = [geometry.addPoint(x, y, 0.0) for x, y in loop.tolist()]
            lines = [geometry.addLine(a, b) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]
            curves.append(geometry.addCurveLoop(lines))
        geometry.addPlaneSurface(curves)
        geometry.synchronize()
        gmsh.model.mesh.generate(2)
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        number = np.zeros(int(tags.max()) + 1, dtype=np.int64)
        number[tags] = np.arange(len(tags))
        corners = gmsh.model.mesh.getElementsByType(2)[1]
    except Exception as error:  # gmsh raises plain exceptions
        raise SoftprintError(f"{source}: gmsh could not fill the outline: {error}") from error
    finally:
        gmsh.finalize()
    return coordinates.reshape(-1, 3)[:, :2], number[corners].reshape(-1, 3)
