"""The skin and the joints of the generic hand of the npm package `@webxr-input-profiles/assets`, under the licence in
`hand_LICENSE.txt` (MIT).

The package is fetched by npm where it is not at hand, and must be the one whose SHA-512 stands here, byte for byte.
"""

from __future__ import annotations

import base64
import hashlib
import json
import subprocess
import tarfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.errors import SoftprintError

PACKAGE, VERSION = "@webxr-input-profiles/assets", "1.0.20"
SHA512 = "V/8NB4Ywgm//TBVMgo0TgJ9DtxsBoo0iiaF8AdfiP0F0cgbwkuQycEZAIOsplyd/iZ8L3mrFYNJBC6rzQb4tJA=="
MEMBER = "package/dist/profiles/generic-hand/right.glb"

_TYPES = {5121: "u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}  # componentType of glTF
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


class Skin(NamedTuple):
    """vertices (v, 3) [m], triangles (t, 3): closed, facing outward; joints: their places (3,) [m] by name.

    The hand is a right one and lies with its palm down (-z), its fingers along x, its thumb to +y.
    """

    vertices: Array
    triangles: IntArray
    joints: dict[str, Array]


def read_skin(folder: Path) -> Skin:
    """From the package in the folder, which npm puts there if need be."""
    archive = folder / f"{PACKAGE.strip('@').replace('/', '-')}-{VERSION}.tgz"
    if not archive.is_file():
        subprocess.run(["npm", "pack", f"{PACKAGE}@{VERSION}"], cwd=folder, check=True)
    found = base64.b64encode(hashlib.sha512(archive.read_bytes()).digest()).decode()
    if found != SHA512:
        raise SoftprintError(f"{archive}: its SHA-512 is {found}; it must be {SHA512}")
    with tarfile.open(archive) as package:
        member = package.extractfile(MEMBER)
        if member is None:
            raise SoftprintError(f"{archive}: has no {MEMBER}")
        return _skin(member.read())


def _skin(binary: bytes) -> Skin:
    """Of a binary glTF: a head of 12 bytes, the description as JSON and the arrays, each behind 8 bytes of its own."""
    length = int.from_bytes(binary[12:16], "little")
    described: dict[str, Any] = json.loads(binary[20 : 20 + length])
    arrays = binary[20 + length + 8 :]

    def array(number: int) -> Array:
        entry = described["accessors"][number]
        view = described["bufferViews"][entry["bufferView"]]
        width = _WIDTHS[entry["type"]]
        start = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
        flat = np.frombuffer(arrays, _TYPES[entry["componentType"]], entry["count"] * width, start)
        return flat.reshape(-1, width)

    primitive, skin = described["meshes"][0]["primitives"][0], described["skins"][0]
    points = array(primitive["attributes"]["POSITION"]).astype(np.float64)
    # Seams of the texture double vertices: those in one place are one.
    _, first, merged = np.unique(points.round(6), axis=0, return_index=True, return_inverse=True)
    triangles = merged.ravel()[array(primitive["indices"]).reshape(-1, 3).astype(np.int64)]
    to_joint = array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)
    places = np.linalg.inv(to_joint)[:, :3, 3]
    names = [described["nodes"][node]["name"] for node in skin["joints"]]
    return Skin(_laid(points[first]), triangles, dict(zip(names, _laid(places))))


def _laid(points: Array) -> Array:
    """From the package's axes to palm down, fingers along x."""
    return np.column_stack([-points[:, 1], -points[:, 2], points[:, 0]])
