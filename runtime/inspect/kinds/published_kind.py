"""The two files of a data set published with the thesis's papers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from softprint.runtime.inspect.file_head import FileHead
from softprint.runtime.inspect.kind import Kind, Part
from softprint.runtime.inspect.summary import Summary
from softprint.runtime.published.adopt import SAME
from softprint.runtime.published.handles import find_handles
from softprint.runtime.published.layout import (
    PublishedObject,
    has_meshes,
    numbers_of,
    open_published,
    read_meshes,
)

_SAMPLES = {"q", "z", "x"}


def recognise(head: FileHead) -> bool:
    """`q`, `z` and `x` side by side, or a group with W."""
    if head.h5 is None or head.kind:
        return False
    return head.h5 >= _SAMPLES or has_meshes(head.path)


def summarise(path: Path, part: Part) -> Summary:
    """Sizes; for meshes also the handles that follow from their basis."""
    if has_meshes(path):
        meshes = read_meshes(path)
        found = find_handles(meshes.body, str(path))
        body = _object(meshes.body) | {
            "point handles": len(found.points),
            "frames, nodes": [len(region) for region in found.frames],
        }
        sections = {
            f"body {meshes.body.name}": body,
            f"collider {meshes.collider.name}": _object(meshes.collider),
        }
        return Summary(path, "meshes of a published data set", sections)
    with open_published(path) as file:
        n, rows, _ = file["q"].shape
        _, nodes, dim = file["x"].shape
        q = numbers_of(file, "q").reshape(n, -1)
        facts = {
            "samples": n,
            "nodes, dimension": [nodes, dim],
            "handle rows": rows,
            "different handle states": len(np.unique(np.round(q / SAME), axis=0)),
            "unit of length": str(file.attrs.get("unit", "not stated")),
        }
    return Summary(path, "samples of a published data set", {"samples": facts})


def _object(item: PublishedObject) -> dict[str, Any]:
    return {
        "nodes": len(item.basis),
        "rows": item.basis.shape[1],
        "dimension": item.dim,
        "simplices": {name: len(array) for name, array in item.simplices.items()},
        "extent, in the file's unit": [float(length) for length in np.ptp(item.rest, axis=0)],
    }


KIND = Kind(recognise, summarise)
