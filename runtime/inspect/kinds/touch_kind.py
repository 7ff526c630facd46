"""A touch file: contact and strain over the whole surface while a scene was played."""

from __future__ import annotations

import json
from pathlib import Path

from softprint.runtime.inspect.file_head import FileHead
from softprint.runtime.inspect.kind import Kind, Part
from softprint.runtime.inspect.summary import Section, Summary, versions
from softprint.runtime.io.files import open_softprint_h5, read_text
from softprint.runtime.touch.series import KIND as TOUCH
from softprint.runtime.touch.series import VERSION


def recognise(head: FileHead) -> bool:
    return head.h5 is not None and head.kind == TOUCH


def summarise(path: Path, part: Part) -> Summary:
    """Scene, sizes, and the largest values."""
    with open_softprint_h5(path, TOUCH, VERSION) as file:
        texts = {name: read_text(file.attrs, name) for name in ("scene", "model", "body_hash", "experiment")}
        times, pressure, strain = (file[name][()] for name in ("times", "pressure", "strain_norm"))
        provenance = json.loads(file.attrs["provenance"])
    touched = (pressure > 0).any(axis=1)
    sections: dict[str, Section] = {
        "touch": {
            "scene, model": [texts["scene"], texts["model"]],
            "frames": len(times),
            "time [s]": [float(times[0]), float(times[-1])],
            "surface samples": pressure.shape[1],
            "frames in contact": int(touched.sum()),
            "largest pressure [Pa]": float(pressure.max()),
            "largest norm of Green strain": float(strain.max()),
        },
        "hashes": {"body": texts["body_hash"]},
        "made with": versions(provenance),
    }
    return Summary(path, "touch at a surface", sections, texts["experiment"])


KIND = Kind(recognise, summarise)
