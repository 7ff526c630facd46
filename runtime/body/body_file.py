"""The body file (HDF5): a complete reduced body with the hash of its content. SI units throughout.

    mesh/points (n_nodes, dim) m, mesh/cells     handles/points, handles/frames/<number>/{nodes, pivot} @name
    basis (n_nodes, n_rows) @subspace @hold      material/{young Pa, poisson} @model, density kg/m^dim
    node_mass kg, reduced_mass kg                cubature/{cells, weights m^dim} @energy_error @force_error
    surface/{nodes, areas m^(dim-1)}

Attributes: softprint_kind "body", softprint_version, provenance, name, content_hash (of what defines the body: see
:attr:`ReducedBody.content_hash`), file_hash (of all of the above), recipe (what it was built from).
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import HOLDS, SUBSPACES, ReducedBody
from softprint.runtime.body.cubature import Cubature
from softprint.runtime.body.handles import FrameHandle, Handles
from softprint.runtime.body.surface_samples import SurfaceSamples
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import (
    content_hash,
    create_softprint_h5,
    fixed_text,
    open_softprint_h5,
    read_text,
)
from softprint.runtime.mesh import Mesh

KIND = "body"
VERSION = 2


def save_body(path: Path | str, body: ReducedBody, recipe: str = "") -> None:
    """Write the body file, atomically. recipe: what it was built from (`runtime.body.body_recipe`)."""
    arrays = _arrays(body)
    with create_softprint_h5(path, KIND, VERSION) as file:
        for name, array in arrays.items():
            large = array.size > 1000
            compression = "gzip" if large else None
            file.create_dataset(
                name, data=array, compression=compression, shuffle=large, fletcher32=array.size > 0
            )
        for index, frame in enumerate(body.handles.frames):
            file[f"handles/frames/{index}"].attrs["name"] = fixed_text(frame.name)
        file["basis"].attrs["subspace"] = fixed_text(body.subspace)
        file["basis"].attrs["hold"] = fixed_text(body.hold)
        file["material"].attrs["model"] = fixed_text(body.material.model)
        file["cubature"].attrs["energy_error"] = body.cubature.energy_error
        file["cubature"].attrs["force_error"] = body.cubature.force_error
        file.attrs["name"] = fixed_text(body.name)
        file.attrs["recipe"] = fixed_text(recipe)
        file.attrs["content_hash"] = fixed_text(body.content_hash)
        whole = content_hash({**arrays, "content_hash": body.content_hash})
        file.attrs["file_hash"] = fixed_text(whole)


def read_recipe(path: Path | str) -> str:
    """The recipe that was saved with a body; "" if there was none."""
    with open_softprint_h5(path, KIND, VERSION) as file:
        return read_text(file.attrs, "recipe")


def load_body(path: Path | str) -> ReducedBody:
    """Read and check a body file.

    Raises SoftprintError if it is missing, not a body file, truncated, altered or incomplete.
    """
    with open_softprint_h5(path, KIND, VERSION) as file:
        handles = Handles(
            int(file["mesh/points"].shape[1]),
            _indices(file, "handles/points"),
            tuple(
                FrameHandle(
                    read_text(group.attrs, "name"), _indices(group, "nodes"), _numbers(group, "pivot")
                )
                for group in _frame_groups(file)
            ),
        )
        body = ReducedBody(
            mesh=Mesh(_numbers(file, "mesh/points"), _indices(file, "mesh/cells")),
            handles=handles,
            basis=_numbers(file, "basis"),
            material=make_material(
                read_text(file["material"].attrs, "model"),
                _numbers(file, "material/young"),
                _numbers(file, "material/poisson"),
            ),
            density=_numbers(file, "density"),
            node_mass=_numbers(file, "node_mass"),
            reduced_mass=_numbers(file, "reduced_mass"),
            cubature=Cubature(
                _indices(file, "cubature/cells"),
                _numbers(file, "cubature/weights"),
                float(file["cubature"].attrs["energy_error"]),
                float(file["cubature"].attrs["force_error"]),
            ),
            surface=SurfaceSamples(_indices(file, "surface/nodes"), _numbers(file, "surface/areas")),
            name=read_text(file.attrs, "name"),
            subspace=_choice(file, "subspace", SUBSPACES, path),
            hold=_choice(file, "hold", HOLDS, path),
        )
        recorded, file_hash = read_text(file.attrs, "content_hash"), read_text(file.attrs, "file_hash")
    if (
        body.content_hash != recorded
        or content_hash({**_arrays(body), "content_hash": recorded}) != file_hash
    ):
        raise SoftprintError(
            f"{path}: the body file was altered or damaged (its hash does not match): make it again"
        )
    return body


def _choice(file: h5py.File, name: str, known: Iterable[str], path: Path | str) -> str:
    """An attribute of the basis. Bodies without it are of a time when there was only the first of those known."""
    attributes, choices = file["basis"].attrs, list(known)
    found = read_text(attributes, name) if name in attributes else choices[0]
    if found not in choices:
        raise SoftprintError(f"{path}: {name} is {found!r}; known are {', '.join(choices)}: make it again")
    return found


def _frame_groups(file: h5py.File) -> list[h5py.Group]:
    """The frames in the order of their numbers; a body without frames has no frames group."""
    frames = file["handles"].get("frames", {})
    return [frames[str(index)] for index in range(len(frames))]


def _arrays(body: ReducedBody) -> dict[str, NDArray[Any]]:
    """Every array of the body under its name in the file."""
    arrays: dict[str, NDArray[Any]] = {
        "mesh/points": body.mesh.points,
        "mesh/cells": body.mesh.cells,
        "handles/points": body.handles.points,
        "basis": body.basis,
        "material/young": body.material.young,
        "material/poisson": body.material.poisson,
        "density": body.density,
        "node_mass": body.node_mass,
        "reduced_mass": body.reduced_mass,
        "cubature/cells": body.cubature.cells,
        "cubature/weights": body.cubature.weights,
        "surface/nodes": body.surface.nodes,
        "surface/areas": body.surface.areas,
    }
    for index, frame in enumerate(body.handles.frames):
        arrays[f"handles/frames/{index}/nodes"] = frame.nodes
        arrays[f"handles/frames/{index}/pivot"] = frame.pivot
    return arrays


def _numbers(group: h5py.Group, name: str) -> Array:
    return np.asarray(group[name][()], dtype=np.float64)


def _indices(group: h5py.Group, name: str) -> IntArray:
    return np.asarray(group[name][()], dtype=np.int64)
