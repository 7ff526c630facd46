"""Draw a scene in 2D or 3D as a PNG."""

from __future__ import annotations

import tempfile
from pathlib import Path

from softprint.runtime.drawing.flat import draw_flat
from softprint.runtime.drawing.picture import Picture
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


def picture(scene: Scene) -> Picture:
    """The picture in memory. Raises as `draw` does."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.png"
        draw(path, scene)
        return Picture(path.read_bytes(), scene.title)
