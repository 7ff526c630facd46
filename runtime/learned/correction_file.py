"""Correction files: safetensors with a JSON header, never pickle.

The header contains the architecture and dimension of the correction, what it belongs to (hash of the body, name of the
collider, hash of the truth data, content hash of the mechanics that it adds to) and its error on held-out states. The
mechanics themselves are a file of the run directory (`mechanics_file.py`). PyTorch, which takes seconds to import, is
imported where a model is made or saved, and not for headers.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.shape_samples import is_same_shape
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.experiment import ANY_COLLIDER
from softprint.runtime.io.files import provenance
from softprint.runtime.io.tensor_file import load_with_header
from softprint.runtime.learned.correction import Correction
from softprint.runtime.mechanics.body_mechanics import BodyMechanics
from softprint.runtime.mechanics.mechanics_file import PATTERN as MECHANICS_FILES
from softprint.runtime.mechanics.mechanics_file import mechanics_hash, read_mechanics

if TYPE_CHECKING:
    from softprint.runtime.learned.form import LearnedModel

KIND, VERSION = "correction", 28
REMEDY = "train it again"


@dataclass(frozen=True)
class CorrectionHeader:
    """The metadata of a correction file.

    form: one of `registry.FORMS`; mechanics_hash: content hash of the mechanics that it was trained with, empty for a
    form without mechanics; held_out_rms: relative error on the held-out states (see `surrogate.learning_task`);
    training: settings and results of the training, in any form; shape: of the collider (`shape_samples`), empty if it
    was trained for any.
    """

    name: str
    collider: str
    body_hash: str
    truth_hash: str
    dim: int
    n_rows: int
    form: str
    options: dict[str, Any]
    mechanics_hash: str
    held_out_rms: float
    training: dict[str, object]
    provenance: dict[str, str]
    shape: list[float] = field(default_factory=list)

    @property
    def added_to(self) -> str:
        """The name of the internal correction that it is added to, empty for none."""
        return str(self.options.get("added_to", ""))


def save_correction(
    path: Path,
    name: str,
    model: LearnedModel,
    body: ReducedBody,
    collider: str,
    truth_hash: str,
    held_out_rms: float,
    training: Mapping[str, object],
    mechanics_hash: str = "",
    shape: Array | None = None,
) -> None:
    """Write a trained model with its header; atomic. mechanics_hash: see `MechanicsHeader.content_hash`; shape: the
    `shape_samples` of the collider, None if the model is for any."""
    from softprint.runtime.io.torch_file import save_tensors

    header = CorrectionHeader(
        name=name,
        collider=collider,
        body_hash=body.content_hash,
        truth_hash=truth_hash,
        dim=model.dim,
        n_rows=model.n_rows,
        form=model.form,
        options=model.options.to_json(),
        mechanics_hash=mechanics_hash,
        held_out_rms=held_out_rms,
        training=dict(training),
        provenance=provenance(),
        shape=[] if shape is None else shape.tolist(),
    )
    text = json.dumps({own.name: getattr(header, own.name) for own in fields(header)})
    save_tensors(path, KIND, VERSION, {"header": text}, model.state_dict())


def read_header(path: Path) -> CorrectionHeader:
    """The header alone. Raises SoftprintError where the file is missing, damaged, foreign or of another
    version."""
    return _read(path)[0]


def load_correction(
    path: str | Path, body: ReducedBody, collider: Collider, mechanics: BodyMechanics | None = None
) -> Correction:
    """The correction of a file for one collider: the one that it was trained for, or any if it was trained for any.

    mechanics: of the body, from `load_mechanics`; by default they are loaded from the mechanics file beside the
    correction or in its parent folder, the run directory.
    Raises SoftprintError as :func:`read_header`, where body or collider are not those of the file, and where the
    mechanics that it was trained with are missing.
    """
    return read_correction(path, body, mechanics).on(collider)


@dataclass(frozen=True, eq=False)
class TrainedCorrection:
    """A correction file, read once for any number of colliders. mechanics: of the body, None for a form without."""

    path: Path
    header: CorrectionHeader
    mechanics: BodyMechanics | None
    _make: Callable[[Collider], Correction]

    @property
    def is_for_any(self) -> bool:
        """Whether it was trained for any collider."""
        return self.header.collider == ANY_COLLIDER

    def is_for(self, collider: Collider) -> bool:
        """Whether it was trained for the collider of that name, for another of the same shape and size, or for any."""
        if self.is_for_any or self.header.collider == collider.name:
            return True
        return bool(self.header.shape) and is_same_shape(collider, self.header.shape)

    def on(self, collider: Collider) -> Correction:
        """The correction for one collider. Raises SoftprintError where it was trained for another."""
        if not self.is_for(collider):
            raise SoftprintError(
                f"{self.path}: was trained for the collider {self.header.collider!r}, not for {collider.name!r}"
            )
        if self.header.shape and not is_same_shape(collider, self.header.shape):
            raise SoftprintError(
                f"{self.path}: was trained for a collider {self.header.collider!r} of another shape or size than this "
                f"one of the same name: give this one another name, or train the correction again"
            )
        return self._make(collider)


def read_correction(
    path: str | Path, body: ReducedBody, mechanics: BodyMechanics | None = None
) -> TrainedCorrection:
    """The correction of a file for this body. mechanics and errors: see :func:`load_correction`."""
    path = Path(path)
    header, arrays = _read(path)
    if header.body_hash != body.content_hash:
        raise SoftprintError(
            f"{path}: was trained for another body (hash {header.body_hash[:12]}) than {body.name!r} "
            f"({body.content_hash[:12]}): train it again for this body"
        )
    own = _mechanics(path, header, body, mechanics) if header.mechanics_hash else None
    try:
        make = _maker(header, arrays, own, body)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise SoftprintError(
            f"{path}: weights and header do not fit together ({error}): train it again"
        ) from error
    return TrainedCorrection(path, header, own, make)


def _mechanics(
    path: Path, header: CorrectionHeader, body: ReducedBody, given: BodyMechanics | None
) -> BodyMechanics:
    """The mechanics that a correction was trained with: `given`, or those of a file near the correction."""
    wanted = header.mechanics_hash
    if given is not None:
        if mechanics_hash(given) != wanted:
            raise SoftprintError(
                f"{path}: was trained with other mechanics of the body (hash {wanted[:12]}) than those given "
                f"({mechanics_hash(given)[:12]}): give those of its run directory, or train it again"
            )
        return given
    folders = (path.parent, path.parent.parent)
    files = [file for folder in folders for file in sorted(folder.glob(MECHANICS_FILES))]
    unreadable: SoftprintError | None = None
    for file in files:
        try:
            found, mechanics = read_mechanics(file, body)
        except SoftprintError as error:
            unreadable = error
            continue
        if found.content_hash == wanted:
            return mechanics
    if unreadable is not None:
        raise unreadable
    if files:
        raise SoftprintError(
            f"{path}: was trained with other mechanics of the body (hash {wanted[:12]}) than those of "
            f"{' and '.join(map(str, files))}: copy the mechanics file of the run that it is from, or train it again"
        )
    raise SoftprintError(
        f"{path}: there is no mechanics file ({MECHANICS_FILES}) beside it or in {path.parent.parent}: copy that of "
        "the run that it is from, or make it with `softprint mechanics`"
    )


def _maker(
    header: CorrectionHeader,
    arrays: Mapping[str, NDArray[Any]],
    mechanics: BodyMechanics | None,
    body: ReducedBody,
) -> Callable[[Collider], Correction]:
    import torch

    from softprint.runtime.learned.form import find_form

    form = find_form(header.form)
    if form.needs_mechanics and mechanics is None:
        raise ValueError("no hash of mechanics")
    model = form.model(header.options, header.dim, header.n_rows)
    model.load_state_dict({name: torch.from_numpy(array) for name, array in arrays.items()})
    return lambda collider: form.correction(header.name, model, body, collider, mechanics)


def _read(path: Path) -> tuple[CorrectionHeader, dict[str, NDArray[Any]]]:
    return load_with_header(CorrectionHeader, path, KIND, VERSION, REMEDY)
