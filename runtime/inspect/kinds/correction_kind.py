"""A correction file, of contact with a collider or of the body itself."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from softprint.runtime.inspect.file_head import FileHead, read_head
from softprint.runtime.inspect.kind import Kind, Part
from softprint.runtime.inspect.summary import Summary, versions
from softprint.runtime.learned.correction_file import KIND as CORRECTION
from softprint.runtime.learned.correction_file import read_header
from softprint.runtime.learned.form import find_form
from softprint.runtime.learned.internal.file import KIND as INTERNAL
from softprint.runtime.learned.internal.file import read_internal_header
from softprint.runtime.learned.internal.model import InternalModel, ModesModel, QuadraticModel
from softprint.runtime.learned.registry import FORMS

_LINES = {model.form: model.line for model in (InternalModel, QuadraticModel, ModesModel)}


def recognise(head: FileHead) -> bool:
    return head.suffix == ".safetensors" and head.kind in (CORRECTION, INTERNAL)


def summarise(path: Path, part: Part) -> Summary:
    """All weights are read and checked against the digest."""
    if read_head(path).kind == INTERNAL:
        return _internal(path)
    header = read_header(path)
    sections: dict[str, dict[str, Any]] = {
        "correction": {
            "name": header.name,
            "form": find_form(header.form).line if header.form in FORMS else header.form,
            "collider": header.collider,
            "dimension, rows of the body": [header.dim, header.n_rows],
            "error on held-out states": header.held_out_rms,
        },
        "options": {name: _known(value) for name, value in header.options.items()},
        "training": {name: _known(value) for name, value in header.training.items()},
        "hashes": {
            "body": header.body_hash,
            "truth": header.truth_hash,
            **({"mechanics": header.mechanics_hash} if header.mechanics_hash else {}),
        },
        "made with": dict(versions(header.provenance)),
    }
    return Summary(path, "a correction", {title: section for title, section in sections.items() if section})


def _internal(path: Path) -> Summary:
    header = read_internal_header(path)
    on = "static condensation" if header.options.get("on_condensation") else "the subspace alone"
    sections: dict[str, dict[str, Any]] = {
        "internal correction": {
            "name": header.name,
            "form": _LINES.get(header.form, header.form),
            "is added to": on,
            "dimension, rows, nodes of the body": [header.dim, header.n_rows, header.n_nodes],
            "error on held-out states": header.held_out_rms,
        },
        "options": dict(header.options),
        "training": dict(header.training),
        "hashes": {"body": header.body_hash, "truth": header.truth_hash},
        "made with": dict(versions(header.provenance)),
    }
    return Summary(
        path, "an internal correction", {title: section for title, section in sections.items() if section}
    )


def _known(value: Any) -> Any:
    return "default" if value is None else value


KIND = Kind(recognise, summarise)
