"""Files of internal corrections: safetensors with a JSON header and checksums, never pickle."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import torch

from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.cubature import Cubature
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import provenance
from softprint.runtime.io.torch_file import load_with_header, save_tensors
from softprint.runtime.learned.internal.model import (
    InternalModel,
    InternalOptions,
    ModesModel,
    ModesOptions,
    QuadraticModel,
    QuadraticOptions,
)

if TYPE_CHECKING:
    from torch import Tensor

# Tensors of a cubature.
_CELLS, _WEIGHTS = "cubature.cells", "cubature.weights"
KIND, VERSION = "internal_correction", 3
REMEDY = "train it again"

AnyModel = InternalModel | QuadraticModel | ModesModel


@dataclass(frozen=True)
class InternalHeader:
    """form: internal, with a network, quadratic in the state, or equilibrium, of modes alone; body_hash, truth_hash: of
    what it was trained on; options: of the model; held_out_rms: relative error of r, of modes that of u, on held-out
    states; training: settings and results of the training, in any form; cubature_errors: of energy and forces with its
    own cubature, empty without one."""

    name: str
    form: str
    body_hash: str
    truth_hash: str
    dim: int
    n_rows: int
    n_nodes: int
    options: dict[str, Any]
    held_out_rms: float
    provenance: dict[str, str]
    training: dict[str, object] = field(default_factory=dict)
    cubature_errors: Sequence[float] = ()


class TrainedInternal(NamedTuple):
    """The content of a file. cubature: that its elasticity is integrated with, None for that of the body."""

    header: InternalHeader
    model: AnyModel
    cubature: Cubature | None

    def on(self, body: ReducedBody) -> ReducedBody:
        """The body with this cubature."""
        return body if self.cubature is None else with_cubature(body, self.cubature)


def with_cubature(body: ReducedBody, cubature: Cubature) -> ReducedBody:
    """The same body with another cubature."""
    return replace(body, cubature=cubature)


def save_internal(
    path: Path,
    model: AnyModel,
    body: ReducedBody,
    truth_hash: str,
    held_out_rms: float,
    training: Mapping[str, object] | None = None,
    cubature: Cubature | None = None,
) -> None:
    """Write a trained internal correction of a body; atomic. Its name is that of the file. cubature: see
    `TrainedInternal`."""
    header = InternalHeader(
        name=path.stem,
        form=model.form,
        body_hash=body.content_hash,
        truth_hash=truth_hash,
        dim=model.dim,
        n_rows=model.n_rows,
        n_nodes=int(model.modes.shape[1]),
        options=model.options.to_json(),
        held_out_rms=held_out_rms,
        provenance=provenance(),
        training=dict(training or {}),
        cubature_errors=() if cubature is None else (cubature.energy_error, cubature.force_error),
    )
    tensors = {name: tensor.float() for name, tensor in model.state_dict().items()}
    if cubature is not None:
        tensors |= {
            _CELLS: torch.from_numpy(cubature.cells),
            _WEIGHTS: torch.from_numpy(cubature.weights),
        }
    save_tensors(path, KIND, VERSION, {"header": json.dumps(asdict(header))}, tensors)


def read_internal_header(path: Path) -> InternalHeader:
    """The header alone; the whole file is read and checked against its checksums."""
    return load_with_header(InternalHeader, path, KIND, VERSION, REMEDY)[0]


def load_internal(path: Path, body: ReducedBody) -> TrainedInternal:
    """The content of a file, for this body. Raises SoftprintError where the file is missing, damaged, of another kind,
    version or body."""
    header, tensors = load_with_header(InternalHeader, path, KIND, VERSION, REMEDY)
    if header.body_hash != body.content_hash:
        raise SoftprintError(
            f"{path}: was trained for another body (hash {header.body_hash[:12]}) than {body.name!r} "
            f"({body.content_hash[:12]}): train it again for this body"
        )
    try:
        cubature = _cubature(header, tensors, body)
        model = _untrained(header)
        model.load_state_dict(tensors)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise SoftprintError(f"{path}: weights and header do not fit together ({error}): {REMEDY}") from error
    return TrainedInternal(header, model, cubature)


def _untrained(header: InternalHeader) -> AnyModel:
    """A model of the form of a header. Raises KeyError for an unknown one."""
    makers: dict[str, Callable[[], AnyModel]] = {
        InternalModel.form: lambda: InternalModel(InternalOptions.from_json(header.options), *shape),
        QuadraticModel.form: lambda: QuadraticModel(QuadraticOptions.from_json(header.options), *shape),
        ModesModel.form: lambda: ModesModel(ModesOptions.from_json(header.options), *shape),
    }
    shape = header.dim, header.n_rows, header.n_nodes
    return makers[header.form]()


def _cubature(header: InternalHeader, tensors: dict[str, Tensor], body: ReducedBody) -> Cubature | None:
    """Takes the tensors of a cubature out of those of a file. Raises ValueError for cells that the body does not
    have."""
    if not header.cubature_errors:
        return None
    cells, weights = (tensors.pop(name).numpy() for name in (_CELLS, _WEIGHTS))
    if cells.shape != weights.shape or not np.all((cells >= 0) & (cells < body.mesh.n_cells)):
        raise ValueError("a cubature of other cells than those of the body")
    energy, force = header.cubature_errors
    return Cubature(cells.astype(np.int64), weights.astype(np.float64), energy, force)
