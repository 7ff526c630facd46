"""Mechanics files: the linear mechanics of a body at rest, as safetensors with a JSON header, never pickle.

They depend on the body alone, so that one file serves every correction of a run directory. The large tensors of a
compliance are stored in half precision (`surface_compliance_arrays.py`). The content hash is that of the arrays as
stored in the file, so that it does not change when mechanics are saved and loaded.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from softprint.runtime.body.body import ReducedBody
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import content_hash, provenance
from softprint.runtime.io.tensor_file import load_with_header, save_arrays
from softprint.runtime.mechanics.body_mechanics import BodyMechanics
from softprint.runtime.mechanics.compliance.surface_compliance_arrays import (
    surface_compliance_arrays,
    take_compliance,
)
from softprint.runtime.mechanics.static_condensation import condensation_arrays, take_condensation

KIND, VERSION = "mechanics", 3
REMEDY = "make it again with `softprint mechanics`"
PATTERN = "mechanics_*.safetensors"
_SURFACE, _SPREAD = "compliance", "spread"


@dataclass(frozen=True)
class MechanicsHeader:
    """The metadata of a mechanics file.

    body_hash: of the body; contact_nodes: the largest number that was requested (a small surface has fewer);
    static_condensation: whether the file contains one; gravity: of the static condensation [m/s^2], empty without one;
    content_hash: of the arrays.
    """

    body_hash: str
    contact_nodes: int
    gravity: list[float]
    static_condensation: bool
    content_hash: str
    provenance: dict[str, str]


def mechanics_path(run: Path, contact_nodes: int) -> Path:
    """The path of the mechanics with at most so many contact nodes in a run directory."""
    return run / PATTERN.replace("*", str(contact_nodes))


def save_mechanics(
    path: str | Path, mechanics: BodyMechanics, body: ReducedBody, contact_nodes: int | None = None
) -> MechanicsHeader:
    """Write the mechanics of a body; atomic. contact_nodes: the number that was requested, by default the
    actual number. Returns the header of the file. Raises SoftprintError for mechanics of another body."""
    mechanics.check_body(body)
    arrays, internal = _arrays(mechanics), mechanics.condensation
    header = MechanicsHeader(
        body_hash=body.content_hash,
        contact_nodes=len(mechanics.surface_compliance.nodes) if contact_nodes is None else contact_nodes,
        gravity=[] if internal is None else internal.gravity.tolist(),
        static_condensation=internal is not None,
        content_hash=content_hash(arrays),
        provenance=provenance(),
    )
    save_arrays(Path(path), KIND, VERSION, {"header": json.dumps(asdict(header))}, arrays)
    return header


def load_mechanics(path: str | Path, body: ReducedBody) -> BodyMechanics:
    """The mechanics of a file. Raises SoftprintError where it is missing, damaged, foreign, of another version, or of
    another body."""
    return read_mechanics(path, body)[1]


def read_mechanics(path: str | Path, body: ReducedBody) -> tuple[MechanicsHeader, BodyMechanics]:
    """The header and the mechanics of a file; raises as `load_mechanics`."""
    header, arrays = _read(Path(path))
    if header.body_hash != body.content_hash:
        raise SoftprintError(
            f"{path}: holds the mechanics of another body (hash {header.body_hash[:12]}) than {body.name!r} "
            f"({body.content_hash[:12]}): {REMEDY}"
        )
    try:
        return header, _mechanics(arrays)._replace(body_hash=header.body_hash)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise SoftprintError(f"{path}: the mechanics are incomplete ({error}): {REMEDY}") from error


def read_mechanics_header(path: str | Path) -> MechanicsHeader:
    """The header alone. Raises SoftprintError where the file is missing, damaged, foreign or of another version."""
    return _read(Path(path))[0]


def mechanics_hash(mechanics: BodyMechanics) -> str:
    """The content hash of a file of these mechanics."""
    return content_hash(_arrays(mechanics))


def as_saved(mechanics: BodyMechanics) -> BodyMechanics:
    """The mechanics as loaded from a file, with the compliance rounded to half precision: corrections are trained with
    the values that the runtime uses."""
    return _mechanics(_arrays(mechanics))._replace(body_hash=mechanics.body_hash)


def _arrays(mechanics: BodyMechanics) -> dict[str, NDArray[Any]]:
    arrays = surface_compliance_arrays(mechanics.surface_compliance, _SURFACE)
    arrays |= surface_compliance_arrays(mechanics.spread_compliance, _SPREAD)
    if mechanics.condensation is not None:
        arrays |= condensation_arrays(mechanics.condensation)
    return arrays


def _mechanics(arrays: Mapping[str, NDArray[Any]]) -> BodyMechanics:
    left = dict(arrays)
    surface, spread = (take_compliance(left, prefix) for prefix in (_SURFACE, _SPREAD))
    return BodyMechanics(surface, take_condensation(left), spread)


def _read(path: Path) -> tuple[MechanicsHeader, dict[str, NDArray[Any]]]:
    return load_with_header(MechanicsHeader, path, KIND, VERSION, REMEDY)
