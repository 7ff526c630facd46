"""Trains all models of an experiment, one after the other, on the truth file of its run directory."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.run_mechanics import RunMechanics
from softprint.runtime.colliders.build import build_collider
from softprint.runtime.colliders.shape_samples import shape_samples
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.experiment import ANY_COLLIDER
from softprint.runtime.experiment.schema.training import ModelSpec
from softprint.runtime.learned.correction_file import save_correction
from softprint.runtime.learned.form import find_form
from softprint.runtime.scenes.playing import correction_path
from softprint.runtime.truth.truth_colliders import require_same_colliders, require_same_loads
from softprint.runtime.truth.truth_file import TruthData, load_truth
from softprint.surrogate.checkpoints import Checkpoints
from softprint.surrogate.cross_validation import train_crossed, untrained
from softprint.surrogate.data.training_data import TrainingData
from softprint.surrogate.internal.run import train_internals
from softprint.surrogate.kept_corrections import is_trained, program_hash, recipe_of
from softprint.surrogate.learning_task import LearningTask
from softprint.surrogate.registry import TRAININGS, training_settings
from softprint.surrogate.train import TrainingResult
from softprint.surrogate.training_bar import train_with_bar, write_curves


def train_models(context: Context, names: Sequence[str] | None) -> None:
    """Train the models of the experiment with these names, by default all. Models already trained with this truth,
    these mechanics and these settings are skipped."""
    training, path = context.experiment.training, context.experiment.path
    known = [model.name for model in training.models] + [model.name for model in training.internal]
    unknown = sorted(set(names or ()) - set(known))
    if unknown or not known:
        asked = f"no model named {unknown[0]!r}" if unknown else "no models"
        there = ", ".join(known) or "none"
        raise SoftprintError(
            f"{path}: {asked} in [[training.models]] or [[training.internal]]; there: {there}"
        )
    wanted = known if names is None else names
    models = [model for model in training.models if model.name in wanted]
    internal = [model for model in training.internal if model.name in wanted]
    body = body_of_run(context)
    with load_truth(context.out_dir / "truth.h5", body) as truth:
        require_same_loads(truth, context.experiment)
        if internal:
            train_internals(context, internal, body, truth)
        if models:
            _train_of_contact(context, models, body, truth)


def _train_of_contact(
    context: Context, specs: Sequence[ModelSpec], body: ReducedBody, truth: TruthData
) -> None:
    mechanics = RunMechanics(context, body)
    wanted = [
        spec
        for spec in specs
        if not (context.resume and is_trained(context, spec, truth.content_hash, mechanics))
    ]
    if not wanted:
        context.say("all corrections are up to date.")
        return
    require_same_colliders(truth, context.experiment)
    data = TrainingData(truth, body, context, mechanics)
    context.say(
        f"{len(data.split.train)} training samples, {len(data.split.validation)} held-out samples; "
        f"{data.split.left_out} left out (not converged, after a jump, pierced, or with inverted cells); "
        f"label-noise floor {truth.noise_floor:.3g}"
    )
    for spec in wanted:
        _train_one(data, spec)


def _train_one(data: TrainingData, spec: ModelSpec) -> None:
    """Train a model and write the correction and its curves."""
    context, form, path = data.context, find_form(spec.form), correction_path(data.context.out_dir, spec.name)
    experiment, truth_hash = context.experiment, data.truth.content_hash
    recipe = recipe_of(experiment, spec, truth_hash, context.out_dir)
    checkpoints = Checkpoints(path)
    if not context.resume:
        checkpoints.remove()
    settings = training_settings(experiment.training, spec.form, experiment.seed)

    def train_one(
        part: str, task: LearningTask[Any], share: float, select: bool = False
    ) -> TrainingResult[Any]:
        name = f"{spec.name}, {part}" if part else spec.name
        key = json.dumps([recipe, part], sort_keys=True)
        own = replace(settings, steps=math.ceil(share * settings.steps))
        return train_with_bar(context, name, task, own, checkpoints.path(part), key, select)

    started, training = time.perf_counter(), TRAININGS[spec.form]
    if training.crossed is not None:
        crossed = training.crossed(data, spec)
        learns = spec.learned or not form.needs_mechanics
        result = train_crossed(crossed, train_one) if learns else untrained(crossed, experiment.seed)
        count, notes = crossed.whole.n_samples, crossed.notes
    else:
        task = training.task(data, spec)
        result = train_one("", task, 1.0, select=True)
        count, notes = len(data.split.train), task.notes
    seconds = time.perf_counter() - started
    facts = {"noise_floor": data.truth.noise_floor, "samples": count}
    facts |= {"left_out": data.split.left_out, **notes}
    write_curves(path.with_suffix(".json"), spec.name, facts, result)
    save_correction(
        path,
        spec.name,
        result.model.cpu(),
        data.body,
        data.collider,
        truth_hash,
        result.held_out.rms,
        {**recipe, "program": program_hash(), "seconds": seconds, "samples": count},
        data.mechanics.get(spec.contact_nodes)[0].content_hash if form.needs_mechanics else "",
        _shape(data),
    )
    checkpoints.remove()
    kept = f", {notes['kept']['part']:.0%} of the network kept" if "kept" in notes else ""
    context.say(
        f"{path} written: held-out error {result.held_out.rms:.1%} (squared {result.held_out.squared:.1%}){kept}, "
        f"{seconds:.0f} s"
    )


def _shape(data: TrainingData) -> Array | None:
    """Of the collider that the corrections are for, None if they are for any."""
    experiment = data.context.experiment
    if data.collider == ANY_COLLIDER:
        return None
    return shape_samples(build_collider(experiment.collider(data.collider), experiment.base_dir))
