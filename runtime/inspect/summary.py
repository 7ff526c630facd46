"""The summary of a file: named sections of named values, as text for people and as JSON for programs."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

Section = Mapping[str, Any]


@dataclass(frozen=True)
class Summary:
    """kind: what the file is, in words; sections: title -> label -> value (text, numbers, lists, mappings);
    experiment: the text of the experiment that it was made from, if it contains one."""

    path: Path
    kind: str
    sections: Mapping[str, Section]
    experiment: str | None = None

    def as_json(self) -> str:
        """One JSON object; numbers that are not finite are null."""
        content = {
            "file": str(self.path),
            "bytes": self.path.stat().st_size,
            "kind": self.kind,
            **{title: plain(section) for title, section in self.sections.items()},
        }
        return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)

    def as_text(self) -> str:
        """Lines for a terminal: the kind, then the sections with their values in one column."""
        lines = [f"{self.path}: {self.kind}, {byte_size(self.path.stat().st_size)}"]
        width = max((len(label) for section in self.sections.values() for label in section), default=0)
        for title, section in self.sections.items():
            lines += ["", title]
            lines += [f"  {label:<{width}}  {text_of(value)}" for label, value in section.items()]
        return "\n".join(lines)


def text_of(value: Any) -> str:
    """One value as short text: numbers with four digits, mappings as "a 1, b 2"."""
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {text_of(item)}" for name, item in value.items()) or "none"
    if isinstance(value, list | tuple | np.ndarray):
        return ", ".join(text_of(item) for item in value) or "none"
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, int | np.integer):
        return f"{value:,}"
    if isinstance(value, float | np.floating):
        return f"{value:.4g}" if math.isfinite(value) else "unknown"
    return "unknown" if value is None else str(value)


def plain(value: Any) -> Any:
    """The value in JSON's own types."""
    if isinstance(value, Mapping):
        return {str(name): plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def byte_size(count: float) -> str:
    """A number of bytes in a readable unit."""
    for unit in ("bytes", "kB", "MB"):
        if count < 1000:
            return f"{count:.0f} {unit}" if unit == "bytes" else f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} GB"


def spread(values: ArrayLike) -> dict[str, float] | None:
    """Median, 90th percentile and largest of the finite values; None if there are none."""
    finite = np.asarray(values, dtype=np.float64)
    finite = finite[np.isfinite(finite)]
    if not len(finite):
        return None
    middle, high = np.quantile(finite, [0.5, 0.9])
    return {"median": float(middle), "90 %": float(high), "largest": float(finite.max())}


def versions(provenance: Mapping[str, str]) -> Section:
    """Versions of the software that made a file, one value for each package."""
    return dict(sorted(provenance.items())) if provenance else {"versions": None}
