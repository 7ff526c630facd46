"""Training results in the run directory: headers of the corrections, their training curves, and the ablation
table."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.correction_file import CorrectionHeader, read_header
from softprint.runtime.learned.internal.file import InternalHeader, read_internal_header

# The columns that `softprint bench` writes for a measurement; files of earlier versions have fewer.
_CONDITIONS = ("scene", "tolerance", "iterations", "cores_used", "time_step", "machine")


@dataclass(frozen=True)
class Learning:
    """Training results of the corrections of a run, by name.

    headers: the headers of their files; curves: the JSON files that training wrote beside them (`history` and errors
    on held-out states); ablation, benchmarks: tables with `columns` and `rows`, see `read_table`."""

    headers: Mapping[str, CorrectionHeader | InternalHeader] = field(default_factory=dict)
    curves: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    ablation: Mapping[str, Any] | None = None
    benchmarks: Sequence[Mapping[str, Any]] = ()

    @property
    def histories(self) -> dict[str, dict[str, list[float]]]:
        """model -> column (step, loss, validation_rms, ...) -> values."""
        return {
            name: columns_of(curves["history"]) for name, curves in self.curves.items() if curves["history"]
        }

    def summary(self) -> dict[str, Any]:
        """For the JSON. Held-out errors are relative to the contact displacement; see `correction_file`."""
        return {
            "training": self.histories,
            "corrections": {name: asdict(header) for name, header in self.headers.items()},
            "held_out_states": {name: self._held_out(name) for name in self.headers},
            "ablation": self.ablation,
            "benchmarks": list(self.benchmarks),
        }

    def _held_out(self, name: str) -> dict[str, Any]:
        header, curves = self.headers[name], self.curves.get(name, {})
        held_out = curves.get("held_out", {})
        return {
            "rms": header.held_out_rms,
            "squared": header.held_out_rms**2,
            "worst": held_out.get("worst"),
            "samples": header.training.get("samples"),
            "validation_samples": held_out.get("samples"),
            "seconds": header.training.get("seconds"),
        }


def table_of(records: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Records as columns (in order of appearance) and rows."""
    records = [_flat(record) for record in records]
    columns = list(dict.fromkeys(key for record in records for key in record))
    rows = [{column: record.get(column) for column in columns} for record in records]
    return {"columns": columns, "rows": rows}


def _flat(record: Mapping[str, Any]) -> dict[str, Any]:
    """Nested tables in a record become separate columns."""
    flat: dict[str, Any] = {}
    for key, value in record.items():
        if isinstance(value, Mapping):
            flat |= {f"{key} {inner}": item for inner, item in value.items()}
        else:
            flat[key] = value
    return flat


def columns_of(records: Sequence[Mapping[str, float]]) -> dict[str, list[float]]:
    """A list of records with the same keys, as one list per key."""
    return {key: [record[key] for record in records] for key in records[0]} if records else {}


def read_json(path: Path) -> Any:
    """The content of a JSON file. Raises SoftprintError if it is damaged."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SoftprintError(f"{path}: not readable as JSON ({error}): remove it, or make it again") from error


def load_learning(
    corrections: Mapping[str, Path], folder: Path, internal: Mapping[str, Path] | None = None
) -> Learning:
    """Read the headers and curves of the corrections and internal corrections, and ablation.json and bench*.json of
    the run directory."""
    internal = internal or {}
    curves = {name: path.with_suffix(".json") for name, path in {**corrections, **internal}.items()}
    ablation = folder / "ablation.json"
    return Learning(
        headers={name: read_header(path) for name, path in corrections.items()}
        | {name: read_internal_header(path) for name, path in internal.items()},
        curves={name: read_curves(path) for name, path in curves.items() if path.is_file()},
        ablation=read_table(ablation) if ablation.is_file() else None,
        benchmarks=[
            {"name": path.stem.replace("_", " "), **read_table(path)}
            for path in sorted(folder.glob("bench*.json"))
        ],
    )


def read_curves(path: Path) -> dict[str, Any]:
    """The training curves beside a correction: an object with `history`, a list of records of numbers with
    the same keys."""
    content = read_json(path)
    history = content.get("history") if isinstance(content, dict) else None
    if not (
        isinstance(history, list)
        and all(
            isinstance(record, dict) and {"step", "loss", "validation_rms"} <= {*record} for record in history
        )
        and all(isinstance(value, int | float) for record in history for value in record.values())
        and all(record.keys() == history[0].keys() for record in history)
        and isinstance(content.get("held_out", {}), dict)
    ):
        raise SoftprintError(
            f"{path}: does not contain training curves: train the model again, or remove the file"
        )
    return dict(content)


def read_table(path: Path) -> dict[str, Any]:
    """A table from a JSON file that holds a list of records, or an object with such a list under `rows`
    or `speeds` (what `softprint bench` writes, with the `conditions` that it measured under)."""
    content = read_json(path)
    records = content.get("rows", content.get("speeds")) if isinstance(content, dict) else content
    if (
        not isinstance(records, list)
        or not records
        or not all(isinstance(record, dict) for record in records)
    ):
        raise SoftprintError(
            f"{path}: expected a list of records, or an object with such a list under `rows`"
        )
    table = table_of(records)
    if isinstance(content, dict) and "speeds" in content:
        table["conditions"] = {name: content.get(name) for name in _CONDITIONS}
    return table
