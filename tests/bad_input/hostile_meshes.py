"""Hostile and broken geometry: variants of good files as from faulty exporters, transfers or attackers.

Each function yields (name, kind of reader, suffix, content); the same seed makes the same files.
"""

from __future__ import annotations

import base64
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

Variant = tuple[str, str, str, bytes]


def battered(name: str, kind: str, suffix: str, good: bytes, rng: np.random.Generator) -> Iterator[Variant]:
    """Damage to any kind of file: cut off, bytes altered, lost, doubled, another file with that name."""
    for share in (0.0, 0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99):
        yield f"{name} cut to {share:.0%}", kind, suffix, good[: int(share * len(good))]
    for place in rng.integers(len(good), size=12):
        altered = bytearray(good)
        altered[place] ^= int(rng.integers(1, 256))
        yield f"{name} byte {place} altered", kind, suffix, bytes(altered)
    for place in rng.integers(min(200, len(good)), size=6):  # where most formats store their counts
        yield f"{name} ones from {place}", kind, suffix, good[:place] + b"\xff" * 4 + good[place + 4 :]
    place = len(good) // 2
    yield f"{name} hole", kind, suffix, good[:place] + good[place + 37 :]
    yield f"{name} doubled", kind, suffix, good + good
    yield f"{name} of text", kind, suffix, b"a shopping list\nbread\n"
    yield f"{name} of noughts", kind, suffix, bytes(2000)
    yield f"{name} of noise", kind, suffix, rng.bytes(3000)
    yield f"{name} of an archive", kind, suffix, b"PK\x03\x04" + rng.bytes(500)


def _ball() -> tuple[np.ndarray, np.ndarray]:
    import trimesh

    made = trimesh.creation.icosphere(subdivisions=1, radius=0.02)
    return np.array(made.vertices), np.array(made.faces)


def _stl(vertices: np.ndarray, triangles: np.ndarray, count: int | None = None) -> bytes:
    kind = [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("flags", "<u2")]
    records = np.zeros(len(triangles), dtype=kind)
    records["corners"] = vertices[triangles]
    return bytes(80) + struct.pack("<I", len(records) if count is None else count) + records.tobytes()


def stl() -> Iterator[Variant]:
    rng = np.random.default_rng(1)
    v, t = _ball()
    yield from battered("STL", "surface", ".stl", _stl(v, t), rng)
    for count in (0, 1, len(t) - 1, len(t) + 1, 10**6, 2**31, 2**32 - 1):
        yield f"STL says {count} triangles", "surface", ".stl", _stl(v, t, count)
    for value in (np.nan, np.inf, -np.inf, 3e38, 1e-40):
        altered = v.copy()
        altered[5, 1] = value
        yield f"STL with {value}", "surface", ".stl", _stl(altered, t)
    yield "STL all at 3e38", "surface", ".stl", _stl(np.sign(v) * 3e38, t)
    yield "STL all tiny", "surface", ".stl", _stl(v * 1e-38, t)
    far = np.vstack([v, v + 1e9])
    yield "STL far apart", "surface", ".stl", _stl(far, np.vstack([t, t + len(v)]))
    pieces = 1100
    corner = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    facets = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    many = (corner[None] + 3 * rng.integers(200, size=(pieces, 1, 3))).reshape(-1, 3)
    yield (
        "STL of a thousand pieces",
        "surface",
        ".stl",
        _stl(many, (facets[None] + 4 * np.arange(pieces)[:, None, None]).reshape(-1, 3)),
    )
    lines = [
        "solid x",
        *(
            "facet normal 0 0 0\nouter loop\n"
            + "\n".join("vertex {} {} {}".format(*v[k]) for k in triangle)
            + "\nendloop\nendfacet"
            for triangle in t
        ),
        "endsolid x",
    ]
    text = "\n".join(lines).encode()
    yield from battered("text STL", "surface", ".stl", text, np.random.default_rng(2))
    yield "text STL, a vertex short", "surface", ".stl", text.replace(b"vertex", b"vortex", 1)
    yield "text STL, long number", "surface", ".stl", text.replace(b"vertex ", b"vertex " + b"9" * 10**6, 1)


def obj() -> Iterator[Variant]:
    v, t = _ball()
    points = "".join("v {} {} {}\n".format(*p) for p in v)
    faces = "".join("f {} {} {}\n".format(*(f + 1)) for f in t)
    good = (points + faces).encode()
    yield from battered("OBJ", "surface", ".obj", good, np.random.default_rng(3))
    for face in (
        "f 1 2 999999999",
        "f 0 1 2",
        "f -1 -2 -99999",
        "f 1 2 1e18",
        "f 1 2 99999999999999999999999",
    ):
        yield f"OBJ {face}", "surface", ".obj", good + face.encode() + b"\n"
    for face in ("f", "f 1", "f 1 2", "f a b c", "f 1/2/3/4/5 2 3", "f //// // /", "f 1.5 2 3", "f nan 1 2"):
        yield f"OBJ {face}", "surface", ".obj", good + face.encode() + b"\n"
    yield "OBJ of one great face", "surface", ".obj", good + b"f " + b" ".join([b"1 2 3"] * 5_000) + b"\n"
    for line in (
        "mtllib /dev/zero",
        "mtllib ../../../../etc/passwd",
        "usemtl none",
        "call /bin/true",
        "v 1",
        "v x y z",
    ):
        yield f"OBJ {line}", "surface", ".obj", line.encode() + b"\n" + good
    for number in ("nan", "inf", "1e999", "-1e308", "9" * 400):
        changed = points.replace("v ", f"v {number} 0 0 #", 1).encode() + faces.encode()
        yield f"OBJ with {number[:8]}", "surface", ".obj", changed
    yield "OBJ in one line", "surface", ".obj", good.replace(b"\n", b" ")
    yield "OBJ with noughts", "surface", ".obj", good.replace(b" ", b"\0")
    yield "OBJ of points", "surface", ".obj", points.encode()
    yield "OBJ of faces", "surface", ".obj", faces.encode()
    yield "OBJ for a body", "mesh", ".obj", good


def ply() -> Iterator[Variant]:
    v, t = _ball()
    header = (
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\n"
        "property float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.zeros(len(t), dtype=[("n", "u1"), ("v", "<i4", 3)])
    faces["n"], faces["v"] = 3, t
    body = v.astype("<f4").tobytes() + faces.tobytes()
    yield from battered(
        "PLY", "surface", ".ply", header.format(len(v), len(t)).encode() + body, np.random.default_rng(4)
    )
    for count in (-1, 0, 10**6, 2**31, 10**12, 10**30):
        yield f"PLY says {count} vertices", "surface", ".ply", header.format(count, len(t)).encode() + body
        yield f"PLY says {count} faces", "surface", ".ply", header.format(len(v), count).encode() + body
    text = header.replace("binary_little_endian", "ascii")
    yield "PLY says a million in text", "surface", ".ply", text.format(10**12, 10**12).encode() + b"1 2 3\n"


def msh() -> Iterator[Variant]:
    import tempfile

    import meshio

    from softprint.runtime.mesh import box_mesh

    mesh = box_mesh([0.0, 0.0, 0.0], [0.1, 0.1, 0.1], [2, 2, 2])
    written = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, options in (
            ("MSH 4.1", {"file_format": "gmsh", "binary": False}),
            ("binary MSH 4.1", {"file_format": "gmsh", "binary": True}),
            ("MSH 2.2", {"file_format": "gmsh22", "binary": False}),
        ):
            path = Path(folder) / "x.msh"
            meshio.write(path, meshio.Mesh(mesh.points, [("tetra", mesh.cells)]), **options)
            written[name] = path.read_bytes()
    for seed, (name, good) in enumerate(written.items()):
        yield from battered(name, "mesh", ".msh", good, np.random.default_rng(5 + seed))
    text = written["MSH 4.1"]
    for section, line in ((b"$Nodes\n", 1), (b"$Elements\n", 1), (b"$Nodes\n", 2), (b"$Elements\n", 2)):
        if section not in text:
            continue
        head, _, tail = text.partition(section)
        lines = tail.split(b"\n")
        for number in (b"1000000000000", b"-1", b"99999999999999999999", b"1e12", b"x"):
            words = lines[line - 1].split()
            for word in range(len(words)):
                changed = [*words[:word], number, *words[word + 1 :]]
                new = b"\n".join([*lines[: line - 1], b" ".join(changed), *lines[line:]])
                yield (
                    f"MSH {section.decode().strip()} line {line} word {word} = {number.decode()}",
                    "mesh",
                    ".msh",
                    head + section + new,
                )
    old = written["MSH 2.2"]
    for section in (b"$Nodes\n", b"$Elements\n"):
        head, _, tail = old.partition(section)
        for number in (b"1000000000000", b"-1", b"0"):
            yield (
                f"MSH 2.2 {section.decode().strip()} {number.decode()}",
                "mesh",
                ".msh",
                (head + section + number + b"\n" + tail.partition(b"\n")[2]),
            )
    yield "MSH of version 9", "mesh", ".msh", text.replace(b"4.1", b"9.9", 1)


def vtk() -> Iterator[Variant]:
    import tempfile

    from softprint.runtime.mesh import box_mesh, write_mesh

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.vtu"
        write_mesh(path, box_mesh([0.0, 0.0], [0.1, 0.1], [4, 4]))
        good = path.read_bytes()
    yield from battered("VTU", "mesh", ".vtu", good, np.random.default_rng(9))
    for count in (b"0", b"-5", b"1000000000000", b"x"):
        yield f"VTU {count.decode()} points", "mesh", ".vtu", _attribute(good, b"NumberOfPoints", count)
        yield f"VTU {count.decode()} cells", "mesh", ".vtu", _attribute(good, b"NumberOfCells", count)
    yield "VTU of another type", "mesh", ".vtu", good.replace(b"Int32", b"Float64")
    yield "VTU of small numbers", "mesh", ".vtu", good.replace(b"Int32", b"Int8")
    yield "VTU of PolyData", "mesh", ".vtu", good.replace(b"UnstructuredGrid", b"PolyData")
    yield "VTU that swells", "mesh", ".vtu", _swelling(good)
    entities = b"".join(b'<!ENTITY e%d "%s">' % (k + 1, b"&e%d;" % k * 20) for k in range(12))
    bomb = b'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY e0 "ha">' + entities + b"]><VTKFile>&e12;</VTKFile>"
    yield "VTU of entities", "mesh", ".vtu", bomb
    yield "VTU nested deeply", "mesh", ".vtu", b"<a>" * 20_000
    outside = (
        b'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]><VTKFile>&e;</VTKFile>'
    )
    yield "VTU that reads other files", "mesh", ".vtu", outside
    legacy = b"# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS %s float\n0 0 0 1 0 0 0 1 0\n"
    for count in (b"3", b"1000000000000", b"-3"):
        cells = b"CELLS 1 4\n3 0 1 2\nCELL_TYPES 1\n5\n"
        yield f"VTK says {count.decode()} points", "mesh", ".vtk", legacy % count + cells
    binary = legacy.replace(b"ASCII", b"BINARY")
    yield "VTK binary, too many", "mesh", ".vtk", binary % b"1000000000000"
    yield "no suffix", "mesh", "", good
    yield "unknown suffix", "mesh", ".xyzzy", good


def _attribute(good: bytes, name: bytes, value: bytes) -> bytes:
    head, _, tail = good.partition(name + b'="')
    return head + name + b'="' + value + tail[tail.index(b'"') :]


def _swelling(good: bytes) -> bytes:
    """The file with its first array replaced by a megabyte that unpacks to a gigabyte of zeros."""
    block = zlib.compress(bytes(64 << 20))
    header = struct.pack("<3I", 16, 64 << 20, 0) + struct.pack("<I", len(block)) * 16
    content = base64.b64encode(header) + base64.b64encode(block * 16)
    start = good.index(b">", good.index(b"<DataArray")) + 1
    return good[:start] + content + good[good.index(b"<", start) :]


def polygons() -> Iterator[Variant]:
    star = b"0 0\n0.02 0\n0.02 0.02\n0.01 0.01\n0 0.02\n"
    for name, content in {
        "cut": star[:7],
        "empty": b"",
        "of text": b"a shopping list\n",
        "of one column": b"1\n2\n3\n",
        "of three columns": b"1 2 3\n4 5 6\n",
        "ragged": b"0 0\n1\n1 1\n",
        "not a number": star + b"nan nan\n",
        "infinite": star + b"inf 0\n",
        "huge": star + b"1e308 -1e308\n",
        "binary": np.random.default_rng(10).bytes(1000),
        "of noughts": bytes(1000),
        "of one point": b"1 1\n" * 10,
        "crossing": b"0 0\n1 1\n1 0\n0 1\n",
        "of many corners": "".join(
            f"{np.cos(a)} {np.sin(a)}\n" for a in np.linspace(0, 2 * np.pi, 200_000, endpoint=False)
        ).encode(),
    }.items():
        yield f"polygon {name}", "polygon", ".txt", content


GEOMETRY: tuple[Callable[[], Iterator[Variant]], ...] = (stl, obj, ply, msh, vtk, polygons)
