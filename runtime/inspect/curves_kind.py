"""The curves of a training: corrections/MODEL.json."""

from __future__ import annotations

import json
from pathlib import Path

from runtime.errors import SoftprintError
from runtime.inspect.file_head import FileHead
from runtime.inspect.kinds import Kind, Part
from runtime.inspect.summary import Summary

_KEYS = {"model", "held_out", "history"}


def recognise(head: FileHead) -> bool:
    return head.suffix == ".json" and head.keys >= _KEYS


def summarise(path: Path, part: Part) -> Summary:
    """How far it was trained, from what, and how well it does on states that it has not seen."""
    curves = json.loads(path.read_text(encoding="utf-8"))
    try:
        held_out, history = curves["held_out"], curves["history"]
        facts = {
            "model": curves["model"],
            "samples to learn from, left out": [curves["samples"], curves["left_out"]],
            "error on held-out states": {name: held_out[name] for name in ("rms", "worst")},
            "held-out samples": held_out["samples"],
            "label-noise floor": curves["noise_floor"],
            "validations": len(history),
        }
        sections = {"training": facts}
        if history:
            sections["at the end"] = dict(history[-1])
    except (KeyError, TypeError, ValueError) as error:
        raise SoftprintError(f"{path}: the curves are incomplete ({error}): train again") from error
    return Summary(path, "the curves of a training", sections)


KIND = Kind(recognise, summarise)
