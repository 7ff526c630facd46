"""Hostile and broken files that only `softprint new` reads: scenes (GLB), OFF surfaces, drawings (SVG, DXF)."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator

import numpy as np

from tests.bad_input.hostile_meshes import Variant, _ball, battered


def glb() -> Iterator[Variant]:
    import trimesh

    v, t = _ball()
    good = bytes(trimesh.Trimesh(v, t, process=False).export(file_type="glb"))
    yield from battered("GLB", "solid", ".glb", good, np.random.default_rng(21))
    text = good[20 : 20 + struct.unpack("<I", good[12:16])[0]]
    for old, new in (
        (b'"count":80', b'"count":99999999999'),
        (b'"bufferView":0', b'"bufferView":777'),
        (b'"byteLength":', b'"uri":"/etc/passwd","byteLength":'),
        (b'"mesh":0', b'"mesh":-5'),
        (b'"asset"', b'"images":[{"uri":"/dev/zero"}],"asset"'),
    ):
        changed = text.replace(old, new, 1)
        changed += b" " * (-len(changed) % 4)
        chunk = struct.pack("<I", len(changed)) + b"JSON" + changed
        rest = good[20 + len(text) :]
        head = b"glTF" + struct.pack("<II", 2, 12 + len(chunk) + len(rest))
        yield f"GLB with {new.decode()}", "solid", ".glb", head + chunk + rest


def off() -> Iterator[Variant]:
    v, t = _ball()
    lines = [
        "OFF",
        f"{len(v)} {len(t)} 0",
        *("{} {} {}".format(*p) for p in v),
        *("3 {} {} {}".format(*f) for f in t),
    ]
    good = "\n".join(lines).encode()
    yield from battered("OFF", "solid", ".off", good, np.random.default_rng(22))
    for counts in ("999999999999 80 0", "42 999999999999 0", "-1 -1 0", "0 0 0", "x y z"):
        yield f"OFF says {counts}", "solid", ".off", good.replace(b"42 80 0", counts.encode(), 1)


def svg() -> Iterator[Variant]:
    head = b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 80">'
    path = b'<path d="M0 70 C 0 -20 90 -20 90 70 Z"/><circle cx="45" cy="45" r="8"/>'
    yield from battered("SVG", "outline", ".svg", head + path + b"</svg>", np.random.default_rng(23))
    for name, body in {
        "of letters": b'<path d="M0 0 Lxy 10 Z"/>',
        "of nan": b'<path d="M0 0 L nan 10 L 5 5 Z"/>',
        "of huge numbers": b'<path d="M0 0 L 1e308 0 L 1e308 1e308 L -1e308 5 Z"/>',
        "of many corners": b'<path d="M0 0 ' + b"l 1 0 l 0 1 " * 20_000 + b'Z"/>',
        "crossing": b'<path d="M0 0 L10 10 L10 0 L0 10 Z"/>',
        "of text": b"<text>hello</text>",
        "of a picture": b'<image href="/etc/passwd" width="5" height="5"/>',
        "that uses itself": b'<g id="a"><use href="#a"/></g>',
        "flattened": b'<g transform="scale(0)"><circle r="5"/></g>',
        "deep": b"<g>" * 3000 + path + b"</g>" * 3000,
    }.items():
        yield f"SVG {name}", "outline", ".svg", head + body + b"</svg>"
    entities = b"".join(b'<!ENTITY e%d "%s">' % (k + 1, b"&e%d;" % k * 20) for k in range(12))
    yield "SVG bomb", "outline", ".svg", b'<!DOCTYPE x [<!ENTITY e0 "ha">' + entities + b"]><svg>&e12;</svg>"
    yield (
        "SVG that reads other files",
        "outline",
        ".svg",
        (b'<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]><svg>&e;</svg>'),
    )


def dxf() -> Iterator[Variant]:
    from trimesh.path.creation import rectangle

    good = rectangle([[0.0, 0.0], [60.0, 40.0]]).export(file_type="dxf")
    good = good if isinstance(good, bytes) else good.encode()
    yield from battered("DXF", "outline", ".dxf", good, np.random.default_rng(24))
    yield "DXF of numbers alone", "outline", ".dxf", b"0\n" * 5000
    yield "DXF without an end", "outline", ".dxf", good.replace(b"ENDSEC", b"SECTION")


DRAWINGS: tuple[Callable[[], Iterator[Variant]], ...] = (glb, off, svg, dxf)
