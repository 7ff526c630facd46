"""PC2 point caches: the vertices of every frame, and beside them an OBJ file of the surface at rest with the same
vertices in the same order, on which Blender's Mesh Cache modifier plays them.

    header: "POINTCACHE2\\0", int32 version 1, int32 points, float32 first frame, float32 frames a sample, int32 samples
    then of every sample the points as float32 x, y, z [m]                                          all little-endian

Colliders are not in it: the format holds the vertices of one mesh.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

from softprint.runtime.convert.frames import SurfaceMotion, in_space
from softprint.runtime.convert.obj_text import is_ours, write_head, write_object
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import atomic_path

_HEADER = struct.Struct("<12siiffi")


def write_point_cache(out: Path, motion: SurfaceMotion, progress: Callable[[int], None]) -> list[Path]:
    """Write OUT.pc2 and OUT.obj; returns their paths."""
    surface = out.with_suffix(".obj")
    if surface.is_file() and not is_ours(surface):
        raise SoftprintError(
            f"{surface}: a file of another program is where the surface at rest of {out.name} goes"
        )
    with atomic_path(surface) as rest, atomic_path(out) as temporary:
        with rest.open("w", encoding="ascii", errors="replace") as text:
            write_head(text, f"the surface at rest that {out.name} moves")
            write_object(text, "body", in_space(motion.rest), motion.triangles)
        with temporary.open("wb") as file:
            file.write(_HEADER.pack(b"POINTCACHE2\0", 1, len(motion.nodes), 0.0, 1.0, len(motion)))
            for frame in motion.frames():
                file.write(in_space(frame.points).astype("<f4").tobytes())
                progress(1)
    return [out, surface]
