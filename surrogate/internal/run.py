"""Trains the internal corrections of an experiment, one after the other, on the truth file of its run directory."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from softprint.runtime.body.body import ReducedBody
from softprint.runtime.cli.context import Context
from softprint.runtime.experiment import InternalSpec
from softprint.runtime.learned.internal.correction import InternalCorrection
from softprint.runtime.learned.internal.file import InternalHeader, read_internal_header, save_internal
from softprint.runtime.learned.internal.model import InternalModel, InternalOptions, QuadraticModel
from softprint.runtime.mechanics.compliance.null_space_compliance import NullSpaceCompliance
from softprint.runtime.mechanics.static_condensation import StaticCondensation, compute_static_condensation
from softprint.runtime.scenes.corrected_body import internal_path
from softprint.runtime.truth.truth_file import TruthData
from softprint.surrogate.internal.cubature import fitted_cubature
from softprint.surrogate.internal.data import InternalData, read_internal_data
from softprint.surrogate.internal.modes import evaluations as modes_evaluations
from softprint.surrogate.internal.modes import find_modes
from softprint.surrogate.internal.quadratic import fit_quadratic
from softprint.surrogate.internal.slope_data import evaluations, read_slope_data
from softprint.surrogate.internal.slope_task import SlopeTask
from softprint.surrogate.internal.slopes import EquilibriumSlopes
from softprint.surrogate.internal.task import InternalTask
from softprint.surrogate.kept_corrections import kept_header, program_hash
from softprint.surrogate.learning_task import LearningTask
from softprint.surrogate.train import TrainingResult, TrainingSettings
from softprint.surrogate.training_bar import train_with_bar, write_curves

ModelT = TypeVar("ModelT", InternalModel, QuadraticModel)


def train_internals(
    context: Context, specs: Sequence[InternalSpec], body: ReducedBody, truth: TruthData
) -> None:
    """Train these internal corrections; those already trained with this truth and these settings are skipped."""
    wanted = [spec for spec in specs if not (context.resume and _is_trained(context, spec, truth))]
    if not wanted:
        context.say("all internal corrections are up to date.")
        return
    condensation = None
    if any(spec.on == "condensation" for spec in wanted):
        with context.stage("static condensation"):
            gravity = context.experiment.dynamics.gravity
            condensation = compute_static_condensation(body, gravity, NullSpaceCompliance(body))
    for spec in wanted:
        if spec.equilibrium:
            _find_modes(context, spec, body, truth)
            continue
        on = condensation if spec.on == "condensation" else None
        make = _fit_one if spec.quadratic else _train_one
        make(context, spec, body, truth, on)


def _find_modes(context: Context, spec: InternalSpec, body: ReducedBody, truth: TruthData) -> None:
    """Find the modes of a correction in elastic equilibrium and write them."""
    path, started = internal_path(context.out_dir, spec.name), time.perf_counter()
    data = read_internal_data(truth, body, None, context.seed)
    with context.progress(modes_evaluations(data), "state", f"modes of {spec.name}") as bar:
        found = find_modes(truth, body, data, spec.components, spec.cubature, context.seed, bar.update)
    seconds, own = time.perf_counter() - started, found.cubature
    facts: dict[str, Any] = {"samples": len(data.train), "left_out": 0, "noise_floor": None}
    facts |= {"discarded": found.discarded, "unsolved": found.unsolved, "cubature_cells": len(own.cells)}
    write_curves(path.with_suffix(".json"), spec.name, facts, TrainingResult(found.model, found.held_out, []))
    recipe = _recipe(context, spec, truth)
    training = {**recipe, "program": program_hash(), "seconds": seconds, "samples": len(data.train)}
    cubature = None if spec.cubature is None else own
    save_internal(path, found.model, body, truth.content_hash, found.held_out.rms, training, cubature)
    if found.unsolved:
        context.say(
            f"{spec.name}: amplitudes were not found in {found.unsolved} held-out states: give more cells"
        )
    context.say(
        f"{path} written: {len(data.train)} states, {spec.components} modes, {len(own.cells)} cubature cells with a "
        f"force error of {own.force_error:.1%}, held-out error {found.held_out.rms:.1%}, {found.discarded:.1e} of the "
        f"energy beyond the modes, {seconds:.0f} s"
    )


def _fit_one(
    context: Context,
    spec: InternalSpec,
    body: ReducedBody,
    truth: TruthData,
    condensation: StaticCondensation | None,
) -> None:
    """Fit a quadratic correction and write it."""
    started, data = time.perf_counter(), read_internal_data(truth, body, condensation, context.seed)
    with context.progress(evaluations(data), "state", f"derivatives for {spec.name}") as bar:
        fitted = fit_quadratic(truth, body, data, condensation, spec.components, context.seed, bar.update)
    result = TrainingResult(fitted.model, fitted.held_out, [])
    facts = {"discarded": fitted.discarded}
    _write(context, spec, body, truth, condensation, data, result, facts, started)


def _train_one(
    context: Context,
    spec: InternalSpec,
    body: ReducedBody,
    truth: TruthData,
    condensation: StaticCondensation | None,
) -> None:
    """Train a correction and write it with its curves."""
    data = read_internal_data(truth, body, condensation, context.seed)
    options = InternalOptions(
        spec.hidden, spec.components, spec.linear, condensation is not None, data.gravity
    )
    task: LearningTask[InternalModel]
    if spec.derivatives:
        with context.progress(evaluations(data), "state", f"derivatives for {spec.name}") as bar:
            slopes = EquilibriumSlopes(body, condensation)
            learned = read_slope_data(truth, body, data, slopes, spec.components, context.seed, bar.update)
        task = SlopeTask(options, data, learned, body.n_rows)
    else:
        task = InternalTask(options, data, body.n_rows)
    settings = TrainingSettings(
        spec.steps, spec.batch, spec.learning_rate, spec.weight_decay, spec.validations, context.seed
    )
    checkpoint = internal_path(context.out_dir, spec.name).with_suffix(".checkpoint")
    if not context.resume:
        checkpoint.unlink(missing_ok=True)
    started, recipe = time.perf_counter(), json.dumps(_recipe(context, spec, truth), sort_keys=True)
    result = train_with_bar(context, spec.name, task, settings, checkpoint, recipe)
    _write(context, spec, body, truth, condensation, data, result, task.notes, started)
    checkpoint.unlink(missing_ok=True)


def _write(
    context: Context,
    spec: InternalSpec,
    body: ReducedBody,
    truth: TruthData,
    condensation: StaticCondensation | None,
    data: InternalData,
    result: TrainingResult[ModelT],
    notes: Mapping[str, Any],
    started: float,
) -> None:
    """Write a correction with its curves and, where it is to have one, its cubature. started: when its training began,
    by `time.perf_counter`."""
    path, seconds = internal_path(context.out_dir, spec.name), time.perf_counter() - started
    facts: dict[str, Any] = {"samples": len(data.train), "left_out": 0, "noise_floor": None, **notes}
    cubature = None
    if spec.cubature is not None:
        with context.stage(f"cubature of {spec.name}"):
            internal, rows = InternalCorrection(result.model, body), truth.states["rows"]
            cubature, (energy, force) = fitted_cubature(
                body,
                internal,
                condensation,
                rows[data.train],
                rows[data.held_out],
                spec.cubature,
                np.random.default_rng(context.seed),
            )
        facts["cubature"] = {
            "cells": len(cubature.cells),
            "force_error": cubature.force_error,
            "energy_error": cubature.energy_error,
            "cells_of_body": len(body.cubature.cells),
            "force_error_of_body": force,
            "energy_error_of_body": energy,
        }
        context.say(
            f"{spec.name}: {len(cubature.cells)} cubature cells, force error {cubature.force_error:.1%} in held-out "
            f"states; {len(body.cubature.cells)} of the body, {force:.1%}"
        )
    write_curves(path.with_suffix(".json"), spec.name, facts, result)
    recipe = _recipe(context, spec, truth)
    training = {**recipe, "program": program_hash(), "seconds": seconds, "samples": len(data.train)}
    save_internal(path, result.model, body, truth.content_hash, result.held_out.rms, training, cubature)
    context.say(
        f"{path} written: {len(data.train)} states, held-out error {result.held_out.rms:.1%}, "
        f"{notes['discarded']:.1e} of the energy beyond the components, {seconds:.0f} s"
    )


def _is_trained(context: Context, spec: InternalSpec, truth: TruthData) -> bool:
    path = internal_path(context.out_dir, spec.name)
    header: InternalHeader | None = kept_header(path, _recipe(context, spec, truth), read_internal_header)
    return header is not None


def _recipe(context: Context, spec: InternalSpec, truth: TruthData) -> dict[str, object]:
    """Everything that determines the result of training."""
    return {
        "truth": truth.content_hash,
        "model": spec.model_dump(mode="json"),
        "gravity": list(context.experiment.dynamics.gravity),
        "seed": context.seed,
    }
