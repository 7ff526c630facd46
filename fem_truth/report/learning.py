"""What training left in the run directory: headers of the corrections, their curves, and the ablation table."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from runtime.errors import SoftprintError


@dataclass(frozen=True)
class Learning:
    """names: of the corrections; histories: model -> column -> values; held_out: model -> its error on held-out states;
    ablation and benchmarks: tables with `columns` and `rows`."""

    names: Sequence[str] = ()
    histories: Mapping[str, Mapping[str, Sequence[float]]] = field(default_factory=dict)
    headers: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    ablation: Mapping[str, Any] | None = None
    benchmarks: Sequence[Mapping[str, Any]] = ()

    def summary(self) -> dict[str, Any]:
        """For the JSON."""
        held_out = {
            name: {key: value for key, value in header["held_out"].items() if key != "samples"}
            for name, header in self.headers.items()
            if header.get("held_out")
        }
        columns = list(dict.fromkeys(key for values in held_out.values() for key in values))
        return {
            "training": dict(self.histories),
            "corrections": dict(self.headers),
            "held_out_states": held_out,
            "held_out_columns": columns,
            "ablation": self.ablation,
            "benchmarks": list(self.benchmarks),
        }


def table_of(records: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """Records as columns (in order of appearance) and rows; None where there is no record."""
    columns = list(dict.fromkeys(key for record in records for key in record))
    rows = [{column: record.get(column) for column in columns} for record in records]
    return {"columns": columns, "rows": rows} if rows else None


def columns_of(records: Sequence[Mapping[str, float]]) -> dict[str, list[float]]:
    """A list of records with the same keys, as one list for each key."""
    return {key: [record[key] for record in records] for key in records[0]} if records else {}


def read_json(path: Path) -> Any:
    """The content of a JSON file; SoftprintError where it is damaged."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SoftprintError(f"{path}: not readable as JSON ({error}): make it again") from error


def existing(paths: Iterable[Path]) -> list[Path]:
    return [path for path in paths if path.is_file()]
