"""A report that is made: its files, and whether it would be made again the same."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from softprint import fem_truth, runtime
from softprint.fem_truth.report.headline import Card, console_lines
from softprint.fem_truth.report.run_files import judged_scenes
from softprint.runtime.experiment.sources import scene_files
from softprint.runtime.io.files import content_hash, sources_hash

if TYPE_CHECKING:
    from softprint.runtime.cli.context import Context

PAGE, NUMBERS = "report.html", "report.json"
_READ = (".h5", ".safetensors", ".json")
# What reports themselves keep in the run directory.
_OWN = ("heldout", "shapes", NUMBERS)


@dataclass(frozen=True)
class MadeReport:
    """Path of the page and of the numbers, and the summary lines."""

    page: Path
    numbers: Path
    headline: list[str]

    @classmethod
    def of(cls, folder: Path, summary: Mapping[str, Any]) -> MadeReport:
        """In a run directory, with what the report says."""
        cards = [Card(**card) for card in summary["headline"]["cards"]]
        return cls(folder / PAGE, folder / NUMBERS, console_lines(summary, cards))

    @classmethod
    def kept(cls, context: Context, pictures: bool) -> MadeReport | None:
        """The report of an earlier run, if it would be made again the same; None where there is none."""
        page, numbers = context.out_dir / PAGE, context.out_dir / NUMBERS
        if not (context.resume and page.is_file() and numbers.is_file()):
            return None
        try:
            summary = json.loads(numbers.read_text(encoding="utf-8"))
        except ValueError:
            return None
        same = isinstance(summary, dict) and summary.get("inputs") == report_inputs(context, pictures)
        return cls.of(context.out_dir, summary) if same else None


def report_inputs(context: Context, pictures: bool) -> str:
    """A hash of what a report is made from: the experiment and the files that it names, the sizes and times of the
    files in the run directory, and the sources."""
    experiment, folder = context.experiment, context.out_dir
    content: dict[str, object] = {
        "pictures": pictures,
        "experiment": experiment.model_dump_json(),
        "sources": [sources_hash(Path(str(package.__file__)).parent) for package in (fem_truth, runtime)],
    }
    for scene in judged_scenes(experiment):
        content |= scene_files(experiment, scene)
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder)
        if path.suffix in _READ and name.parts[0] not in _OWN:
            found = path.stat()
            content[str(name)] = [found.st_size, found.st_mtime_ns]
    return content_hash(content)
