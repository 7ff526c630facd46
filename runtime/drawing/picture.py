"""Pictures in memory, which notebooks show where they are the last value of a cell."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from pathlib import Path

from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import atomic_path


@dataclass(frozen=True)
class Picture:
    """A still picture. png: its file's bytes; title: a text alternative."""

    png: bytes
    title: str

    def _repr_png_(self) -> bytes:
        return self.png

    def __repr__(self) -> str:
        return f"Picture({self.title!r}, {len(self.png) // 1024} kB of PNG)"

    def save(self, path: Path | str) -> None:
        """Write the PNG file, atomically."""
        _save(Path(path), ".png", self.png)


@dataclass(frozen=True)
class Animation:
    """Moving pictures. gif: the file's bytes; still: one frame, where nothing moves (a printed notebook)."""

    gif: bytes
    still: Picture

    def _repr_html_(self) -> str:
        data = base64.b64encode(self.gif).decode("ascii")
        return f'<img src="data:image/gif;base64,{data}" alt="{_escaped(self.still.title)}">'

    def _repr_png_(self) -> bytes:
        return self.still.png

    def __repr__(self) -> str:
        return f"Animation({self.still.title!r}, {len(self.gif) // 1024} kB of GIF)"

    def save(self, path: Path | str) -> None:
        """Write the GIF file, atomically."""
        _save(Path(path), ".gif", self.gif)


def _escaped(text: str) -> str:
    from html import escape

    return escape(text, quote=True)


def _save(path: Path, suffix: str, data: bytes) -> None:
    if path.suffix.lower() != suffix:
        raise SoftprintError(f"{path}: this picture is saved as {path.stem}{suffix}")
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)
