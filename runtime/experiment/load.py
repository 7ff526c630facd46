"""Read an experiment file."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.consistency import inconsistencies
from softprint.runtime.experiment.experiment import LIBRARY, Experiment
from softprint.runtime.experiment.overrides import apply_override
from softprint.runtime.experiment.problems import problems_of, raise_problems
from softprint.runtime.experiment.renamed import renamed


def load_experiment(path: Path | str, overrides: Sequence[str] = ()) -> Experiment:
    """Read and check a whole experiment.

    overrides: `key.subkey=VALUE`, applied before anything is checked. Raises SoftprintError with one line for each
    problem: file, key, error, value, and remedy.
    """
    path = Path(path)
    text = _text(path)
    try:
        data: dict[str, Any] = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SoftprintError(f"{path}: this is not TOML: {error}") from error
    for override in overrides:
        apply_override(data, override)
    raise_problems(path, renamed(data))
    _name_the_only_collider(data)
    try:
        # Strict, so that "5" is not a number; from JSON, because strict pydantic accepts lists as tuples only there.
        experiment = Experiment.model_validate_json(json.dumps(data, default=str), strict=True)
    except ValidationError as error:
        raise_problems(path, problems_of(error, Experiment, data))
        raise
    experiment._path = path
    # A comment of the file must not be taken for an override (`stored_text.py`).
    experiment._text = re.sub(r"(?m)^# --set ", "#  --set ", text) + "".join(
        f"\n# --set {override}" for override in overrides
    )
    raise_problems(path, inconsistencies(experiment))
    return experiment


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise SoftprintError(f"{path}: there is no such experiment file") from error
    except OSError as error:
        raise SoftprintError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise SoftprintError(f"{path}: this is not a text file; an experiment is TOML in UTF-8") from error


def _name_the_only_collider(data: dict[str, Any]) -> None:
    """Fill in the collider of `[sampling]` and `[training]` if the file has a library, or just one collider."""
    colliders = data.get("colliders")
    if "library" in data:
        name: object = LIBRARY
    elif isinstance(colliders, list) and len(colliders) == 1 and isinstance(colliders[0], dict):
        name = colliders[0].get("name")
    else:
        return
    for section in ("sampling", "training"):
        table = data.setdefault(section, {})
        if isinstance(table, dict) and isinstance(name, str):
            table.setdefault("collider", name)
