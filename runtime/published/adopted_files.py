"""The files that `softprint train` needs with an imported body and truth: mesh, collider, experiment."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.placement import frame_in_box
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import atomic_path
from softprint.runtime.mesh import write_mesh
from softprint.runtime.published.layout import PublishedObject


@dataclass(frozen=True)
class GivenMaterial:
    """The material, given by the user because published files do not contain it."""

    model: str
    young: float
    poisson: float
    density: float


def write_experiment(
    folder: Path,
    body: ReducedBody,
    collider: PublishedObject,
    material: GivenMaterial,
    scale: float,
    source: str,
) -> Path:
    """Write ``body.vtu``, the collider's file and ``experiment.toml`` into the folder; returns the last."""
    write_mesh(folder / "body.vtu", body.mesh)
    shape = _write_collider(folder, collider, scale, source)
    frames = [
        f"{{ name = {_text(frame.name)}, box = {_box(body, frame.nodes).tolist()} }}"
        for frame in body.handles.frames
    ]
    points = body.mesh.points[body.handles.points].tolist()
    lines = [
        "# Made from a published data set by `softprint import`. SI units. The user gave material and density;",
        "# contact stiffness, gravity and scenes are not in such a data set: fill them in before simulating.",
        "[experiment]",
        f"name = {_text(body.name)}",
        "",
        "[body]",
        'mesh = "body.vtu"',
        "",
        "[body.handles]",
        "points = [",
        *(f"    {point}," for point in points),
        "]",
        f"frames = [{', '.join(frames)}]",
        f"hold = {_text(body.hold)}",
        "",
        "[body.material]",
        f"model = {_text(material.model)}",
        *(f"{key} = {getattr(material, key)!r}" for key in ("young", "poisson", "density")),
        "",
        "[[colliders]]",
        f"name = {_text(collider.name)}",
        *shape,
        "",
        "[dynamics]",
        f"gravity = {[0.0] * body.dim}",
        "",
        "[[training.models]]",
        'name = "thesis5"',
        'form = "thesis5"',
        "hidden = [250, 250]",
        'activation = "tanh"',
        "",
        "[[training.models]]",
        'name = "ours"',
        "",
    ]
    path = folder / "experiment.toml"
    with atomic_path(path) as temporary:
        temporary.write_text("\n".join(lines), encoding="utf-8")
    return path


def frames_without_box(body: ReducedBody) -> list[str]:
    """Names of the frames that no box describes, because other nodes lie between theirs: an experiment cannot define
    them, so verbs that read an experiment refuse the body."""
    return [
        frame.name
        for frame in body.handles.frames
        if not np.array_equal(frame_in_box(body.mesh, frame.name, _box(body, frame.nodes)).nodes, frame.nodes)
    ]


def _box(body: ReducedBody, nodes: IntArray) -> Array:
    room = 1e-5 * body.mesh.size
    points = body.mesh.points[nodes]
    return np.stack([points.min(axis=0) - room, points.max(axis=0) + room])


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)  # basic strings of TOML have the syntax of JSON strings


def _write_collider(folder: Path, collider: PublishedObject, scale: float, source: str) -> list[str]:
    """The collider's file, and the keys of its table."""
    vertices = scale * collider.rest
    if collider.dim == 3:
        triangles = collider.simplices_of(3)
        if triangles is None:
            raise SoftprintError(f"{source}: {collider.name} has no triangles, so it has no surface")
        import meshio

        with atomic_path(folder / "collider.stl") as temporary:
            meshio.write(temporary, meshio.Mesh(vertices, [("triangle", triangles)]), binary=True)
        return ['shape = "mesh"', 'file = "collider.stl"']
    outline = vertices[_outline(collider, source)]
    with atomic_path(folder / "collider.txt") as temporary:
        np.savetxt(temporary, outline, header="corners of the collider [m]")
    return ['shape = "polygon"', 'file = "collider.txt"']


def _outline(collider: PublishedObject, source: str) -> IntArray:
    """Nodes along the longest closed outline of a 2D collider, from its triangles or its edges."""
    triangles = collider.simplices_of(3)
    edges = collider.simplices_of(2) if triangles is None else _boundary(triangles)
    if edges is None or not len(edges):
        raise SoftprintError(
            f"{source}: {collider.name} has neither triangles nor edges, so it has no outline"
        )
    neighbours: dict[int, list[int]] = {}
    for a, b in edges.tolist():
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    if any(len(ends) != 2 for ends in neighbours.values()):
        raise SoftprintError(f"{source}: the outline of {collider.name} is not closed, or touches itself")
    loops: list[list[int]] = []
    left = set(neighbours)
    while left:
        loop = [min(left)]
        while ahead := [node for node in neighbours[loop[-1]] if node in left and node != loop[0]]:
            left.discard(loop[-1])
            loop.append(ahead[0])
        left -= set(loop)
        loops.append(loop)
    return np.array(max(loops, key=len), dtype=np.int64)


def _boundary(triangles: IntArray) -> IntArray:
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    return unique[count == 1]
