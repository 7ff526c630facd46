"""How every Softprint file is written and opened: whole or not at all, and never mistaken for another.

Each file says what it is (attributes ``softprint_kind`` and ``softprint_version``) and where it came from
(``provenance``). It is written under a temporary name in its own folder and renamed when whole, so a process
killed at any moment leaves either the old file or the new one.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import secrets
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from runtime.errors import SoftprintError

if TYPE_CHECKING:
    import h5py

_PACKAGES = ("numpy", "scipy", "h5py", "libigl", "meshio", "torch", "fenics-dolfinx", "petsc4py", "mpi4py")


@contextmanager
def atomic_path(path: Path | str) -> Iterator[Path]:
    """Yield a temporary path beside ``path`` (same suffix); on success it is synced and renamed to ``path``.

    On any exception the temporary file is removed and ``path`` is left as it was. Missing parent folders
    are made.
    """
    target = Path(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SoftprintError(
            f"cannot make the folder {target.parent} for {target.name}: {error.strerror}"
        ) from error
    if target.is_dir():
        raise SoftprintError(f"cannot write {target}: a folder of that name is in the way")
    temporary = target.with_name(f".{target.stem}.{secrets.token_hex(6)}{target.suffix}")
    try:
        yield temporary
        _sync(temporary, os.O_RDWR)
        os.replace(temporary, target)
        _sync(target.parent, os.O_RDONLY)  # the rename itself must survive a power cut
    finally:
        temporary.unlink(missing_ok=True)


def _sync(path: Path, flags: int) -> None:
    handle = os.open(path, flags)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def provenance() -> dict[str, str]:
    """Versions of the software at hand, for the metadata of a file. Imports nothing heavy."""
    versions = {"python": platform.python_version(), "platform": platform.platform()}
    for package in _PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            # Debian's DOLFINx and PETSc carry no distribution metadata of that name; ask the module if it
            # is loaded.
            module = sys.modules.get({"fenics-dolfinx": "dolfinx"}.get(package, package))
            if module is not None and hasattr(module, "__version__"):
                versions[package] = str(module.__version__)
    return versions


def content_hash(content: Mapping[str, object]) -> str:
    """SHA-256 (hex) of named arrays, numbers and strings: names, types, shapes, bytes; in any order."""
    digest = hashlib.sha256()
    for name in sorted(content):
        value = content[name]
        if isinstance(value, str):
            kind, data = "str", value.encode()
        else:
            array = np.asarray(value)
            array = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
            kind, data = f"{array.dtype.str}{array.shape}", array.tobytes()
        header = f"{len(name)}:{name}|{len(kind)}:{kind}|{len(data)}:"
        digest.update(header.encode())
        digest.update(data)
    return digest.hexdigest()


@contextmanager
def create_softprint_h5(path: Path | str, kind: str, version: int) -> Iterator[h5py.File]:
    """Write a whole HDF5 file, atomically, with its kind, version and provenance in the attributes."""
    import h5py

    with atomic_path(path) as temporary, h5py.File(temporary, "w") as file:
        file.attrs["softprint_kind"] = kind
        file.attrs["softprint_version"] = version
        file.attrs["provenance"] = json.dumps(provenance(), sort_keys=True)
        yield file


@contextmanager
def open_softprint_h5(path: Path | str, kind: str, version: int) -> Iterator[h5py.File]:
    """Open an HDF5 file for reading after checking that it is whole, ours, of this kind and of this version.

    Use as a context manager. A dataset or attribute that turns out to be missing or unreadable inside the
    block becomes a SoftprintError that names the file.
    """
    import h5py

    source = Path(path)
    if not source.is_file():
        raise SoftprintError(f"{source}: there is no such {kind} file")
    try:
        file = h5py.File(source, "r")
    except OSError as error:
        raise SoftprintError(
            f"{source}: not a readable {kind} file (truncated, damaged, or not HDF5): make it again"
        ) from error
    with file:
        _check_kind(file, source, kind, version)
        try:
            yield file
        except KeyError as error:
            raise SoftprintError(
                f"{source}: the {kind} file is incomplete ({error.args[0]}): make it again"
            ) from error
        except OSError as error:
            raise SoftprintError(f"{source}: the {kind} file is damaged ({error}): make it again") from error


def _check_kind(file: h5py.File, source: Path, kind: str, version: int) -> None:
    found_kind = file.attrs.get("softprint_kind")
    if found_kind is None:
        raise SoftprintError(
            f"{source}: an HDF5 file, but not one of Softprint's; a {kind} file was expected"
        )
    if found_kind != kind:
        raise SoftprintError(f"{source}: this is a {found_kind} file; a {kind} file was expected")
    found_version = int(file.attrs.get("softprint_version", -1))
    if found_version != version:
        raise SoftprintError(
            f"{source}: {kind} file of version {found_version}, but this program reads version {version}: "
            "make the file again with this program"
        )
