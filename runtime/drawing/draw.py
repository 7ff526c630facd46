"""Draw a scene in 2D or 3D as a PNG."""

from __future__ import annotations

from pathlib import Path

from softprint.runtime.drawing.flat import draw_flat
from softprint.runtime.drawing.scene import Scene
from softprint.runtime.drawing.solid import draw_solid
from softprint.runtime.errors import SoftprintError


def draw(path: Path, scene: Scene) -> None:
    """Write the picture as PNG, atomically. Raises SoftprintError if the drawing library is missing."""
    if path.suffix.lower() != ".png":
        raise SoftprintError(f"{path}: pictures are written as PNG; call it {path.stem}.png")
    if scene.dim == 2:
        draw_flat(path, scene)
    else:
        draw_solid(path, scene)
