"""Manifest of the inputs of a folder of shards, so that two experiments are never mixed in one truth file.

The manifest is a flat table of everything that determines the numbers: key of the experiment -> value, plus the
hashes of the body and of the collider's file. It is compared key by key, so that an error can say what changed.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from softprint.runtime.body.body import ReducedBody
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.sources import formulas_hash, scene_files
from softprint.runtime.io.files import atomic_path
from softprint.runtime.truth.truth_colliders import FORMULAS, flat_table, sampled_file_hashes, without_absent
from softprint.runtime.truth.truth_schema import VERSION

if TYPE_CHECKING:
    from softprint.runtime.experiment import Experiment

MANIFEST = "manifest.json"
_ABSENT = "(absent)"
_HASH = " hash"  # suffix of the keys of file contents, which older truth files may lack
SAMPLED = "sampled colliders"  # a key that they may lack, too


def fingerprint(experiment: Experiment, body: ReducedBody) -> dict[str, str]:
    """Everything that determines the truth of an experiment, as a flat table: {"sampling.max_depth": "0.012", ...}."""
    content = experiment.model_dump(mode="json")
    deciding = {key: content[key] for key in ("body", "contact", "dynamics", "sampling")}
    deciding["colliders"] = {spec["name"]: spec for spec in content["colliders"]}
    if content["library"] is not None:
        deciding["library"] = content["library"]
    deciding["scenes"] = {scene["name"]: scene for scene in content["scenes"] if scene["role"] == "record"}
    deciding["experiment"] = {"seed": content["experiment"]["seed"]}
    flat = flat_table(deciding, "")
    for key in ("subspace", "hold"):  # the hash of the body has them
        flat.pop(f"body.handles.{key}", None)
    flat["truth version"] = str(VERSION)
    if experiment.contact.refinement:
        flat["depth of a collider"] = "on facets"  # once it was measured at nodes here, too
    flat["body hash"] = body.content_hash
    if experiment.library is not None:
        # Its meshes are patterns: a new file changes which contact is of which shape, and what shapes are for.
        flat[SAMPLED] = json.dumps(experiment.sampled_colliders)
    for name in experiment.sampled_colliders:
        flat |= sampled_file_hashes(experiment, name)
    for scene in experiment.scenes_of_role("record"):
        for file, digest in scene_files(experiment, scene).items():
            flat[f"scenes.{scene.name}.{file}{_HASH}"] = digest
    formulas = formulas_hash(experiment, experiment.sampled_colliders)
    if formulas is not None:
        flat[FORMULAS] = formulas
    return flat


def check_manifest(folder: Path, present: Mapping[str, str]) -> bool:
    """Whether the shards in ``folder`` may be kept: True if they were made from the same inputs; False if there are
    none.

    Raises SoftprintError naming the changes if they were made from other inputs.
    """
    path = folder / MANIFEST
    if not path.is_file():
        return False
    try:
        before: dict[str, str] = json.loads(path.read_text())
    except ValueError as error:
        raise SoftprintError(f"{path}: damaged; --no-resume starts again") from error
    refuse_changes(folder, before, present)
    return True


def has_begun_after(folder: Path, truth: Path) -> bool:
    """Whether the run of the shards in ``folder`` began after a truth file was written."""
    path = folder / MANIFEST
    return path.is_file() and path.stat().st_mtime_ns > truth.stat().st_mtime_ns


def refuse_changes(where: Path, before: Mapping[str, str], present: Mapping[str, str]) -> None:
    """Raise SoftprintError naming each difference between the inputs of ``where`` and the present experiment."""
    before, present = without_absent(before), without_absent(present)
    changes = [
        f"{key}: {before.get(key, _ABSENT)} -> {present.get(key, _ABSENT)}"
        for key in sorted({*before, *present})
        if before.get(key) != present.get(key)
        and (key in before or not (key.endswith(_HASH) or key == SAMPLED))
    ]
    if changes:
        shown = "; ".join(changes[:6]) + (f"; and {len(changes) - 6} more" if len(changes) > 6 else "")
        raise SoftprintError(
            f"{where} contains finished work of a different experiment ({shown}). Undo the change to continue, "
            "choose another --out, or start again with --no-resume"
        )


def write_manifest(folder: Path, present: Mapping[str, str]) -> None:
    with atomic_path(folder / MANIFEST) as temporary:
        temporary.write_text(json.dumps(dict(present), indent=1, sort_keys=True))
