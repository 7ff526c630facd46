"""verify.json: the results of `softprint verify`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from softprint.runtime.errors import SoftprintError
from softprint.runtime.inspect.file_head import FileHead
from softprint.runtime.inspect.kind import Kind, Part
from softprint.runtime.inspect.summary import Summary, versions


def recognise(head: FileHead) -> bool:
    return head.suffix == ".json" and "softprint_verification" in head.keys


def summarise(path: Path, part: Part) -> Summary:
    """Verdicts, and every figure that failed."""
    found = json.loads(path.read_text(encoding="utf-8"))
    try:
        sections: dict[str, dict[str, Any]] = {
            "verification": {
                "passed": found["passed"],
                "quick": found["quick"],
                "cases": {case["name"]: _verdict(case) for case in found["cases"]},
            },
            **{case["name"]: _failures(case) for case in found["cases"] if not case["passed"]},
            "machine": dict(found["machine"]),
            "made with": dict(versions(found["versions"])),
        }
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise SoftprintError(f"{path}: the verification is incomplete ({error}): make it again") from error
    return Summary(path, "a verification of the solvers", sections)


def _verdict(case: dict[str, Any]) -> str:
    rows = case["rows"]
    return f"{'passed' if case['passed'] else 'failed'}, {sum(row['passed'] for row in rows)} of {len(rows)} numbers"


def _failures(case: dict[str, Any]) -> dict[str, Any]:
    failures = {"did not finish": case["failure"]} if case["failure"] else {}
    return failures | {
        row["quantity"]: f"{row['ours']} instead of {row['reference']} {row['unit']}".rstrip()
        for row in case["rows"]
        if not row["passed"]
    }


KIND = Kind(recognise, summarise)
