"""An experiment file, read and checked as by every verb."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from softprint.runtime.experiment import Experiment, load_experiment
from softprint.runtime.inspect.file_head import FileHead
from softprint.runtime.inspect.kind import Kind, Part
from softprint.runtime.inspect.summary import Summary


def recognise(head: FileHead) -> bool:
    return head.suffix == ".toml"


def summarise(path: Path, part: Part) -> Summary:
    experiment = load_experiment(path)
    return Summary(path, "an experiment", _sections(experiment), experiment.text)


def _sections(experiment: Experiment) -> dict[str, dict[str, Any]]:
    body, sampling = experiment.body, experiment.sampling
    points, library = body.handles.points, experiment.library
    return {
        "experiment": {
            "name": experiment.name,
            "seed": str(experiment.seed),
            "dimension": experiment.dim,
            "mesh": str(body.mesh),
            "point handles": points if isinstance(points, int) else len(points),
            "frames": [frame.name for frame in body.handles.frames],
            "material": body.material.model,
            "colliders": {spec.name: spec.shape for spec in experiment.colliders}
            | ({} if library is None else {"[library]": f"all shapes, of {library.size:g} m"}),
            "scenes": {scene.name: f"({scene.role}, {scene.duration:g} s)" for scene in experiment.scenes},
            "models to train": [
                *(model.name for model in experiment.training.models),
                *(model.name for model in experiment.training.internal),
            ],
        },
        "samples to generate": {
            "collider": sampling.collider,
            "states, places, rotations, depths": [
                sampling.states,
                sampling.places,
                sampling.rotations,
                sampling.depths,
            ],
            "contacts": experiment.planned_contacts,
            "samples": experiment.planned_contacts * sampling.depths,
        },
    }


KIND = Kind(recognise, summarise)
