"""bench.json: timings of a step for each model."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from softprint.runtime.errors import SoftprintError
from softprint.runtime.inspect.file_head import FileHead
from softprint.runtime.inspect.kind import Kind, Part
from softprint.runtime.inspect.summary import Summary, versions

_KEYS = {"scene", "iterations", "speeds", "machine"}


def recognise(head: FileHead) -> bool:
    return head.suffix == ".json" and head.keys >= _KEYS


def summarise(path: Path, part: Part) -> Summary:
    """Scene, machine and the timings of every model."""
    bench = json.loads(path.read_text(encoding="utf-8"))
    try:
        sections: dict[str, dict[str, Any]] = {
            "bench": {
                "scene": bench["scene"],
                "Newton iterations a step, at most": bench["iterations"],
                "cores used": bench.get("cores_used", 1),
                **bench["sizes"],
            },
            **{f"model {speed['model']}": _numbers(speed) for speed in bench["speeds"]},
            "machine": dict(bench["machine"]),
            "made with": dict(versions(bench["software"])),
        }
    except (KeyError, TypeError, ValueError) as error:
        raise SoftprintError(f"{path}: the timings are incomplete ({error}): make them again") from error
    return Summary(path, "timings of steps", sections)


def _numbers(speed: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in speed.items() if name != "model"}


KIND = Kind(recognise, summarise)
