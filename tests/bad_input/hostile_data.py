"""Hostile and broken files of our own kinds, made from good ones: HDF5 with and without checksums that fit, and
safetensors."""

from __future__ import annotations

import json
import shutil
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import numpy as np

from softprint.runtime.io.seal import seal
from tests.bad_input.altered import alter_tensors
from tests.bad_input.hostile_meshes import Variant, battered

# For each kind of file, a dataset that its reader reads completely, and a group.
_PLACES = {
    "body": ("mesh/points", "handles/points", "material"),
    "truth": ("samples/depth", "samples/reason", "mesh"),
    "motion": ("rows", "status", "energies"),
}


def _another_type(dtype: object) -> Callable[[h5py.File, str, str], None]:
    def change(file: h5py.File, name: str, group: str) -> None:
        shape = file[name].shape
        del file[name]
        file.create_dataset(name, shape, dtype)

    return change


def _another_shape(shape: tuple[int, ...], **options: object) -> Callable[[h5py.File, str, str], None]:
    def change(file: h5py.File, name: str, group: str) -> None:
        dtype = file[name].dtype
        del file[name]
        file.create_dataset(name, shape, dtype, **options)

    return change


def _values(value: float) -> Callable[[h5py.File, str, str], None]:
    def change(file: h5py.File, name: str, group: str) -> None:
        numbers = file[name].dtype.kind != "S"
        with np.errstate(invalid="ignore"):
            file[name][...] = (
                np.full(file[name].shape, value).astype(file[name].dtype) if numbers else b"\xff\xfe"
            )

    return change


def _link(link: object) -> Callable[[h5py.File, str, str], None]:
    def change(file: h5py.File, name: str, group: str) -> None:
        del file[name]
        file[name] = link

    return change


def _dead(file: h5py.File, name: str, group: str) -> None:
    del file[name]


def _circle(file: h5py.File, name: str, group: str) -> None:
    file[group]["within"] = file[group]


def _root_within(file: h5py.File, name: str, group: str) -> None:
    del file[name]
    file[name] = file["/"]


def _virtual(file: h5py.File, name: str, group: str) -> None:
    shape, dtype = file[name].shape, file[name].dtype
    del file[name]
    layout = h5py.VirtualLayout(shape, dtype)
    layout[...] = h5py.VirtualSource("elsewhere.h5", "x", shape, dtype)
    file.create_virtual_dataset(name, layout)


def _elsewhere(file: h5py.File, name: str, group: str) -> None:
    shape, dtype = file[name].shape, file[name].dtype
    del file[name]
    file.create_dataset(name, shape, dtype, external=[("/etc/passwd", 0, h5py.h5f.UNLIMITED)])


def _python_object(file: h5py.File, name: str, group: str) -> None:
    del file[name]
    file.create_dataset(name, data=["a", "b"], dtype=h5py.string_dtype())


def _attribute(value: object) -> Callable[[h5py.File, str, str], None]:
    def change(file: h5py.File, name: str, group: str) -> None:
        for key in list(file.attrs):
            if key not in ("softprint_kind", "softprint_version"):
                file.attrs[key] = value

    return change


def _deep(file: h5py.File, name: str, group: str) -> None:
    for _ in range(2000):
        file = file.create_group("g")


def _named_badly(file: h5py.File, name: str, group: str) -> None:
    file.move(group, "../../etc")


def _version(file: h5py.File, name: str, group: str) -> None:
    file.attrs["softprint_version"] = "soup"


CHANGES: dict[str, Callable[[h5py.File, str, str], None]] = {
    "is gone": _dead,
    "of text": _another_type("S8"),
    "of objects": _python_object,
    "of records": _another_type([("a", "f8"), ("b", "i4")]),
    "of references": _another_type(h5py.ref_dtype),
    "of lists": _another_type(h5py.vlen_dtype("f8")),
    "of complex numbers": _another_type("c16"),
    "of half floats": _another_type("f2"),
    "of terabytes": _another_shape((10**6, 10**6), chunks=(1000, 1000)),
    "that swells": _another_shape((2**31,), chunks=(2**20,), compression="gzip", fillvalue=0),
    "of no numbers": _another_shape((0, 3)),
    "of one number": _another_shape(()),
    "of many axes": _another_shape((1,) * 20),
    "of other length": _another_shape((7, 2)),
    "not numbers": _values(np.nan),
    "infinite": _values(np.inf),
    "negative": _values(-5),
    "huge": _values(1e18),
    "in another file": _link(h5py.ExternalLink("/etc/passwd", "/x")),
    "pointing to itself": _link(h5py.SoftLink("/mesh")),
    "dangling": _link(h5py.SoftLink("/nowhere/at/all")),
    "of another's making": _virtual,
    "stored elsewhere": _elsewhere,
    "in a circle": _circle,
    "that is all": _root_within,
    "below 2000 groups": _deep,
    "named badly": _named_badly,
    "attributes of soup": _attribute("soup"),
    "attributes of numbers": _attribute(np.arange(3.0)),
    "attributes without value": _attribute(h5py.Empty("f8")),
    "version of soup": _version,
}


_UNSEALED = ("is gone", "in a circle", "version of soup")  # reading each of these needs a separate process


def hdf5(kind: str, good: Path, scratch: Path, seed: int) -> Iterator[Variant]:
    """Variants of one of our HDF5 files: damaged with the old seal (a body), damaged and sealed again, and changed
    by HDF5."""
    rng = np.random.default_rng(seed)
    if kind == "body":  # once for all kinds: nothing more is read of an unsealed file
        yield from battered(kind, kind, ".h5", good.read_bytes(), rng)
    for name, _, suffix, content in battered(kind, kind, ".h5", good.read_bytes(), rng):
        scratch.write_bytes(content)
        seal(scratch)
        yield f"{name}, sealed", kind, suffix, scratch.read_bytes()
    for name, change in CHANGES.items():
        shutil.copy(good, scratch)
        with h5py.File(scratch, "r+") as file:
            change(file, _PLACES[kind][0], _PLACES[kind][2])
        if kind == "body" and name in _UNSEALED:
            yield f"{kind} {name}, not sealed", kind, ".h5", scratch.read_bytes()
        seal(scratch)
        yield f"{kind} {name}", kind, ".h5", scratch.read_bytes()
    for name in ("of text", "of other length", "huge", "not numbers"):
        shutil.copy(good, scratch)
        with h5py.File(scratch, "r+") as file:
            CHANGES[name](file, _PLACES[kind][1], _PLACES[kind][2])
        seal(scratch)
        yield f"{kind} {_PLACES[kind][1]} {name}", kind, ".h5", scratch.read_bytes()


def tensors(kind: str, good: Path, scratch: Path, seed: int) -> Iterator[Variant]:
    """Variants of one of our safetensors files: damaged; wrong headers; meaningless texts with valid checksums."""
    content = good.read_bytes()
    yield from battered(kind, kind, good.suffix, content, np.random.default_rng(seed))
    length = struct.unpack("<Q", content[:8])[0]
    header, rest = json.loads(content[8 : 8 + length]), content[8 + length :]
    for claimed in (0, 1, length - 1, length + 1, 2**31, 2**60, 2**64 - 1):
        yield f"{kind} header of {claimed} bytes", kind, good.suffix, struct.pack("<Q", claimed) + content[8:]
    first = next(name for name in header if name != "__metadata__")
    for key, values in {
        "data_offsets": ([0, 2**60], [-8, 8], [8, 0], [0], "ab", [0.5, 1.5], None, [2**70, 2**71]),
        "shape": ([2**40, 2**40], [-1], ["x"], None, 3, [[1]]),
        "dtype": ("F999", "pickle", 7, None),
    }.items():
        for value in values:
            changed = {**header, first: {**header[first], key: value}}
            yield f"{kind} {key} {value}", kind, good.suffix, _packed(json.dumps(changed).encode(), rest)
    for name, text in {
        "nested deeply": b"[" * 200_000,
        "a list": b"[1, 2]",
        "a number": b"1e999",
        "not JSON": b"{" * 10,
        "not text": b"\xff\xfe" * 50,
        "without texts": json.dumps({k: v for k, v in header.items() if k != "__metadata__"}).encode(),
        "texts of numbers": json.dumps({**header, "__metadata__": {"softprint_kind": 3}}).encode(),
        "texts in a list": json.dumps({**header, "__metadata__": [1]}).encode(),
        "twice": json.dumps(header).encode() + json.dumps(header).encode(),
    }.items():
        yield f"{kind} header {name}", kind, good.suffix, _packed(text, rest)
    for name, texts in {
        "header of soup": {"header": "soup", "history": "soup", "step": "soup"},
        "empty header": {"header": "{}", "history": "", "step": ""},
        "header nested deeply": {"header": "[" * 100_000, "history": "[" * 100_000},
        "header of a list": {"header": "[]", "history": "7"},
        "header of null": {"header": "null", "step": "null"},
        "version of soup": {"softprint_version": "soup"},
    }.items():
        shutil.copy(good, scratch)
        alter_tensors(scratch, texts)
        yield f"{kind} {name}", kind, good.suffix, scratch.read_bytes()


def _packed(header: bytes, rest: bytes) -> bytes:
    return struct.pack("<Q", len(header)) + header + rest
