"""Files of `softprint touch`: contact and strain over the whole surface while a scene was played, or what a camera
behind the body saw."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from softprint.runtime.inspect.file_head import FileHead, read_head
from softprint.runtime.inspect.kind import Kind, Part
from softprint.runtime.inspect.summary import Section, Summary, versions
from softprint.runtime.io.files import open_softprint_h5, read_text
from softprint.runtime.touch.camera_series import KIND as CAMERA
from softprint.runtime.touch.camera_series import VERSION as CAMERA_VERSION
from softprint.runtime.touch.series import KIND as TOUCH
from softprint.runtime.touch.series import VERSION


def recognise(head: FileHead) -> bool:
    return head.h5 is not None and head.kind in (TOUCH, CAMERA)


def summarise(path: Path, part: Part) -> Summary:
    """Scene, sizes, and the largest values."""
    return _seen(path) if read_head(path).kind == CAMERA else _felt(path)


def _felt(path: Path) -> Summary:
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


def _seen(path: Path) -> Summary:
    with open_softprint_h5(path, CAMERA, CAMERA_VERSION) as file:
        texts = {name: read_text(file.attrs, name) for name in ("scene", "model", "body_hash", "experiment")}
        times, markers, depth, force, field = (
            file[name][()] for name in ("times", "markers", "depth", "force", "field")
        )
        provenance = json.loads(file.attrs["provenance"])
    sections: dict[str, Section] = {
        "tactile camera": {
            "scene, model": [texts["scene"], texts["model"]],
            "frames": len(times),
            "time [s]": [float(times[0]), float(times[-1])],
            "markers": markers.shape[1],
            "depth image (rows, columns)": list(depth.shape[1:]),
            "field of view [m]": field.tolist(),
            "largest displacement of a marker in the plane [m]": float(
                np.linalg.norm(markers[..., :-1], axis=-1).max()
            ),
            "largest depth [m]": float(np.nanmax(depth)),
            "largest force [N]": float(np.linalg.norm(force, axis=1).max()),
        },
        "hashes": {"body": texts["body_hash"]},
        "made with": versions(provenance),
    }
    return Summary(path, "what a tactile camera sees", sections, texts["experiment"])


KIND = Kind(recognise, summarise)
