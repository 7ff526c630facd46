"""report.json: the figures of a report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from softprint.runtime.errors import SoftprintError
from softprint.runtime.inspect.file_head import FileHead
from softprint.runtime.inspect.kind import Kind, Part
from softprint.runtime.inspect.summary import Summary, versions

_REPORT = "softprint_report"


def recognise(head: FileHead) -> bool:
    return head.suffix == ".json" and _REPORT in head.keys


def summarise(path: Path, part: Part) -> Summary:
    """Headline and errors of a report; SoftprintError if a required part is missing."""
    report = json.loads(path.read_text(encoding="utf-8"))
    try:
        return Summary(path, "a report", _sections(report), report["experiment"]["text"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise SoftprintError(f"{path}: the report is incomplete ({error}): make it again") from error


def _sections(report: dict[str, Any]) -> dict[str, dict[str, Any]]:
    body = report["body"]
    sections: dict[str, dict[str, Any]] = {
        "report": {
            "experiment": report["experiment"]["name"],
            "made": report["made"],
            "body": f"{body['name']}, {body['nodes']:,} nodes, {body['cells']:,} cells",
            "scenes": [scene["name"] for scene in report["scenes"]],
        },
        "headline": {
            f"{card['label']}": _figure(card) for card in (report["headline"] or {}).get("cards", [])
        },
        "error left, of the bare subspace's": {
            name: row["relative_rms"] for name, row in report["errors"].items() if "relative_rms" in row
        },
        "notes": {str(number + 1): note for number, note in enumerate(report["notes"])},
        "hashes of files": {entry["name"]: entry["hash"] for entry in report["files"]},
        "made with": {"seed": str(report["experiment"]["seed"]), **versions(report["versions"])},
    }
    return {title: section for title, section in sections.items() if section}


def _figure(card: dict[str, Any]) -> str:
    value, style = float(card["value"]), card["style"]
    return (
        f"{100 * value:.3g} %"
        if style == "percent"
        else f"{value:.3g}" + (" times" if style == "times" else "")
    )


KIND = Kind(recognise, summarise)
