"""Training with a progress bar, and the file of its curves."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from softprint.runtime.cli.context import Context
from softprint.runtime.io.files import atomic_path
from softprint.runtime.learned.form import ModelT
from softprint.surrogate.learning_task import LearningTask
from softprint.surrogate.train import TrainingResult, TrainingSettings, train


def train_with_bar(
    context: Context,
    name: str,
    task: LearningTask[ModelT],
    settings: TrainingSettings,
    checkpoint: Path,
    data_name: str,
    select: bool = True,
) -> TrainingResult[ModelT]:
    """Train under a name; see `train`."""
    with context.progress(settings.steps, "step", f"training {name}") as bar:
        return train(
            task,
            settings,
            checkpoint,
            data_name,
            lambda steps, note: bar.skip(steps) if note == "resumed" else bar.update(steps, note),
            select,
        )


def write_curves(path: Path, name: str, facts: Mapping[str, Any], result: TrainingResult[ModelT]) -> None:
    """Write loss and held-out error by step, for the report. facts: `samples`, `left_out`, `noise_floor`, and the notes
    of the task."""
    curves = {
        "model": name,
        "held_out": {**asdict(result.held_out), "squared": result.held_out.squared},
        **facts,
        "history": result.history,
    }
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(curves, indent=1))
