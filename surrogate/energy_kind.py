"""What `softprint inspect` prints for a learned energy of contact, energy_N.json."""

from __future__ import annotations

import json
from pathlib import Path

from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy
from softprint.runtime.errors import SoftprintError
from softprint.runtime.inspect.file_head import FileHead
from softprint.runtime.inspect.kind import Kind, Part
from softprint.runtime.inspect.summary import Summary

_KEYS = {"made_of", "energy", "errors"}


def recognise(head: FileHead) -> bool:
    return head.suffix == ".json" and head.keys >= _KEYS


def summarise(path: Path, part: Part) -> Summary:
    """Its parameters, its errors by cross-validation beside those of linear mechanics, and what it was made of."""
    kept = json.loads(path.read_text(encoding="utf-8"))
    try:
        errors = kept["errors"]
        energy = None if kept["energy"] is None else LearnedEnergy.of(kept["energy"])
        facts = {
            "converged": errors["converged"],
            "b": "none: that of linear mechanics" if energy is None else energy.fourth,
        }
        compared = {
            f"{kind}, {model}": errors[model][kind]
            for kind in errors["learned"]
            for model in ("mechanics", "learned")
        }
        samples = {"samples": errors["samples"], **compared}
        made_of = {name: str(value) for name, value in kept["made_of"].items()}
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise SoftprintError(
            f"{path}: the energy is incomplete ({error}): remove it and train again"
        ) from error
    sections = {"energy": facts, "RMS errors on held-out samples": samples, "made of": made_of}
    return Summary(path, "a learned energy of contact", sections)


KIND = Kind(recognise, summarise)
