"""Which library fills a surface with tetrahedra: fTetWild or gmsh, on the same surfaces with the same wanted number
of cells.

    python -m benchmarks.meshers [--cells 15000] [SURFACE ...]

Surfaces: files, or `ant`, `airplane` and `nut` of PyVista, the caltrop and the hand of `meshes/`, and shapes of the
library by their names. Both get the repaired surface (`runtime/authoring/solid_surface.py`). gmsh: the surface cut
into patches at sharp edges, remeshed, and filled; fTetWild: as `softprint new` does it. Time of the processor,
without the examination. The shape of a cell is its mean ratio, 1 for a regular tetrahedron; distances in shares of
the surface's diagonal.
"""

from __future__ import annotations

import argparse
import logging
import resource
import time
from pathlib import Path

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.authoring.fidelity import fidelity
from softprint.runtime.authoring.fill_surface import filled
from softprint.runtime.authoring.pieces import largest_piece
from softprint.runtime.authoring.solid_surface import solid_surface
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders.library import library_surface
from softprint.runtime.colliders.surface_mesh.mesh_collider import read_triangles
from softprint.runtime.inspect.mesh_quality import cell_angles, mean_ratio
from softprint.runtime.mesh import Mesh, oriented_mesh, read_mesh, write_mesh

MESHES = Path(__file__).resolve().parent.parent / "meshes"
SURFACES = ("nut", "caltrop", "hand", "coral", "ant", "airplane")
SHARP = 40.0  # degrees: gmsh keeps edges that are sharper
EDGE = 2.0  # edge over the cube root of a cell's volume, of cells that gmsh makes


def surface(name: str) -> tuple[Array, IntArray]:
    """Vertices and triangles by name, or of a file."""
    if name in ("ant", "airplane", "nut"):
        import pyvista

        return read_triangles(Path(pyvista.__file__).parent / "examples" / f"{name}.ply")
    if name == "caltrop":
        return read_triangles(MESHES / "pointy.stl")
    if name == "hand":
        mesh = read_mesh(MESHES / "hand_small.vtu")
        return mesh.points, mesh.facets
    return read_triangles(Path(name)) if Path(name).is_file() else library_surface(name)


def by_gmsh(
    vertices: Array, triangles: IntArray, wanted: int, volume: float, source: str
) -> tuple[Array, IntArray]:
    """Points and tetrahedra. The number is corrected twice."""
    edge = EDGE * (volume / wanted) ** (1.0 / 3.0)
    for _ in range(3):
        points, cells = _gmsh_once(vertices, triangles, edge)
        if abs(len(cells) / wanted - 1.0) < 0.15:
            break
        edge *= (len(cells) / wanted) ** (1.0 / 3.0)
    return points, cells


def _gmsh_once(vertices: Array, triangles: IntArray, edge: float) -> tuple[Array, IntArray]:
    import gmsh

    gmsh.initialize(interruptible=False)
    try:
        for name, value in {
            "General.Terminal": 0,
            "Mesh.MeshSizeMin": edge,
            "Mesh.MeshSizeMax": edge,
            "Mesh.MeshSizeFromPoints": 0,
            "Mesh.MeshSizeExtendFromBoundary": 0,
            "Mesh.OptimizeNetgen": 1,
        }.items():
            gmsh.option.setNumber(name, value)
        tag = gmsh.model.addDiscreteEntity(2)
        gmsh.model.mesh.addNodes(2, tag, np.arange(1, len(vertices) + 1), vertices.ravel())
        gmsh.model.mesh.addElementsByType(tag, 2, [], (triangles + 1).ravel())
        gmsh.model.mesh.classifySurfaces(np.radians(SHARP), True, True, np.pi)
        gmsh.model.mesh.createGeometry()
        patches = [patch for _, patch in gmsh.model.getEntities(2)]
        gmsh.model.geo.addVolume([gmsh.model.geo.addSurfaceLoop(patches)])
        gmsh.model.geo.synchronize()
        gmsh.model.mesh.generate(3)
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        number = np.zeros(int(tags.max()) + 1, dtype=np.int64)
        number[tags] = np.arange(len(tags))
        cells = gmsh.model.mesh.getElementsByType(4)[1]
        return coordinates.reshape(-1, 3), number[cells].reshape(-1, 4)
    finally:
        gmsh.finalize()


def by_ftetwild(
    vertices: Array, triangles: IntArray, wanted: int, volume: float, source: str
) -> tuple[Array, IntArray]:
    """Points and tetrahedra, as `softprint new` makes them."""
    found = filled(vertices, triangles, wanted, volume, source)
    return found.points, found.cells


def spent() -> float:
    """Time of the processor, of this process and of those it waited for [s]."""
    own, children = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime


def row(mesh: Mesh, seconds: float, vertices: Array, triangles: IntArray) -> str:
    """Figures of one mesh."""
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    apart = fidelity(
        (vertices, triangles), (mesh.points, mesh.facets), float(mesh.cell_volumes.mean()) ** (1.0 / 3.0)
    )
    shape = mean_ratio(mesh)
    return (
        f"{seconds:6.1f} s | {mesh.n_cells:,} | {cell_angles(mesh).min():.1f} deg | {shape.min():.2f}, "
        f"{np.quantile(shape, 0.01):.2f}, {np.median(shape):.2f} | {apart.there_most / diagonal:.2%}, "
        f"{apart.there_mean / diagonal:.3%} | {apart.back_most / diagonal:.2%}, {apart.back_mean / diagonal:.3%}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("surfaces", nargs="*", default=SURFACES)
    parser.add_argument("--cells", type=int, default=15_000)
    parser.add_argument("--keep", type=Path, help="a folder to write the meshes to")
    args = parser.parse_args()
    logging.disable()
    print(
        "surface | by | time | cells | least angle | shape: worst, 1 %, median | to the new surface: most, mean | back"
    )
    for name in args.surfaces:
        began = time.process_time()
        solid = solid_surface(*surface(name), name, args.cells)
        done = "; ".join(solid.done) or "closed"
        print(
            f"{name}: {len(solid.triangles):,} triangles, examined in {time.process_time() - began:.1f} s: {done}"
        )
        for by, fill in (("fTetWild", by_ftetwild), ("gmsh", by_gmsh)):
            began = spent()
            try:
                points, cells = fill(solid.vertices, solid.triangles, args.cells, solid.volume, name)
                seconds = spent() - began
                kept, pieces = largest_piece(points, cells)
                mesh = oriented_mesh(points, kept, name)
                lost = "" if pieces.one_is_enough else f" ({pieces})"
                print(
                    f"{name} | {by} | {row(mesh, seconds, solid.vertices, solid.triangles)}{lost}", flush=True
                )
                if args.keep:
                    write_mesh(args.keep / f"{Path(name).stem}_{by}.vtu", mesh)
            except Exception as error:
                print(
                    f"{name} | {by} | fails after {spent() - began:.1f} s: {str(error).splitlines()[0]}",
                    flush=True,
                )


if __name__ == "__main__":
    run_script(main)
