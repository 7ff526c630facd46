"""Training curves: corrections/MODEL.json."""

from __future__ import annotations

import json
from pathlib import Path

from softprint.runtime.errors import SoftprintError
from softprint.runtime.inspect.file_head import FileHead
from softprint.runtime.inspect.kind import Kind, Part
from softprint.runtime.inspect.summary import Summary

_KEYS = {"model", "held_out", "history"}


def recognise(head: FileHead) -> bool:
    return head.suffix == ".json" and head.keys >= _KEYS


def summarise(path: Path, part: Part) -> Summary:
    """Training steps, training data, the error on held-out states, and of forces and energy where these are learned."""
    curves = json.loads(path.read_text(encoding="utf-8"))
    try:
        held_out, history = curves["held_out"], curves["history"]
        facts = {
            "model": curves["model"],
            "training samples, left out": [curves["samples"], curves["left_out"]],
            "error on held-out states": {name: held_out[name] for name in ("rms", "worst")},
            "held-out samples": held_out["samples"],
            "label-noise floor": curves["noise_floor"],
            "validations": len(history),
        }
        sections = {"training": facts}
        if "energy" in curves:
            errors = curves["energy"]
            sections["energy of contact, RMS errors on held-out samples"] = {
                f"{kind}, {model}": errors[model][kind]
                for kind in errors["learned"]
                for model in ("mechanics", "learned")
            }
        if history:
            sections["at the end"] = dict(history[-1])
    except (KeyError, TypeError, ValueError) as error:
        raise SoftprintError(f"{path}: the curves are incomplete ({error}): train again") from error
    return Summary(path, "training curves", sections)


KIND = Kind(recognise, summarise)
