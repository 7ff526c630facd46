"""A mechanics file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from softprint.runtime.inspect.file_head import FileHead
from softprint.runtime.inspect.kind import Kind, Part
from softprint.runtime.inspect.summary import Summary, versions
from softprint.runtime.mechanics.mechanics_file import KIND as MECHANICS
from softprint.runtime.mechanics.mechanics_file import read_mechanics_header


def recognise(head: FileHead) -> bool:
    return head.suffix == ".safetensors" and head.kind == MECHANICS


def summarise(path: Path, part: Part) -> Summary:
    """All tensors are read and checked against the digest."""
    header = read_mechanics_header(path)
    sections: dict[str, dict[str, Any]] = {
        "mechanics": {
            "limit of contact nodes": header.contact_nodes,
            "static condensation": header.static_condensation,
            "gravity [m/s^2]": header.gravity,
        },
        "hashes": {"body": header.body_hash, "content": header.content_hash},
        "made with": dict(versions(header.provenance)),
    }
    return Summary(path, "the linear mechanics of a body at rest", sections)


KIND = Kind(recognise, summarise)
