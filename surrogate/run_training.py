"""All models of an experiment, trained one after the other from the truth file of its run directory."""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict
from functools import cached_property
from pathlib import Path

import numpy as np
import torch

import runtime
from runtime.arrays import IntArray
from runtime.body.body import ReducedBody
from runtime.cli.context import Context
from runtime.cli.run_body import body_of_run
from runtime.colliders.build import build_collider
from runtime.colliders.collider import Collider
from runtime.errors import SoftprintError
from runtime.experiment import Experiment
from runtime.experiment.experiment import ANY_COLLIDER, LIBRARY
from runtime.experiment.training_schema import (
    DescriptorTrainingSpec,
    FieldTrainingSpec,
    ModelSpec,
    TrainingSpec,
)
from runtime.io.files import atomic_path, content_hash, sources_hash
from runtime.learned.correction_file import as_saved, read_header, save_correction
from runtime.learned.force.model import ForceModelOptions
from runtime.learned.options import contact_centric_options, descriptor_model_options, force_model_options
from runtime.learned.thesis6.descriptors import handle_spacing
from runtime.learned.thesis6.model import DescriptorModelOptions
from runtime.mechanics.body_mechanics import BodyMechanics, compute_mechanics
from runtime.mechanics.surface_compliance import n_columns
from runtime.scenes.playing import trained_models
from runtime.truth.truth_colliders import require_same_colliders
from runtime.truth.truth_file import TruthData, load_truth
from surrogate.dataset import ContactDataset, PoolSize, load_dataset
from surrogate.descriptor_data import DescriptorData, Drawing, join_descriptor_data, load_descriptor_data
from surrogate.descriptor_task import DescriptorLoss, DescriptorTask
from surrogate.joined_loads import join_force_data
from surrogate.kept_mechanics import kept_mechanics
from surrogate.load_task import ForceData, ForceMetric, ForceTask, read_force_data
from surrogate.splits import Split, split_by_shape, split_by_state
from surrogate.tasks import FieldTask, InputGains, LearningTask, ModelT
from surrogate.train import TrainingResult, TrainingSettings, train

log = logging.getLogger(__name__)


def training_settings(spec: TrainingSpec, form: str, seed: int) -> TrainingSettings:
    """The settings of a [training] table for models of one form."""
    own: dict[str, FieldTrainingSpec | DescriptorTrainingSpec | TrainingSpec]
    own = {"field": spec.field, "descriptor": spec.descriptor}
    chosen = own.get(form, spec)
    return TrainingSettings(
        steps=chosen.steps,
        batch=chosen.batch,
        learning_rate=chosen.learning_rate,
        weight_decay=chosen.weight_decay,
        validations=chosen.validations,
        seed=seed,
    )


def training_device(name: str) -> torch.device:
    """The device of that name. Raises SoftprintError where there is none."""
    if name == "cuda" and not torch.cuda.is_available():
        raise SoftprintError('training.device = "cuda", but torch finds no CUDA device here: use "cpu"')
    return torch.device(name)


class Lessons:
    """What a truth file teaches: the split, and the data of each form of model, read when first asked for."""

    def __init__(self, truth: TruthData, body: ReducedBody, context: Context) -> None:
        self.truth, self.body, self._context = truth, body, context
        self._spec = spec = context.experiment.training
        if spec.collider == LIBRARY:
            self.split: Split = split_by_shape(truth, spec.validation_states)
            self.collider = ANY_COLLIDER
        else:
            self.split = split_by_state(truth, spec.collider, spec.validation_states)
            self.collider = spec.collider
        held_out = np.random.default_rng(context.seed).permutation(self.split.validation)
        self.held_out = np.sort(held_out[: spec.validation_samples])
        self._device = training_device(spec.device)
        self._mechanics: dict[int, BodyMechanics] = {}
        self._metric: dict[int, ForceMetric] = {}
        self._colliders: dict[str, Collider] = {}
        self._load_data: dict[tuple[int, bool, float, float], tuple[ForceMetric, ForceData, ForceData]] = {}

    @cached_property
    def fields(self) -> tuple[ContactDataset, ContactDataset]:
        """Training and validation data of field models."""
        spec, rng = self._spec, np.random.default_rng(self._context.seed)
        collider = self._build(self.collider)
        size = PoolSize(spec.field.pools, spec.field.nodes, spec.field.edges)
        count = len(self.split.train) + len(self.held_out)
        with self._context.progress(count, "sample", "reading fields") as bar:
            training = load_dataset(self.truth, self.body, collider, self.split.train, size, rng, bar.update)
            validation = load_dataset(self.truth, self.body, collider, self.held_out, None, rng, bar.update)
        return training.to(self._device), validation.to(self._device)

    def mechanics(self, spec: ModelSpec) -> BodyMechanics:
        """The body's mechanics at rest as a [[training.models]] table of form "loads" asks for them."""
        if spec.loads not in self._mechanics:
            self._mechanics[spec.loads] = self._kept(spec) or self._computed(spec)
        found = self._mechanics[spec.loads]
        return found if spec.internal else found._replace(internal=None)

    def _kept(self, spec: ModelSpec) -> BodyMechanics | None:
        """From another correction of the run directory, unless all is to be made afresh."""
        if not self._context.resume:
            return None
        paths = (_path(self._context, name) for name in trained_models(self._context.out_dir))
        return kept_mechanics(paths, self.body, spec.loads, self._context.experiment.dynamics.gravity)

    def _computed(self, spec: ModelSpec) -> BodyMechanics:
        gravity = self._context.experiment.dynamics.gravity
        with self._context.progress(n_columns(self.body, spec.loads), "column", "compliance") as bar:
            return as_saved(compute_mechanics(self.body, spec.loads, True, gravity, bar.update))

    def field_task(self, spec: ModelSpec) -> FieldTask:
        """The learning task of a [[training.models]] table of form "field"."""
        gains = InputGains(self._spec.field.input_gain, self._spec.field.position_gain)
        return FieldTask(contact_centric_options(spec), *self.fields, self._spec.edge_weight, gains)

    def load_task(self, spec: ModelSpec, stiffness: float) -> ForceTask:
        """The learning task of a [[training.models]] table of form "loads"; stiffness of contact [N/m^4]."""
        options = force_model_options(spec, stiffness)
        return ForceTask(options, *self._loads(spec, options), self.body.n_rows)

    def _loads(self, spec: ModelSpec, options: ForceModelOptions) -> tuple[ForceMetric, ForceData, ForceData]:
        """Metric, training and validation data: the same for all networks on the same mechanics."""
        key = (spec.loads, spec.internal, options.band, options.stiffness)
        if key not in self._load_data:
            metric = self.metric(spec)
            count = len(self.split.train) + len(self.held_out)
            with self._context.progress(count, "sample", "reading loads") as bar:
                training, validation = (
                    self.load_data(spec, options, samples, bar.update).to(self._device)
                    for samples in (self.split.train, self.held_out)
                )
            self._load_data[key] = (metric, training, validation)
        return self._load_data[key]

    def metric(self, spec: ModelSpec) -> ForceMetric:
        """In which errors of load models are measured; one for each number of loads."""
        if spec.loads not in self._metric:
            compliance = self.mechanics(spec).compliance
            self._metric[spec.loads] = ForceMetric(self.body, compliance, self._spec.edge_weight)
        return self._metric[spec.loads]

    def load_data(
        self,
        spec: ModelSpec,
        options: ForceModelOptions,
        samples: IntArray,
        progress: Callable[[int], None] | None = None,
    ) -> ForceData:
        """Some rows of the truth file, of whatever colliders, as load models learn from them."""
        mechanics, metric = self.mechanics(spec), self.metric(spec)
        return join_force_data(
            [
                read_force_data(self.truth, self.body, collider, mechanics, options, metric, part, progress)
                for collider, part in self._by_collider(samples)
            ]
        )

    def descriptor_task(self, spec: ModelSpec) -> DescriptorTask:
        """The learning task of a [[training.models]] table of form "descriptor"."""
        options = descriptor_model_options(spec, handle_spacing(self.body))
        settings = self._spec.descriptor
        training = self.descriptors(options, self.split.train, self.drawing())
        validation = self.descriptors(options, self.held_out, None)
        loss = DescriptorLoss(settings.consistency, settings.input_gain)
        return DescriptorTask(options, loss, training, validation)

    def drawing(self) -> Drawing:
        """How points of interest are drawn for training."""
        settings = self._spec.descriptor
        return Drawing(settings.points, settings.frames, np.random.default_rng(self._context.seed))

    def descriptors(
        self, options: DescriptorModelOptions, samples: IntArray, drawing: Drawing | None
    ) -> DescriptorData:
        """See `load_descriptor_data`; of many colliders."""
        with self._context.progress(len(samples), "sample", "computing descriptors") as bar:
            parts = [
                load_descriptor_data(self.truth, self.body, collider, options, part, drawing, bar.update)
                for collider, part in self._by_collider(samples)
            ]
        return join_descriptor_data(parts).to(self._device)

    def _by_collider(self, samples: IntArray) -> Iterator[tuple[Collider, IntArray]]:
        """Each collider with those of the samples that are its own."""
        number = self.truth.contacts["collider"][self.truth.samples["contact"][samples]]
        for collider in np.unique(number):
            yield self._build(self.truth.header.colliders[collider]), samples[number == collider]

    def _build(self, name: str) -> Collider:
        if name not in self._colliders:
            experiment = self._context.experiment
            self._colliders[name] = build_collider(experiment.collider(name), experiment.base_dir)
        return self._colliders[name]


def train_models(context: Context, only: str | None) -> None:
    """Train every model of the experiment, or the one named, unless it is there for this truth and these
    settings."""
    experiment = context.experiment
    specs = [model for model in experiment.training.models if only in (None, model.name)]
    if not specs:
        known = ", ".join(model.name for model in experiment.training.models) or "none"
        asked = f"no model named {only!r}" if only else "no models"
        raise SoftprintError(f"{experiment.path}: {asked} in [[training.models]]; there: {known}")
    body = body_of_run(context)
    with load_truth(context.out_dir / "truth.h5", body) as truth:
        wanted = [
            spec
            for spec in specs
            if not (
                context.resume and _is_done(context, spec.name, _recipe(experiment, spec, truth.content_hash))
            )
        ]
        if not wanted:
            context.say("all corrections are up to date.")
            return
        require_same_colliders(truth, experiment)
        lessons = Lessons(truth, body, context)
        context.say(
            f"{len(lessons.split.train)} samples to learn from, {len(lessons.held_out)} of held-out states; "
            f"{lessons.split.left_out} not converged or after a jump; "
            f"label-noise floor {truth.noise_floor:.3g}"
        )
        for spec in wanted:
            _train_one(context, spec, lessons)


def _train_one(context: Context, spec: ModelSpec, lessons: Lessons) -> None:
    stiffness = context.experiment.contact.stiffness
    if spec.form == "field":
        _learn(context, spec, lessons, lessons.field_task(spec), None)
    elif spec.form == "descriptor":
        _learn(context, spec, lessons, lessons.descriptor_task(spec), None)
    else:
        _learn(context, spec, lessons, lessons.load_task(spec, stiffness), lessons.mechanics(spec))


def _learn(
    context: Context,
    spec: ModelSpec,
    lessons: Lessons,
    task: LearningTask[ModelT],
    mechanics: BodyMechanics | None,
) -> None:
    """Train, and write the correction and its curves."""
    experiment, path, truth_hash = context.experiment, _path(context, spec.name), lessons.truth.content_hash
    settings = training_settings(experiment.training, spec.form, experiment.seed)
    recipe, checkpoint = _recipe(experiment, spec, truth_hash), path.with_suffix(".checkpoint")
    if not context.resume:
        checkpoint.unlink(missing_ok=True)
    started = time.perf_counter()
    if spec.form == "loads" and not spec.learned:
        unlearned = task.fresh_model(experiment.seed)
        result = TrainingResult(unlearned, task.held_out_error(unlearned), [])
    else:
        with context.progress(settings.steps, "step", f"training {spec.name}") as bar:
            result = train(
                task,
                settings,
                checkpoint,
                json.dumps(recipe, sort_keys=True),
                lambda steps, note: bar.skip(steps) if note == "resumed" else bar.update(steps, note),
            )
    seconds = time.perf_counter() - started
    _write_curves(path.with_suffix(".json"), spec.name, result, lessons)
    training = {
        **recipe,
        "program": _program(),
        "seconds": seconds,
        "samples": len(lessons.split.train),
    }
    rms, collider = result.held_out.rms, lessons.collider
    save_correction(
        path, spec.name, result.model.cpu(), lessons.body, collider, truth_hash, rms, training, mechanics
    )
    checkpoint.unlink(missing_ok=True)
    context.say(
        f"{path} written: held-out error {rms:.1%} (squared {result.held_out.squared:.1%}), {seconds:.0f} s"
    )


def _path(context: Context, name: str) -> Path:
    return context.out_dir / "corrections" / f"{name}.safetensors"


def _recipe(experiment: Experiment, spec: ModelSpec, truth_hash: str) -> dict[str, object]:
    """All that decides what comes out of training."""
    training = experiment.training.model_dump(mode="json", exclude={"models", "device"})
    return {
        "truth": truth_hash,
        "model": spec.model_dump(mode="json"),
        "stiffness": experiment.contact.stiffness,
        "gravity": list(experiment.dynamics.gravity),
        "settings": {**training, "seed": experiment.seed},
    }


def _is_done(context: Context, name: str, recipe: dict[str, object]) -> bool:
    path = _path(context, name)
    if not path.is_file():
        return False
    try:
        found = read_header(path).training
    except SoftprintError as error:
        log.warning("%s; it is trained again now", error)
        return False
    done = {key: found.get(key) for key in recipe} == recipe
    if done and found.get("program") != _program():
        log.warning(
            "%s is kept, but was learned by another version of the program: --no-resume learns it again", path
        )
    return done


def _program() -> str:
    """What learns, as a hash of its sources: from the same recipe others may come to other weights."""
    folders = {"runtime": Path(runtime.__file__).parent, "surrogate": Path(__file__).parent}
    return content_hash({name: sources_hash(folder) for name, folder in folders.items()})


def _write_curves(
    path: Path,
    name: str,
    result: TrainingResult[ModelT],
    lessons: Lessons,
) -> None:
    """Loss and held-out error along the run, for the report."""
    curves = {
        "model": name,
        "held_out": {**asdict(result.held_out), "squared": result.held_out.squared},
        "noise_floor": lessons.truth.noise_floor,
        "samples": len(lessons.split.train),
        "left_out": lessons.split.left_out,
        "history": result.history,
    }
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(curves, indent=1))
