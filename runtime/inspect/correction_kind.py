"""A correction file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from runtime.inspect.file_head import FileHead
from runtime.inspect.kinds import Kind, Part
from runtime.inspect.summary import Summary, versions
from runtime.learned.correction_file import DESCRIPTOR, FIELD, LOADS, read_header
from runtime.learned.correction_file import KIND as CORRECTION

_FORMS = {
    FIELD: "displacement field",
    LOADS: "loads on the mechanics of the body at rest",
    DESCRIPTOR: "displacement from a local descriptor of the collider",
}


def recognise(head: FileHead) -> bool:
    return head.suffix == ".safetensors" and head.kind == CORRECTION


def summarise(path: Path, part: Part) -> Summary:
    """All weights are read and checked against the digest."""
    header = read_header(path)
    sections: dict[str, dict[str, Any]] = {
        "correction": {
            "name": header.name,
            "form": _FORMS.get(header.form, header.form),
            "collider": header.collider,
            "dimension, rows of the body": [header.dim, header.n_rows],
            "error on held-out states": header.held_out_rms,
        },
        "options": {name: _known(value) for name, value in header.options.items()},
        "training": {name: _known(value) for name, value in header.training.items()},
        "hashes": {"body": header.body_hash, "truth": header.truth_hash},
        "made with": dict(versions(header.provenance)),
    }
    return Summary(path, "a correction", {title: section for title, section in sections.items() if section})


def _known(value: Any) -> Any:
    return "default" if value is None else value


KIND = Kind(recognise, summarise)
