"""How every Softprint file is written and opened: atomically, and with its kind checked.

Each file states its kind and version (attributes ``softprint_kind`` and ``softprint_version``) and its origin
(``provenance``). It is written under a temporary name in its own folder and renamed when complete, so a process killed
at any moment leaves either the old file or the new one.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import re
import secrets
import shutil
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.h5_contents import claims, refuse_tricks, unreadable_datasets
from softprint.runtime.io.seal import Damage, Unsealed, damage, is_verified, seal

if TYPE_CHECKING:
    import h5py

# Exceptions that h5py, or code that uses its results, raises on altered bytes.
_DAMAGE = (OSError, RuntimeError, ValueError, TypeError, LookupError, AttributeError, MemoryError)
_HDF5 = b"\x89HDF\r\n\x1a\n"  # how an HDF5 file begins
_MAKERS = {
    "body": "body",
    "truth": "generate",
    "motion": "simulate",
    "touch": "touch",
}  # kind of file -> verb
_PACKAGES = ("numpy", "scipy", "h5py", "libigl", "meshio", "torch", "fenics-dolfinx", "petsc4py", "mpi4py")


@contextmanager
def atomic_path(path: Path | str) -> Iterator[Path]:
    """Yield a temporary path beside ``path`` (same suffix); on success it is synced and renamed to ``path``.

    On any exception the temporary file is removed and ``path`` is left as it was; an OSError (no space, no
    permission) becomes a SoftprintError. Missing parent folders are created. Temporary files of killed processes are
    removed.
    """
    target = Path(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SoftprintError(
            f"cannot make the folder {target.parent} for {target.name}: {error.strerror}"
        ) from error
    if target.is_dir():
        raise SoftprintError(f"cannot write {target}: a folder of that name exists")
    temporary = temporary_beside(target)
    try:
        yield temporary
        _sync(temporary, os.O_RDWR)
        os.replace(temporary, target)
        _sync(target.parent, os.O_RDONLY)  # the rename itself must survive a power failure
    except OSError as error:
        ours = error.filename in (None, str(temporary), os.fspath(temporary))
        reason = (error.strerror if ours else None) or str(error)
        reason = reason.replace(temporary.name, target.name)  # the words of HDF5 contain the name that it was given
        raise SoftprintError(f"cannot write {target}: {reason}") from error
    finally:
        temporary.unlink(missing_ok=True)


def temporary_beside(target: Path) -> Path:
    """A path for a temporary file or folder beside the target, with its suffix. Removes those of killed processes."""
    _remove_left_overs(target)
    attempt = f"{_machine()}-{os.getpid()}-{secrets.token_hex(6)}"
    return target.with_name(f".{target.stem}.{attempt}{target.suffix}")


def _machine() -> str:
    return hashlib.sha256(platform.node().encode()).hexdigest()[:8]


def _remove_left_overs(target: Path) -> None:
    """Remove temporary files of ended processes of this machine; those of other machines may still run."""
    ours = re.compile(
        rf"\.{re.escape(target.stem)}\.{_machine()}-(\d+)-[0-9a-f]{{12}}{re.escape(target.suffix)}"
    )
    for path in target.parent.iterdir():
        match = ours.fullmatch(path.name)
        if match and not _is_alive(int(match[1])):
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # alive, owned by another user
        return True
    return True


def _sync(path: Path, flags: int) -> None:
    handle = os.open(path, flags)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def provenance() -> dict[str, str]:
    """Versions of the installed software, for the metadata of a file. Imports nothing heavy."""
    versions = {"python": platform.python_version(), "platform": platform.platform()}
    for package in _PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            # Debian's DOLFINx and PETSc have no distribution metadata of that name; use the module's if it is loaded.
            module = sys.modules.get({"fenics-dolfinx": "dolfinx"}.get(package, package))
            if module is not None and hasattr(module, "__version__"):
                versions[package] = str(module.__version__)
    return versions


def file_hash(path: Path) -> str:
    """SHA-256 of a file's bytes. Raises SoftprintError if it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise SoftprintError(f"cannot read {path}: {error.strerror}") from error


def sources_hash(folder: Path) -> str:
    """SHA-256 of the Python sources in a folder and its subfolders: results of other sources may differ."""
    sources = sorted(folder.rglob("*.py"))
    return content_hash({str(path.relative_to(folder)): file_hash(path) for path in sources})


def content_hash(content: Mapping[str, object]) -> str:
    """SHA-256 (hex) of named arrays, numbers and strings: names, types, shapes, bytes; independent of the order."""
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
    """Write an HDF5 file, atomically, with its kind, version and provenance in the attributes, and a seal."""
    from softprint.runtime.io.h5_writing import H5Writer

    with atomic_path(path) as temporary:
        with H5Writer(temporary) as file:
            file.attrs["softprint_kind"] = fixed_text(kind)
            file.attrs["softprint_version"] = version
            file.attrs["provenance"] = fixed_text(json.dumps(provenance(), sort_keys=True))
            yield file
        seal(temporary)


def fixed_text(text: str) -> NDArray[np.bytes_]:
    """Text of fixed length for an attribute of an HDF5 file: h5py stores a str in a part of the file without checksums,
    where damage can crash HDF5."""
    data = text.encode()
    return np.array(data, dtype=f"S{max(1, len(data))}")


def read_text(attributes: h5py.AttributeManager, name: str) -> str:
    """The text of an attribute, of fixed length or not."""
    value = attributes[name]
    return value.decode() if isinstance(value, bytes) else str(value)


@contextmanager
def open_softprint_h5(path: Path | str, kind: str, version: int) -> Iterator[h5py.File]:
    """Open an HDF5 file for reading after checking that every byte is as written (see :mod:`runtime.io.seal`), and that
    it is a Softprint file of this kind and version.

    Use as a context manager. Inside the block, a missing or unreadable dataset or attribute raises a SoftprintError
    that names the file.
    """
    import h5py

    source = Path(path)
    if not source.is_file():
        maker = f"; `softprint {_MAKERS[kind]}` makes one" if kind in _MAKERS else ""
        raise SoftprintError(f"{source}: there is no such {kind} file{maker}")
    try:
        known = is_verified(source)
        broken = damage(source)
    except Unsealed:
        raise _unsealed(source, kind, version) from None
    except OSError as error:
        raise SoftprintError(f"{source}: cannot be read: {error.strerror}") from error
    if broken:
        raise _altered(source, kind, broken)
    try:
        with h5py.File(source, "r") as file:
            if not known:
                refuse_tricks(file, source)
            _check_kind(file, source, kind, version)
            yield file
    except KeyError as error:
        raise SoftprintError(
            f"{source}: the {kind} file is incomplete ({error.args[0]}): make it again"
        ) from error
    except _DAMAGE as error:
        raise SoftprintError(f"{source}: the {kind} file is damaged ({error}): make it again") from error


def _altered(source: Path, kind: str, broken: list[Damage]) -> SoftprintError:
    places = " and ".join(map(str, broken[:3])) + (" and more" if len(broken) > 3 else "")
    where = ", ".join(unreadable_datasets(source)[:3]) or "between its datasets"
    return SoftprintError(
        f"{source}: the {kind} file is damaged: bytes within {places} were altered ({where}): make it again"
    )


def _unsealed(source: Path, kind: str, version: int) -> SoftprintError:
    """The reason why a file does not end in a seal: another file, another version, or truncated."""
    with source.open("rb") as file:
        found = claims(source) if file.read(len(_HDF5)) == _HDF5 else None
    if found is None:
        return SoftprintError(
            f"{source}: not a readable {kind} file (truncated, damaged, or not HDF5): make it again"
        )
    return _mismatch(source, kind, version, *found) or SoftprintError(
        f"{source}: the {kind} file was cut short, damaged at its end, or changed by another program (its "
        "checksums are gone): make it again"
    )


def _check_kind(file: h5py.File, source: Path, kind: str, version: int) -> None:
    found = read_text(file.attrs, "softprint_kind") if "softprint_kind" in file.attrs else None
    trouble = _mismatch(source, kind, version, found, int(file.attrs.get("softprint_version", -1)))
    if trouble is not None:
        raise trouble


def _mismatch(
    source: Path, kind: str, version: int, found_kind: str | None, found_version: int
) -> SoftprintError | None:
    if found_kind is None:
        return SoftprintError(
            f"{source}: an HDF5 file, but not one of Softprint's; a {kind} file was expected"
        )
    if found_kind != kind:
        return SoftprintError(f"{source}: this is a {found_kind} file; a {kind} file was expected")
    if found_version != version:
        return SoftprintError(
            f"{source}: {kind} file of version {found_version}, but this program reads version {version}: "
            "make the file again with this program"
        )
    return None
