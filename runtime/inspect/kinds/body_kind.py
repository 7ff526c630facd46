"""A body file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.appearance import handles_scene
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.body_file import KIND as BODY
from softprint.runtime.body.body_file import VERSION, load_body
from softprint.runtime.drawing.scene import Scene
from softprint.runtime.inspect.file_head import FileHead
from softprint.runtime.inspect.kind import Kind, Part
from softprint.runtime.inspect.mesh_quality import mesh_facts
from softprint.runtime.inspect.summary import Summary, byte_size, versions
from softprint.runtime.io.files import open_softprint_h5, read_text


def recognise(head: FileHead) -> bool:
    return head.h5 is not None and head.kind == BODY


def summarise(path: Path, part: Part) -> Summary:
    """Reads the whole file, so that damage is found."""
    body = load_body(path)
    with open_softprint_h5(path, BODY, VERSION) as file:
        provenance, recipe = json.loads(file.attrs["provenance"]), read_text(file.attrs, "recipe")
    mass = float(body.node_mass.sum())
    sections = {
        "body": {
            "name": body.name,
            "handles": _handles(body),
            "rows, degrees of freedom": [body.n_rows, body.n_dofs],
            "mass [kg]": mass,
            "contact points": len(body.surface.nodes),
            "memory when loaded": byte_size(_memory(body)),
        },
        "mesh": mesh_facts(body.mesh),
        "material": {
            "model": body.material.model,
            "Young's modulus [Pa]": _range(body.material.young),
            "Poisson's ratio": _range(body.material.poisson),
            f"density [kg/m^{body.dim}]": _range(body.density),
        },
        "subspace": {
            "sum of weights off 1": float(np.abs(body.basis @ body.handles.affine_part - 1.0).max()),
            "rest shape off U q [m]": float(
                np.abs(body.reduced_positions(body.rest_rows) - body.mesh.points).max()
            ),
            "lowest and highest weight": [float(body.basis.min()), float(body.basis.max())],
            "cubature cells": len(body.cubature.cells),
            "cubature error": {"energy": body.cubature.energy_error, "force": body.cubature.force_error},
        },
        "hashes": {"content": body.content_hash, "recipe": recipe or "none"},
        "made with": versions(provenance),
    }
    return Summary(path, "a body", sections)


def _handles(body: ReducedBody) -> dict[str, Any]:
    frames = {f"frame {frame.name!r} of nodes": len(frame.nodes) for frame in body.handles.frames}
    return {"points": body.handles.n_points, **frames}


def _range(values: Array) -> float | list[float]:
    lowest, highest = float(np.min(values)), float(np.max(values))
    return lowest if lowest == highest else [lowest, highest]


def _memory(body: ReducedBody) -> int:
    arrays = (
        *(body.mesh.points, body.mesh.cells, body.basis, body.density, body.node_mass, body.reduced_mass),
        *(body.material.young, body.material.poisson, body.cubature.cells, body.cubature.weights),
        *(body.surface.nodes, body.surface.areas),
    )
    return sum(np.asarray(array).nbytes for array in arrays)


def scene(path: Path, part: Part, experiment: Path | None) -> Scene:
    """The mesh with its point handles and the nodes of its frames."""
    body = load_body(path)
    return handles_scene(body.name, body.mesh, body.handles)


KIND = Kind(recognise, summarise, scene=scene)
