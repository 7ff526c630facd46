"""A body's mesh: triangles in the plane or tetrahedra, in any format that meshio reads."""

from __future__ import annotations

from pathlib import Path

from runtime.drawing.scene import Scene
from runtime.inspect.file_head import FileHead
from runtime.inspect.kinds import Kind, Part
from runtime.inspect.mesh_quality import mesh_facts
from runtime.inspect.summary import Summary
from runtime.mesh import read_mesh

SUFFIXES = (".vtu", ".vtk", ".msh", ".mesh", ".xml", ".inp", ".med", ".bdf", ".avs")


def recognise(head: FileHead) -> bool:
    return head.suffix in SUFFIXES


def summarise(path: Path, part: Part) -> Summary:
    """Read and check it as `softprint body` does."""
    return Summary(path, "a mesh for a body", {"mesh": mesh_facts(read_mesh(path))})


def scene(path: Path, part: Part, experiment: Path | None) -> Scene:
    mesh = read_mesh(path)
    return Scene(path.name, mesh.points, mesh.facets, mesh.cells if mesh.dim == 2 else None, edges=True)


KIND = Kind(recognise, summarise, scene=scene)
