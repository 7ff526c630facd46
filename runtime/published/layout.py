"""The HDF5 layout of the data published with Romero et al. 2021 and 2022 (jelly and star).

`meshes.h5` has a group for each object, with its name:

    W (n_nodes, n_rows)     linear basis: of the body BGBC, of the collider rigid (n_rows = dim + 1)
    q_ref (n_rows, dim)     the body's transformations at rest;     z_ref (dim+1, dim) the collider's
    tris (n, dim) or (n, dim+1), tets (n, dim+1)

`dataset.h5` (2021 also `interaction.h5`, a recorded session) has one row for each sample:

    q (n_samples, n_rows, dim)     handle transformations
    z (n_samples, dim+1, dim)      transformation of the collider
    x (n_samples, n_nodes, dim)    simulated positions of the nodes

What is *documented*, in the tables and the example code of the two repositories
(crisrom002/hsd-learning-contact-corrections, crisrom002/contact-centric-deformation-learning): names and
shapes above; that positions of the collider are ``W z``; that `q` and `z` are unmodified inputs of a traced network;
that `tris` of 2021 are triangles of the plane, (n, dim+1), while the table of 2022 has `tris` (n, dim) beside `tets`
(n, dim+1).

What the *code of the sequel* (crisrom002/collider-descriptors-deformation-learning, same authors) shows: the first
dim rows of a transformation are R^T and the last is the translation, so that a point of the collider is at z_local R^T
+ t; in the handle rows, frames (dim+1 rows each) come first, then points. This writer uses the same order.

What is *assumed*: that numbers are float32, which this writer writes and the network expects, and that the rows of a
frame are adjacent. Nothing else: a reader takes the rest positions from W q_ref and W z_ref and the pose of the
collider from the motion of its points, so the order of rows, a frame's origin and the order of handles are arbitrary.
*Not stated* anywhere is the unit of length; a reader takes it as an input.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import atomic_path
from softprint.runtime.io.h5_writing import H5Writer

BODY_REFERENCE, COLLIDER_REFERENCE = "q_ref", "z_ref"
_DAMAGE = (OSError, RuntimeError, ValueError, TypeError, LookupError, AttributeError, MemoryError)
_MOST_COMPRESSED = 1100  # gzip compresses by at most this factor; a larger claim is damage


@dataclass(frozen=True, eq=False)
class PublishedObject:
    """One group of `meshes.h5`. basis: W; reference: q_ref or z_ref; simplices: the arrays `tris` and `tets`, if
    present, by name."""

    name: str
    basis: Array
    reference: Array
    simplices: dict[str, IntArray]

    @property
    def dim(self) -> int:
        return int(self.reference.shape[1])

    @property
    def rest(self) -> Array:
        """(n_nodes, dim) rest positions, in the file's unit."""
        return self.basis @ self.reference

    def simplices_of(self, corners: int) -> IntArray | None:
        """The array of simplices with this number of corners, `tets` before `tris`; None if there is none."""
        for name in ("tets", "tris"):
            if name in self.simplices and self.simplices[name].shape[1] == corners:
                return self.simplices[name]
        return None


@dataclass(frozen=True, eq=False)
class PublishedMeshes:
    """The body and the collider of a `meshes.h5`."""

    body: PublishedObject
    collider: PublishedObject


def read_meshes(path: Path) -> PublishedMeshes:
    """Read `meshes.h5`. Raises SoftprintError if it is missing, damaged, or does not have one body and one collider."""
    with open_published(path) as file:
        groups = {name: group for name, group in file.items() if isinstance(group, h5py.Group)}
        return PublishedMeshes(
            _object(path, groups, BODY_REFERENCE, "body"),
            _object(path, groups, COLLIDER_REFERENCE, "collider"),
        )


def _object(path: Path, groups: dict[str, h5py.Group], reference: str, what: str) -> PublishedObject:
    found = [name for name, group in groups.items() if reference in group and "W" in group]
    if len(found) != 1:
        some = ", ".join(found) if found else "none"
        raise SoftprintError(
            f"{path}: a {what} is a group with W and {reference}; there must be exactly one, found: {some}"
        )
    group = groups[found[0]]
    basis, start = numbers_of(group, "W"), numbers_of(group, reference)
    if basis.ndim != 2 or start.ndim != 2 or basis.shape[1] != len(start) or start.shape[1] not in (2, 3):
        raise SoftprintError(
            f"{path}: {found[0]}/W {basis.shape} and {found[0]}/{reference} {start.shape} do not fit together: "
            "they are (nodes, rows) and (rows, dim)"
        )
    simplices = {
        name: np.asarray(_checked_dataset(group, name), dtype=np.int64)
        for name in ("tris", "tets")
        if name in group
    }
    for name, array in simplices.items():
        if array.ndim != 2 or (array.size and (array.min() < 0 or array.max() >= len(basis))):
            raise SoftprintError(
                f"{path}: {found[0]}/{name} has nodes that do not exist: they are numbered from 0"
            )
    return PublishedObject(found[0], basis, start, simplices)


@dataclass(frozen=True, eq=False)
class PublishedData:
    """The samples of an open `dataset.h5`: q (n, n_rows, dim) and z (n, dim+1, dim) in memory, x on disk."""

    q: Array
    z: Array
    _x: h5py.Dataset

    def __len__(self) -> int:
        return len(self.q)

    def positions(self, samples: slice) -> Array:
        """(m, n_nodes, dim) of consecutive samples, in the file's unit."""
        return np.asarray(self._x[samples], dtype=np.float64)


@contextmanager
def open_dataset(path: Path, meshes: PublishedMeshes) -> Iterator[PublishedData]:
    """Open `dataset.h5`; SoftprintError if it is missing, damaged, or does not match these meshes."""
    with open_published(path) as file:
        data = PublishedData(numbers_of(file, "q"), numbers_of(file, "z"), file["x"])
        n, (nodes, rows), dim = len(data), meshes.body.basis.shape, meshes.body.dim
        wanted = {"q": (n, rows, dim), "z": (n, dim + 1, dim), "x": (n, nodes, dim)}
        for name, shape in wanted.items():
            if file[name].shape != shape:
                raise SoftprintError(
                    f"{path}: {name} has the shape {file[name].shape}, but its meshes need {shape}"
                )
        if n == 0:
            raise SoftprintError(f"{path}: has no samples")
        yield data


def write_meshes(path: Path, meshes: PublishedMeshes, notes: dict[str, Any]) -> None:
    """Write `meshes.h5`, atomically. notes: attributes of the file, which other readers ignore."""
    with _create(path) as file:
        for item, reference in ((meshes.body, BODY_REFERENCE), (meshes.collider, COLLIDER_REFERENCE)):
            group = file.create_group(item.name)
            arrays = {"W": item.basis.astype(np.float32), reference: item.reference.astype(np.float32)}
            arrays |= {name: array.astype(np.int32) for name, array in item.simplices.items()}
            for name, array in arrays.items():
                group.create_dataset(name, data=array, fletcher32=True)
        file.attrs.update(notes)


class DatasetWriter:
    """Takes the samples of a `dataset.h5` one by one."""

    def __init__(self, file: h5py.File, n_samples: int, n_nodes: int, n_rows: int, dim: int) -> None:
        self._arrays: dict[str, h5py.Dataset] = {
            name: file.create_dataset(
                name, (n_samples, size, dim), "f4", chunks=(1, size, dim), fletcher32=True
            )
            for name, size in (("q", n_rows), ("z", dim + 1), ("x", n_nodes))
        }
        self._next = 0

    def append(self, q: Array, z: Array, x: Array) -> None:
        """One sample: q (n_rows, dim), z (dim+1, dim), x (n_nodes, dim)."""
        for name, values in (("q", q), ("z", z), ("x", x)):
            self._arrays[name][self._next] = values
        self._next += 1


@contextmanager
def write_dataset(
    path: Path, n_samples: int, sizes: Sequence[int], notes: dict[str, Any]
) -> Iterator[DatasetWriter]:
    """Write `dataset.h5` with n_samples samples, atomically; sizes: n_nodes, n_rows, dim."""
    with _create(path) as file:
        yield DatasetWriter(file, n_samples, *sizes)
        file.attrs.update(notes)


def has_meshes(path: Path) -> bool:
    """Whether an HDF5 file has a group with a basis W."""
    with open_published(path) as file:
        return any(isinstance(group, h5py.Group) and "W" in group for group in file.values())


@contextmanager
def _create(path: Path) -> Iterator[h5py.File]:
    """A file in the format of HDF5 1.10, with its checksums."""
    with atomic_path(path) as temporary, H5Writer(temporary) as file:
        yield file


@contextmanager
def open_published(path: Path) -> Iterator[h5py.File]:
    """Open either file for reading; missing or damaged data inside the block raise a SoftprintError."""
    if not path.is_file():
        raise SoftprintError(f"{path}: there is no such file")
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise SoftprintError(
            f"{path}: not a readable HDF5 file (truncated, damaged, or another format)"
        ) from error
    with file:
        try:
            yield file
        except _DAMAGE as error:
            raise SoftprintError(f"{path}: not in the published layout, or damaged ({error})") from error


def numbers_of(group: h5py.Group, name: str) -> NDArray[np.float64]:
    """A dataset of an open file as float64; SoftprintError if it is not finite."""
    array = np.asarray(_checked_dataset(group, name), dtype=np.float64)
    if not np.isfinite(array).all():
        raise SoftprintError(f"{group.file.filename}: {group.name}/{name} has numbers that are not finite")
    return array


def _checked_dataset(group: h5py.Group, name: str) -> NDArray[Any]:
    """A dataset; SoftprintError if it claims more numbers than its file can contain."""
    dataset, path = group[name], Path(group.file.filename)
    if dataset.size * dataset.dtype.itemsize > _MOST_COMPRESSED * path.stat().st_size:
        raise SoftprintError(
            f"{path}: {name} claims the shape {dataset.shape}, more than the file can contain"
        )
    return np.asarray(dataset[()])
