"""All models of an experiment, trained one after the other from the truth file of its run directory."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from runtime.body.body import ReducedBody
from runtime.cli.context import Context
from runtime.cli.run_body import body_of_run
from runtime.colliders.build import build_collider
from runtime.colliders.collider import Collider
from runtime.corrections.correction_file import read_header, save_correction
from runtime.corrections.model import ModelOptions
from runtime.errors import SoftprintError
from runtime.experiment import Experiment
from runtime.experiment.training_schema import ModelSpec, TrainingSpec
from runtime.files import atomic_path
from runtime.truth_file import TruthData, load_truth
from surrogate.dataset import ContactDataset, PoolSize, Split, load_dataset, split_by_state
from surrogate.train import TrainingResult, TrainingSettings, train


@dataclass(frozen=True, eq=False)
class Material:
    """What is learned from: the truth's identity, the split, and both data sets on the training device."""

    truth_hash: str
    noise_floor: float
    split: Split
    training: ContactDataset
    validation: ContactDataset


def model_options(spec: ModelSpec) -> ModelOptions:
    """The architecture that a [[training.models]] table asks for."""
    return ModelOptions(
        encoding=spec.encoding,
        patch_inputs=spec.patch_inputs,
        widths=spec.hidden,
        activation=spec.activation,
        fade=spec.fade,
        fade_depth=spec.fade_depth,
    )


def training_settings(spec: TrainingSpec, seed: int) -> TrainingSettings:
    """The settings of a [training] table."""
    return TrainingSettings(
        steps=spec.steps,
        batch=spec.batch,
        learning_rate=spec.learning_rate,
        weight_decay=spec.weight_decay,
        edge_weight=spec.edge_weight,
        validations=spec.validations,
        seed=seed,
    )


def training_device(name: str) -> torch.device:
    """The device of that name. Raises SoftprintError where there is none."""
    if name == "cuda" and not torch.cuda.is_available():
        raise SoftprintError('training.device = "cuda", but torch finds no CUDA device here: use "cpu"')
    return torch.device(name)


def read_material(
    truth: TruthData, body: ReducedBody, collider: Collider, spec: TrainingSpec, seed: int, context: Context
) -> Material:
    """Both data sets of a truth file."""
    split = split_by_state(truth, collider.name, spec.validation_states)
    rng = np.random.default_rng(seed)
    held_out = rng.permutation(split.validation)[: spec.validation_samples]
    device = training_device(spec.device)
    with context.progress(len(split.train) + len(held_out), "sample", "reading truth") as bar:
        size = PoolSize(spec.nodes, spec.edges)
        training = load_dataset(truth, body, collider, split.train, size, rng, bar.update)
        validation = load_dataset(truth, body, collider, np.sort(held_out), None, rng, bar.update)
    return Material(truth.content_hash, truth.noise_floor, split, training.to(device), validation.to(device))


def train_models(context: Context, only: str | None) -> None:
    """Train every model of the experiment, or the one named, unless it is there for this truth and these settings."""
    experiment = context.experiment
    specs = [model for model in experiment.training.models if only in (None, model.name)]
    if not specs:
        known = ", ".join(model.name for model in experiment.training.models) or "none"
        asked = f"no model named {only!r}" if only else "no models"
        raise SoftprintError(f"{experiment.path}: {asked} in [[training.models]]; there: {known}")
    body = body_of_run(context)
    collider = build_collider(experiment.collider(experiment.training.collider), experiment.base_dir)
    with load_truth(context.out_dir / "truth.h5", body) as truth:
        recipes = {spec.name: _recipe(experiment, spec, truth.content_hash) for spec in specs}
        wanted = [spec for spec in specs if not (context.resume and _is_done(context, spec.name, recipes[spec.name]))]
        if not wanted:
            context.say("all corrections are up to date.")
            return
        material = read_material(truth, body, collider, experiment.training, experiment.seed, context)
    split = material.split
    context.say(
        f"{len(material.training)} samples to learn from, {len(material.validation)} of held-out states; "
        f"{split.left_out} not converged or after a jump; label-noise floor {material.noise_floor:.3g}"
    )
    for spec in wanted:
        _train_one(context, spec, material, body, collider, recipes[spec.name])


def _train_one(
    context: Context,
    spec: ModelSpec,
    material: Material,
    body: ReducedBody,
    collider: Collider,
    recipe: dict[str, object],
) -> None:
    experiment, path = context.experiment, _path(context, spec.name)
    settings = training_settings(experiment.training, experiment.seed)
    checkpoint = path.with_suffix(".checkpoint")
    if not context.resume:
        checkpoint.unlink(missing_ok=True)
    started = time.perf_counter()
    with context.progress(settings.steps, "step", f"training {spec.name}") as bar:
        result = train(
            model_options(spec),
            material.training,
            material.validation,
            settings,
            checkpoint,
            material.truth_hash,
            lambda steps, note: bar.skip(steps) if note == "resumed" else bar.update(steps, note),
        )
    _write_curves(path.with_suffix(".json"), spec.name, result, material)
    training = {**recipe, "seconds": time.perf_counter() - started, "samples": len(material.training)}
    save_correction(
        path,
        spec.name,
        result.model,
        body,
        collider.name,
        material.truth_hash,
        result.held_out.rms,
        training,
    )
    checkpoint.unlink(missing_ok=True)
    context.say(
        f"{path} written: held-out error {result.held_out.rms:.1%} (energy {result.held_out.squared:.1%}), "
        f"{time.perf_counter() - started:.0f} s"
    )


def _path(context: Context, name: str) -> Path:
    return context.out_dir / "corrections" / f"{name}.safetensors"


def _recipe(experiment: Experiment, spec: ModelSpec, truth_hash: str) -> dict[str, object]:
    """All that decides what comes out of training."""
    settings = training_settings(experiment.training, experiment.seed)
    pool = {"nodes": experiment.training.nodes, "edges": experiment.training.edges}
    return {
        "truth": truth_hash,
        "options": model_options(spec).to_json(),
        "settings": {**vars(settings), **pool, "validation_states": experiment.training.validation_states},
    }


def _is_done(context: Context, name: str, recipe: dict[str, object]) -> bool:
    path = _path(context, name)
    if not path.is_file():
        return False
    found = read_header(path).training
    return {key: found.get(key) for key in recipe} == json.loads(json.dumps(recipe))


def _write_curves(path: Path, name: str, result: TrainingResult, material: Material) -> None:
    """Loss and held-out error along the run, for the report."""
    curves = {
        "model": name,
        "held_out_rms": result.held_out.rms,
        "held_out_squared": result.held_out.squared,
        "held_out_worst": result.held_out.worst,
        "noise_floor": material.noise_floor,
        "samples": len(material.training),
        "validation_samples": len(material.validation),
        "left_out": material.split.left_out,
        "history": result.history,
    }
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(curves, indent=1))
