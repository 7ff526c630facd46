"""Meshes as users bring them: sound and broken ones, of all kinds, written to files at tiny size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import meshio
import numpy as np
import trimesh

from softprint.runtime.mesh import box_mesh

Write = Callable[[Path], object]


@dataclass(frozen=True)
class OwnMesh:
    """A file and what becomes of it. write: makes the file; options: of `softprint new`; refused: a pattern of the
    sentence, empty if it becomes a body; volume: of the body [m^3], where it is known."""

    name: str
    file: str
    write: Write
    options: tuple[str, ...] = ()
    refused: str = ""
    volume: float = 0.0


def _ball(
    radius: float = 0.03, at: tuple[float, ...] = (0.0, 0.0, 0.0), fineness: int = 3
) -> trimesh.Trimesh:
    ball = trimesh.creation.icosphere(subdivisions=fineness, radius=radius)
    ball.apply_translation(at)
    return ball


def _surface(make: Callable[[], trimesh.Trimesh]) -> Write:
    return lambda path: make().export(path)


def _together(*parts: trimesh.Trimesh) -> trimesh.Trimesh:
    return trimesh.util.concatenate(list(parts))


def _box(size: list[float], at: tuple[float, ...]) -> trimesh.Trimesh:
    box = trimesh.creation.box(size)
    box.apply_translation(at)
    return box


def _table() -> trimesh.Trimesh:
    """A slab on four legs, which pass into it."""
    legs = [_box([0.01, 0.01, 0.05], (x, y, 0.025)) for x in (-0.04, 0.04) for y in (-0.025, 0.025)]
    return _together(_box([0.1, 0.07, 0.016], (0.0, 0.0, 0.05)), *legs)


def _without(mesh: trimesh.Trimesh, cut: Callable[[np.ndarray], np.ndarray]) -> trimesh.Trimesh:
    mesh.update_faces(~cut(mesh.triangles_center))
    return mesh


def _fan() -> trimesh.Trimesh:
    """Two boxes that share an edge: four triangles meet there."""
    return _together(
        _box([0.04, 0.04, 0.04], (0.02, 0.02, 0.02)), _box([0.04, 0.04, 0.04], (-0.02, -0.02, 0.02))
    )


def _drawing() -> trimesh.Trimesh:
    return trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]], [[0, 1, 2], [0, 2, 3]])


def _tetrahedra(change: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]) -> Write:
    def write(path: Path) -> None:
        mesh = box_mesh([-0.03, -0.02, 0.0], [0.03, 0.02, 0.04], [4, 3, 3])
        points, cells = change(mesh.points, mesh.cells)
        meshio.write(path, meshio.Mesh(points, [("tetra", cells)]))

    return write


def _two_blocks(points: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.vstack([points, points + np.array([0.2, 0.0, 0.0])]), np.vstack([cells, cells + len(points)])


def _with_a_crumb(points: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    crumb = np.array([0.1, 0.0, 0.0]) + 0.004 * np.vstack([np.zeros(3), np.eye(3)])
    return np.vstack([points, crumb]), np.vstack([cells, len(points) + np.arange(4)])


STAR = "0 0\n0.04 0.01\n0.08 0\n0.06 0.04\n0.07 0.08\n0.04 0.06\n0.01 0.08\n0.02 0.04\n"
SVG = (
    '<svg xmlns="http://www.w3.org/2000/svg" width="10cm" viewBox="0 0 100 80"><g transform="scale(0.5)">'
    '<path d="M0 70 C 0 -20 90 -20 90 70 Z"/><circle cx="45" cy="35" r="12"/></g></svg>'
)


def _dxf(path: Path) -> None:
    from trimesh.path.creation import rectangle

    rectangle([[0.0, 0.0], [60.0, 40.0]]).export(path, file_type="dxf")


BALL = 4.0 / 3.0 * np.pi * 0.03**3
OWN_MESHES = (
    OwnMesh("closed", "ball.stl", _surface(_ball), volume=BALL),
    OwnMesh("millimetres", "ball.obj", _surface(lambda: _ball(30.0)), ("--units", "mm"), volume=BALL),
    OwnMesh("scene", "ball.glb", _surface(_ball), volume=BALL),
    OwnMesh("hole through it", "ring.ply", _surface(lambda: trimesh.creation.torus(0.04, 0.014))),
    OwnMesh("thin legs, passing into each other", "table.stl", _surface(_table)),
    OwnMesh(
        "cap missing",
        "cup.ply",
        _surface(lambda: _without(_ball(), lambda x: x[:, 2] > 0.02)),
        volume=0.926 * BALL,
    ),
    OwnMesh("edge of four triangles", "fan.stl", _surface(_fan)),
    OwnMesh(
        "crumb beside it",
        "crumb.stl",
        _surface(lambda: _together(_ball(), _ball(0.003, (0.04, 0.0, 0.0), 1))),
    ),
    OwnMesh(
        "pieces near each other",
        "near.stl",
        _surface(lambda: _together(_ball(), _ball(0.02, (0.0505, 0, 0)))),
    ),
    OwnMesh(
        "pieces far apart",
        "two.stl",
        _surface(lambda: _together(_ball(), _ball(0.03, (0.2, 0, 0)))),
        refused="2 pieces",
    ),
    OwnMesh(
        "sheet",
        "sheet.stl",
        _surface(lambda: _without(_ball(), lambda x: x[:, 2] < 0.02)),
        refused="well-defined",
    ),
    OwnMesh("flat", "drawing.stl", _surface(_drawing), refused="flat"),
    OwnMesh("kilometres", "huge.stl", _surface(lambda: _ball(3e4)), refused="--units"),
    OwnMesh("a mote", "tiny.stl", _surface(lambda: _ball(3e-5)), refused="--units"),
    OwnMesh("tetrahedra", "block.vtu", _tetrahedra(lambda p, c: (p, c)), volume=0.06 * 0.04 * 0.04),
    OwnMesh(
        "turned round",
        "inverted.msh",
        _tetrahedra(lambda p, c: (p, c[:, [1, 0, 2, 3]])),
        volume=0.06 * 0.04 * 0.04,
    ),
    OwnMesh("two blocks", "blocks.vtu", _tetrahedra(_two_blocks), refused="2 pieces"),
    OwnMesh("block with a crumb", "crumbs.vtu", _tetrahedra(_with_a_crumb), volume=0.06 * 0.04 * 0.04),
    OwnMesh("polygon", "star.txt", lambda path: path.write_text(STAR)),
    OwnMesh("drawing with a hole", "face.svg", lambda path: path.write_text(SVG), ("--units", "mm")),
    OwnMesh("technical drawing", "plate.dxf", _dxf, ("--scale", "0.001"), volume=0.06 * 0.04),
    OwnMesh(
        "crossing itself", "bow.txt", lambda path: path.write_text("0 0\n1 1\n1 0\n0 1\n"), refused="cross"
    ),
    OwnMesh(
        "open line",
        "line.svg",
        lambda path: path.write_text('<svg><path d="M0 0 L10 10 L20 0"/></svg>'),
        refused="no closed outline",
    ),
    OwnMesh(
        "not a mesh",
        "letter.stl",
        lambda path: path.write_bytes(b"Dear reader,\n"),
        refused="cannot be read|no triangles",
    ),
)
