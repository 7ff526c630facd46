"""The report's section on unseen shapes: errors by side of the split and by shape, and pictures of the worst."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from softprint import runtime
from softprint.fem_truth.report.drawing.renderings import make_renderer
from softprint.fem_truth.report.measurements.shape_errors import (
    SampleErrors,
    depth_rows,
    heaviest_place,
    left_out,
    measure_samples,
    remembered,
    shape_rows,
    sides_of,
    worst_sample,
)
from softprint.fem_truth.report.page import ShapeView
from softprint.fem_truth.report.run_files import RunFiles
from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.build import build_collider
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.io.files import file_hash, sources_hash
from softprint.runtime.learned.correction_file import TrainedCorrection, read_correction
from softprint.runtime.learned.static_correction import StaticCorrection
from softprint.runtime.shapes.catalogue import Role
from softprint.runtime.truth.truth_colliders import require_same_colliders
from softprint.runtime.truth.truth_file import TruthData

if TYPE_CHECKING:
    from softprint.runtime.cli.context import Context
    from softprint.runtime.experiment import Experiment

# Number of testing shapes shown, those with the largest errors.
WORST = 5


@dataclass(frozen=True)
class ShapeSection:
    """summary: sides (model -> side -> row), shapes (model -> shape -> row), depths (model -> `depth_rows` of testing
    shapes), heaviest (`heaviest_place` of these, None without any), worst (rows of the judged model's worst testing
    shapes), testing (names), all of them of usable samples; answered (model -> side -> row of all samples to which full
    space has an answer); left_out (side -> counts); views: pictures of each of the worst."""

    summary: dict[str, Any]
    views: list[ShapeView]


def judge_shapes(
    context: Context, files: RunFiles, body: ReducedBody, truth: TruthData, judged: str | None, pictures: bool
) -> ShapeSection | None:
    """Errors of every correction for any collider, at every sample of a library's truth that has an answer, apart for
    usable ones and all; None if there is no such correction, or if the experiment plays what another has trained and
    does not know its shapes."""

    # All colliders are cached for the next model: building one takes a second, and it needs ten megabytes.
    @cache
    def collider(name: str) -> Collider:
        return build_collider(context.experiment.collider(name), context.experiment.base_dir)

    read = {name: read_correction(path, body) for name, path in files.corrections.items()}
    trained = {name: correction for name, correction in read.items() if correction.is_for_any}
    if not trained or not truth.usable.any() or not known(truth, context.experiment):
        return None
    require_same_colliders(truth, context.experiment)
    models = {name: _OnAny(correction, body, collider) for name, correction in trained.items()}
    programs = {
        "program": sources_hash(Path(runtime.__file__).parent),
        "report": sources_hash(Path(__file__).parent),
    }
    errors = {
        name: remembered(
            files.folder / "shapes" / f"{name}.json",
            {"truth": truth.content_hash, "correction": file_hash(trained[name].path), **programs},
            partial(_measured, context, truth, body, model, name),
        )
        for name, model in models.items()
    }
    chosen = judged if judged in models else next(iter(models))
    summary = _summary(truth, errors, chosen, context.experiment.library_roles, body.mesh.points)
    views = []
    if pictures:
        with context.progress(len(summary["worst"]), "shape", "drawing the worst shapes") as bar:
            for row in summary["worst"]:
                views.append(_view(truth, body, collider(row["shape"]), models, chosen, row["sample"]))
                bar.update()
    return ShapeSection(summary, views)


def known(truth: TruthData, experiment: Experiment) -> bool:
    """Whether the experiment has all colliders of a truth."""
    return set(truth.header.colliders) <= set(experiment.collider_names)


class _OnAny:
    """A correction for any collider, bound to one collider at a time."""

    def __init__(
        self, trained: TrainedCorrection, body: ReducedBody, collider: Callable[[str], Collider]
    ) -> None:
        self._trained, self._body, self._collider = trained, body, collider

    def __call__(self, name: str) -> StaticCorrection:
        return StaticCorrection(self._trained.on(self._collider(name)), self._body)


def _measured(
    context: Context, truth: TruthData, body: ReducedBody, model: _OnAny, name: str
) -> SampleErrors:
    with context.progress(int(truth.answered.sum()), "sample", f"{name} on the library") as bar:
        return measure_samples(truth, body, model, bar.update)


def _summary(
    truth: TruthData,
    errors: dict[str, SampleErrors],
    judged: str,
    roles: Mapping[str, Role],
    points: Array,
) -> dict[str, Any]:
    training = {name for name, role in roles.items() if role != "test"}
    validation = {name for name, role in roles.items() if role == "validation"}
    usable = {name: found.take(truth.usable[found.sample]) for name, found in errors.items()}

    def by_side(found: SampleErrors) -> dict[str, Any]:
        parts = sides_of(truth, found.sample, training, validation).named()
        return {side: found.take(part).row() for side, part in parts if part.any()}

    def never_seen(found: SampleErrors) -> SampleErrors:
        return found.take(sides_of(truth, found.sample, training, validation).testing)

    shapes = {name: shape_rows(truth, found) for name, found in usable.items()}
    testing = [shape for shape in shapes[judged] if shape not in training]
    worst = sorted(testing, key=lambda shape: -shapes[judged][shape]["squared"])[:WORST]
    every = np.arange(truth.n_samples)
    return {
        "judged": judged,
        "sides": {name: by_side(found) for name, found in usable.items()},
        "answered": {name: by_side(found) for name, found in errors.items()},
        "left_out": {
            side: left_out(truth, every[part])
            for side, part in sides_of(truth, every, training, validation).named()
            if part.any()
        },
        "shapes": shapes,
        "depths": {name: depth_rows(truth, never_seen(found)) for name, found in usable.items()},
        "heaviest": heaviest_place(truth, {name: never_seen(found) for name, found in usable.items()}, points)
        if testing
        else None,
        "testing": testing,
        "worst": [
            {
                "shape": shape,
                "sample": worst_sample(truth, usable[judged], shape),
                **{
                    key: shapes[judged][shape][key]
                    for key in ("squared", "rms", "whole_squared", "whole_rms", "worst")
                },
            }
            for shape in worst
        ],
        "contacts": {
            side: int(np.unique(truth.samples["contact"][usable[judged].sample[part]]).size)
            for side, part in sides_of(truth, usable[judged].sample, training, validation).named()
        },
    }


def _view(
    truth: TruthData,
    body: ReducedBody,
    collider: Collider,
    models: dict[str, _OnAny],
    judged: str,
    sample: int,
) -> ShapeView:
    """Full space, the subspace with its exact internal displacement, and the judged model, at one sample."""
    state, pose = truth.sample_state[sample], truth.pose(sample)
    rows = truth.states["rows"][state]
    settled = body.reduced_positions(rows) + truth.states["internal"][state]
    full = settled + truth.displacement(sample)
    model = models[judged](collider.name)
    ours = body.reduced_positions(rows) + model.condensed_displacement(rows)
    ours += model.displacement_along(rows, truth.approach_path(sample))
    surface = body.mesh.surface_nodes
    deepest = full[surface[int(np.argmin(collider.sdf(pose.apply_inverse(full[surface]))))]]
    renderer = make_renderer(body.mesh, collider, pose)
    what = f"{collider.name}, sample {sample}"
    views = []
    for name, x in (("full", full), ("bare", settled), (judged, ours)):
        picture = renderer.cut(x, pose, deepest, f"{what}: {name}, cut open through the contact")
        views.append((name, picture or renderer.outside(x, pose, f"{what}: {name}")))
    return ShapeView(renderer.outside(full, pose, f"{what}: the body and the collider"), views)
