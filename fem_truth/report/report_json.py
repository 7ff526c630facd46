"""The JSON file of a report: plain numbers, text and lists, and summaries of the experiment and the body."""

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.experiment import Experiment
from softprint.runtime.io.files import atomic_path

REPORT_VERSION = 1


def plain(value: Any) -> Any:
    """The same content in JSON types. Numbers that are not finite become None, because JSON cannot represent them."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    raise TypeError(f"a report contains numbers, text, lists and tables, not {type(value).__name__}")


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def json_text(summary: Mapping[str, Any]) -> str:
    """The summary as JSON text; it must already be `plain`."""
    return json.dumps(summary, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def experiment_summary(experiment: Experiment) -> dict[str, Any]:
    return {
        "name": experiment.name,
        "seed": experiment.seed,
        "time_step": experiment.dynamics.time_step,
        "gravity": list(experiment.dynamics.gravity),
        "contact_stiffness": experiment.contact.stiffness,
        "contact_refinement": experiment.contact.refinement,
        "friction": experiment.contact.friction,
        "text": experiment.text,
    }


def body_summary(body: ReducedBody) -> dict[str, Any]:
    """Sizes in counts and metres, mass in kg (2D: kg per metre of thickness)."""
    return {
        "name": body.name,
        "dim": body.dim,
        "nodes": body.n_nodes,
        "cells": body.mesh.n_cells,
        "surface_nodes": len(body.mesh.surface_nodes),
        "size": body.mesh.size,
        "mass": float(body.node_mass.sum()),
        "material": _material_words(body),
        "points": len(body.handles.points),
        "frames": len(body.handles.frames),
        "rows": body.n_rows,
        "hold": body.hold,
        "dofs": body.n_dofs,
        "cubature": len(body.cubature.cells),
        "contact_points": len(body.surface.nodes),
        "hash": body.content_hash,
    }


def _material_words(body: ReducedBody) -> str:
    young, poisson = body.material.young, body.material.poisson
    return (
        f"{body.material.model.replace('_', ' ')}, E = {_range(1e-3 * young)} kPa, "
        f"\u03bd = {_range(poisson)}, \u03c1 = {_range(body.density)} kg/m\u00b3"
    )


def _range(values: Array) -> str:
    low, high = float(np.min(values)), float(np.max(values))
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"


def collider_summary(experiment: Experiment, collider: Collider) -> dict[str, Any]:
    spec = experiment.collider(collider.name)
    return {"name": collider.name, "shape": spec.shape, "size": collider.size}


def file_summaries(folder: Path, paths: Iterable[Path]) -> list[dict[str, Any]]:
    """Name, size and SHA-256 of every file that went into the report."""
    return [
        {"name": str(path.relative_to(folder)), "bytes": path.stat().st_size, "hash": _sha256(path)}
        for path in paths
    ]


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
