"""The two files of a data set published with the thesis's papers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from runtime.errors import SoftprintError
from runtime.inspect.file_head import FileHead
from runtime.inspect.kinds import Kind, Part
from runtime.inspect.summary import Summary
from runtime.published.handles import find_handles
from runtime.published.layout import PublishedObject, read_meshes

_SAMPLES = {"q", "z", "x"}


def recognise(head: FileHead) -> bool:
    """`q`, `z` and `x` side by side, or a group with W."""
    if head.h5 is None or head.kind:
        return False
    return head.h5 >= _SAMPLES or _has_meshes(head.path)


def _has_meshes(path: Path) -> bool:
    with h5py.File(path, "r") as file:
        return any(isinstance(group, h5py.Group) and "W" in group for group in file.values())


def summarise(path: Path, part: Part) -> Summary:
    """Sizes; of meshes also the handles that their basis shows."""
    if _has_meshes(path):
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
    try:
        with h5py.File(path, "r") as file:
            shapes = {name: file[name].shape for name in ("q", "z", "x")}
            q = np.asarray(file["q"][()], dtype=np.float64)
            unit = str(file.attrs.get("unit", "not told"))
        facts = {
            "samples": shapes["q"][0],
            "nodes, dimension": list(shapes["x"][1:]),
            "handle rows": shapes["q"][1],
            "different handle states": len(np.unique(np.round(q.reshape(len(q), -1), 5), axis=0)),
            "unit of length": unit,
        }
    except (OSError, ValueError, IndexError, AttributeError, RuntimeError, TypeError) as error:
        raise SoftprintError(f"{path}: a published data set that is damaged ({error})") from error
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
