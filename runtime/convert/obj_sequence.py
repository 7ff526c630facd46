"""A sequence of OBJ files, one for each frame: OUT_0001.obj, OUT_0002.obj, and so on.

Body and colliders are objects of their own (`o`) in world coordinates [m]: triangles, and in 2D, where z = 0, outlines
of colliders as lines. Vertices keep their order from file to file.

The files are written into a hidden folder beside them and moved when all are there, so an interrupted conversion leaves
those of an earlier one. Frames of an earlier, longer sequence of the same name are removed.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from softprint.runtime.convert.frames import Frame, SurfaceMotion, in_space
from softprint.runtime.convert.obj_text import is_ours, write_head, write_object
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import temporary_beside


def write_obj_sequence(out: Path, motion: SurfaceMotion, progress: Callable[[int], None]) -> list[Path]:
    """Write the files; returns their paths."""
    digits = max(4, len(str(len(motion))))
    with _sequence(out) as folder:
        for number, frame in enumerate(motion.frames(), start=1):
            path = folder / f"{out.stem}_{number:0{digits}}{out.suffix}"
            with path.open("w", encoding="ascii", errors="replace") as file:
                _write_frame(file, motion, frame)
            progress(1)
    return sorted(out.parent / path for path in _numbered(out))


def _write_frame(file: TextIO, motion: SurfaceMotion, frame: Frame) -> None:
    write_head(file, f"{motion.source.label}, {frame.time:.9g} s")
    write_object(file, "body", in_space(frame.points), motion.triangles)
    start = 1 + len(frame.points)
    for name, (vertices, facets) in motion.solids.items():
        write_object(file, name, in_space(frame.poses[name].apply(vertices)), facets, start)
        start += len(vertices)


def _numbered(out: Path) -> list[str]:
    """Names of files of a sequence of this name."""
    ours = re.compile(rf"{re.escape(out.stem)}_\d{{4,}}{re.escape(out.suffix)}")
    return [path.name for path in out.parent.iterdir() if ours.fullmatch(path.name)]


@contextmanager
def _sequence(out: Path) -> Iterator[Path]:
    """A folder to write the files of a sequence into; they are moved to where `out` is if all goes well."""
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        folder = temporary_beside(out)
        folder.mkdir()
        try:
            yield folder
            new = sorted(folder.iterdir())
            for path in (out.parent / path.name for path in new):
                if path.is_file() and not is_ours(path):
                    raise SoftprintError(
                        f"{path}: a file of another program is where a frame of {out.name} goes"
                    )
            for path in new:
                os.replace(path, out.parent / path.name)
            for name in set(_numbered(out)) - {path.name for path in new}:
                if is_ours(out.parent / name):
                    (out.parent / name).unlink()
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    except OSError as error:
        raise SoftprintError(f"cannot write {out.parent / out.stem}_*: {error.strerror or error}") from error
