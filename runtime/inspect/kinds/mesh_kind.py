"""A body's mesh: triangles in 2D or tetrahedra in 3D, in any format that meshio reads."""

from __future__ import annotations

from pathlib import Path

from softprint.runtime.drawing.scene import Scene
from softprint.runtime.inspect.file_head import FileHead
from softprint.runtime.inspect.kind import Kind, Part
from softprint.runtime.inspect.mesh_quality import mesh_facts
from softprint.runtime.inspect.summary import Summary
from softprint.runtime.mesh import read_mesh

SUFFIXES = (".vtu", ".vtk", ".msh", ".mesh", ".xml", ".inp", ".med", ".bdf", ".avs")


def recognise(head: FileHead) -> bool:
    return head.suffix in SUFFIXES


def summarise(path: Path, part: Part) -> Summary:
    """Reads and checks it as `softprint body` does."""
    return Summary(path, "a mesh for a body", {"mesh": mesh_facts(read_mesh(path))})


def scene(path: Path, part: Part, experiment: Path | None) -> Scene:
    mesh = read_mesh(path)
    return Scene(path.name, mesh.points, mesh.facets, mesh.cells if mesh.dim == 2 else None, edges=True)


KIND = Kind(recognise, summarise, scene=scene)
