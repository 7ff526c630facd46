"""Files of internal corrections: safetensors with a JSON header and checksums, never pickle."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from softprint.runtime.body.body import ReducedBody
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import provenance
from softprint.runtime.io.tensor_file import load_with_header, save_tensors
from softprint.runtime.learned.internal.model import InternalModel, InternalOptions

KIND, VERSION = "internal_correction", 2
REMEDY = "train it again"


@dataclass(frozen=True)
class InternalHeader:
    """body_hash, truth_hash: of what it was trained on; options: of the model; held_out_rms: relative error of r on
    held-out states; training: settings and results of the training, in any form."""

    name: str
    body_hash: str
    truth_hash: str
    dim: int
    n_rows: int
    n_nodes: int
    options: dict[str, Any]
    held_out_rms: float
    provenance: dict[str, str]
    training: dict[str, object] = field(default_factory=dict)


def save_internal(
    path: Path,
    model: InternalModel,
    body: ReducedBody,
    truth_hash: str,
    held_out_rms: float,
    training: Mapping[str, object] | None = None,
) -> None:
    """Write a trained internal correction of a body; atomic. Its name is that of the file."""
    header = InternalHeader(
        name=path.stem,
        body_hash=body.content_hash,
        truth_hash=truth_hash,
        dim=model.dim,
        n_rows=model.n_rows,
        n_nodes=int(model.modes.shape[1]),
        options=model.options.to_json(),
        held_out_rms=held_out_rms,
        provenance=provenance(),
        training=dict(training or {}),
    )
    tensors = {name: tensor.float() for name, tensor in model.state_dict().items()}
    save_tensors(path, KIND, VERSION, {"header": json.dumps(asdict(header))}, tensors)


def read_internal_header(path: Path) -> InternalHeader:
    """The header alone; the whole file is read and checked against its checksums."""
    return load_with_header(InternalHeader, path, KIND, VERSION, REMEDY)[0]


def load_internal(path: Path, body: ReducedBody) -> tuple[InternalHeader, InternalModel]:
    """The model of a file, for this body. Raises SoftprintError where the file is missing, damaged, of another kind,
    version or body."""
    header, tensors = load_with_header(InternalHeader, path, KIND, VERSION, REMEDY)
    if header.body_hash != body.content_hash:
        raise SoftprintError(
            f"{path}: was trained for another body (hash {header.body_hash[:12]}) than {body.name!r} "
            f"({body.content_hash[:12]}): train it again for this body"
        )
    try:
        options = InternalOptions.from_json(header.options)
        model = InternalModel(options, header.dim, header.n_rows, header.n_nodes)
        model.load_state_dict(tensors)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise SoftprintError(f"{path}: weights and header do not fit together ({error}): {REMEDY}") from error
    return header, model
