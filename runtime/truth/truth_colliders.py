"""Check that colliders, contact and gravity of an experiment are those that a truth file was made with."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.sources import collider_files, formulas_hash

if TYPE_CHECKING:
    from softprint.runtime.experiment import Experiment
    from softprint.runtime.truth.truth_file import TruthData


FORMULAS = "library formulas hash"  # key of `TruthHeader.made_from`


def flat_table(value: Any, prefix: str) -> dict[str, str]:
    """A nested table as a flat one: {"sampling.max_depth": "0.012", ...}."""
    if not isinstance(value, dict):
        return {prefix: json.dumps(value)}
    flat: dict[str, str] = {}
    for key, item in value.items():
        flat |= flat_table(item, f"{prefix}.{key}" if prefix else key)
    return flat


def without_absent(flat: Mapping[str, str]) -> dict[str, str]:
    """A flat table without null entries, so that keys added in later versions do not count as changes."""
    return {key: _without_nulls(text) for key, text in flat.items() if text != "null"}


def _without_nulls(text: str) -> str:
    if "null" not in text:
        return text
    return json.dumps(
        json.loads(text, object_hook=lambda table: {k: v for k, v in table.items() if v is not None})
    )


def sampled_file_hashes(experiment: Experiment, name: str) -> dict[str, str]:
    """Hashes of the files of a sampled collider, under their keys in `TruthHeader.made_from`."""
    files = collider_files(experiment.collider(name), experiment.base_dir)
    which = f"library mesh {name}" if name in experiment.own_shapes else "collider"
    return {f"{which} {where} file hash" if where else f"{which} file hash": files[where] for where in files}


def require_same_colliders(truth: TruthData, experiment: Experiment) -> None:
    """Raise SoftprintError if one of the truth's colliders has another shape or size in the experiment now: its
    displacements would be attributed to another collider."""
    present: dict[str, str] = {}
    own, known = {spec.name: spec for spec in experiment.colliders}, experiment.collider_names
    for name in truth.header.colliders:
        if name in own:
            present |= flat_table(own[name].model_dump(mode="json"), f"colliders.{name}")
            present |= sampled_file_hashes(experiment, name)
        elif experiment.library is not None:
            size = experiment.library.model_dump(mode="json", include={"size", "resolution", "unit"})
            present |= flat_table(size, "library")
            if name in experiment.own_shapes:
                present |= sampled_file_hashes(experiment, name)
    formulas = formulas_hash(experiment, [name for name in truth.header.colliders if name in known])
    if formulas is not None:
        present[FORMULAS] = formulas
    before, present = without_absent(truth.header.made_from), without_absent(present)
    changed = [
        f"{key}: {before[key]} -> {now}"
        for key, now in present.items()
        # Of files only the content counts; absent keys are from another program, or an older version of `generate`.
        if before.get(key, now) != now and not key.endswith(".file")
    ]
    if changed:
        raise SoftprintError(
            f"{truth.path}: was made with other colliders than the experiment's ({'; '.join(changed[:4])}): undo the "
            "change, or make the truth again with `softprint generate --no-resume`"
        )


def require_same_loads(truth: TruthData, experiment: Experiment) -> None:
    """Raise SoftprintError if the truth was solved with another contact law or another gravity than the experiment has
    now: its labels would be learned under those."""
    present = {
        "contact.stiffness": experiment.contact.stiffness,
        "contact.refinement": experiment.contact.refinement,
        "dynamics.gravity": list(experiment.dynamics.gravity),
    }
    before = truth.header.made_from
    changed = [
        f"{key}: {before[key]} -> {json.dumps(now)}"
        for key, now in present.items()
        if key in before and json.loads(before[key]) != now
    ]
    if changed:
        raise SoftprintError(
            f"{truth.path}: was solved under other loads than the experiment's ({'; '.join(changed)}): undo the "
            "change, or make the truth again with `softprint generate --no-resume`"
        )
