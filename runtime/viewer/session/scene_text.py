"""A recorded press as a `[[scenes]]` table of an experiment file, so that it can be training or test data."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.colliders import RigidPose
from softprint.runtime.colliders.kinds.table import ColliderTable
from softprint.runtime.viewer.session.keyframes import keyframes, rotation_vectors


def keyframe_tables(times: Array, poses: Sequence[RigidPose], distance: float) -> list[dict[str, Any]]:
    """The keyframes of a recorded path (`keyframes.py`), without rotations where it never turns."""
    kept = keyframes(times, poses, distance)
    vectors = rotation_vectors(poses)
    turns = bool(np.abs(vectors[kept]).max() > 0)
    return [
        {
            "time": round(float(times[k]), 6),
            "position": [round(float(x), 7) for x in poses[k].translation],
            **({"rotation": [round(float(w), 6) for w in vectors[k]]} if turns else {}),
        }
        for k in kept
    ]


def scene_text(scene: Mapping[str, Any], tables: Sequence[ColliderTable], remarks: Sequence[str]) -> str:
    """TOML of a scene, and of the colliders that the experiment file does not have yet; remarks: comments above."""
    lines = [f"# {remark}" for remark in remarks]
    for table in tables:
        lines += ["", "[[colliders]]", *_pairs(table.model_dump(mode="json", exclude_none=True))]
    lines += ["", "[[scenes]]", *_pairs({k: v for k, v in scene.items() if k != "colliders"})]
    for collider in scene["colliders"]:
        lines += ["[[scenes.colliders]]", *_pairs(collider)]
    return "\n".join(lines) + "\n"


def _pairs(table: Mapping[str, Any]) -> list[str]:
    return [f"{key} = {_value(value)}" for key, value in table.items()]


def _value(value: Any) -> str:
    """A value in TOML; lists of tables one on a line."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_value(own)}" for key, own in value.items()) + " }"
    if isinstance(value, list | tuple):
        if value and isinstance(value[0], Mapping):
            return "[\n" + "".join(f"    {_value(own)},\n" for own in value) + "]"
        return "[" + ", ".join(_value(own) for own in value) + "]"
    return json.dumps(str(value) if isinstance(value, Path) else value)
