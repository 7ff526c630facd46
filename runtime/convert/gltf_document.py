"""The two parts of a glTF 2.0 file: a JSON document, and the binary data that it refers to, written piece by piece.

Section numbers are those of the glTF 2.0 specification (Khronos, 2021).
"""

from __future__ import annotations

import json
import shutil
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array
from softprint.runtime.errors import SoftprintError

_FLOAT, _UINT16, _UINT32 = 5126, 5123, 5125  # componentType, table 3.6.2.2
_VERTICES, _INDICES = 34962, 34963  # bufferView.target
_LARGEST = 2**32 - 1  # bytes of a GLB file, whose length is a uint32 (4.4.2)
_SPARSE = 0.8  # of the bytes that all values take: sparse storage has to save a fifth


class Document:
    """Arrays added are written to `binary` at once, and known by the number of their accessor."""

    def __init__(self, binary: BinaryIO) -> None:
        self._binary, self._length = binary, 0
        self.json: dict[str, Any] = {"asset": {"version": "2.0", "generator": "Softprint"}}

    def add(self, kind: str, entry: Mapping[str, Any]) -> int:
        """Append to one of the lists of the document; returns the number there."""
        entries = self.json.setdefault(kind, [])
        entries.append(dict(entry))
        return len(entries) - 1

    def floats(self, values: Array, vertices: bool = False, bounds: bool = False) -> int:
        """An accessor of (n,) scalars or (n, 2 to 4) vectors, in float32; vertices: for a mesh, not an animation;
        bounds: with the least and the largest value, which positions and times must have."""
        data = np.ascontiguousarray(values, dtype="<f4")
        view = self._view(data, _VERTICES if vertices else None)
        return self.add("accessors", {"bufferView": view, **_described(data, bounds)})

    def deltas(self, values: Array, negligible: float, bounds: bool = False) -> int:
        """An accessor of vectors (n, 3) of a morph target; those shorter than `negligible` are zero, and left out of
        the file where that makes it smaller (sparse accessors, 3.6.2.3)."""
        data = np.ascontiguousarray(values, dtype="<f4")
        data[np.linalg.norm(data, axis=1) <= negligible] = 0.0
        kept = np.flatnonzero(data.any(axis=1))
        width = 2 if len(data) <= 2**16 else 4
        if len(kept) * (width + 12) > _SPARSE * data.nbytes:
            return self.floats(data, vertices=True, bounds=bounds)
        accessor = _described(data, bounds)
        if len(kept):
            index = self._view(kept.astype(f"<u{width}"))
            accessor["sparse"] = {
                "count": len(kept),
                "indices": {"bufferView": index, "componentType": _UINT16 if width == 2 else _UINT32},
                "values": {"bufferView": self._view(data[kept])},
            }
        return self.add("accessors", accessor)

    def indices(self, index: NDArray[np.int64]) -> int:
        """An accessor of the corners of triangles or segments, flattened."""
        data = np.ascontiguousarray(index.ravel(), dtype="<u4")
        described = {"componentType": _UINT32, "count": len(data), "type": "SCALAR"}
        return self.add("accessors", {"bufferView": self._view(data, _INDICES), **described})

    def _view(self, data: NDArray[Any], target: int | None = None) -> int:
        """Write an array, at a multiple of four bytes (3.6.2.4)."""
        begin = self._length
        self._binary.write(data.tobytes() + b"\0" * (-data.nbytes % 4))
        self._length += data.nbytes + -data.nbytes % 4
        view = {"buffer": 0, "byteOffset": begin, "byteLength": data.nbytes}
        return self.add("bufferViews", view if target is None else {**view, "target": target})

    def write_glb(self, path: Path, binary: BinaryIO) -> None:
        """One file: header, JSON and binary data (section 4.4)."""
        self.json["buffers"] = [{"byteLength": self._length}]
        text = json.dumps(self.json, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        total = 12 + 8 + len(text) + 8 + self._length
        if total > _LARGEST:
            raise SoftprintError(
                f"{path.name} would have {total / 2**30:.1f} GiB, and GLB files end at 4: convert fewer frames with "
                "--every, --from and --to, or write a .gltf"
            )
        with path.open("wb") as file:
            file.write(struct.pack("<4sII", b"glTF", 2, total))
            file.write(struct.pack("<I4s", len(text), b"JSON") + text)
            file.write(struct.pack("<I4s", self._length, b"BIN\0"))
            binary.seek(0)
            shutil.copyfileobj(binary, file)

    def write_gltf(self, path: Path, binary_name: str) -> None:
        """The JSON document alone, for binary data in a file of that name beside it."""
        self.json["buffers"] = [{"byteLength": self._length, "uri": binary_name}]
        path.write_text(json.dumps(self.json, indent=1))


def _described(data: NDArray[Any], bounds: bool) -> dict[str, Any]:
    scalar = data.ndim == 1
    described: dict[str, Any] = {
        "componentType": _FLOAT,
        "count": len(data),
        "type": "SCALAR" if scalar else f"VEC{data.shape[1]}",
    }
    if bounds:
        for key, values in (("min", data.min(axis=0)), ("max", data.max(axis=0))):
            described[key] = np.atleast_1d(values).tolist()
    return described
