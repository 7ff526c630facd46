"""Results as JSON, kept with what they were made of: where nothing of that has changed, the work is not done again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from softprint.runtime.io.files import atomic_path


def read_kept(path: Path, made_of: Mapping[str, Any]) -> dict[str, Any] | None:
    """What `keep` wrote for the same things; None where there is nothing, or it is damaged."""
    if not path.is_file():
        return None
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        same = kept.pop("made_of") == json.loads(json.dumps(dict(made_of)))
    except (ValueError, TypeError, KeyError, AttributeError):
        return None
    return dict(kept) if same else None


def keep(path: Path, made_of: Mapping[str, Any], content: Mapping[str, Any]) -> None:
    """Write content, of plain values, with what it was made of; atomic."""
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps({"made_of": dict(made_of), **content}), encoding="utf-8")
