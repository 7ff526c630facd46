"""Training data of a run: a truth file with its split, and a cache of the data that models read from it."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from typing import TypeVar, cast

import numpy as np
import torch

from softprint.runtime.arrays import IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_mechanics import RunMechanics
from softprint.runtime.colliders.build import build_collider
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.experiment import ANY_COLLIDER, LIBRARY
from softprint.runtime.truth.truth_file import TruthData
from softprint.surrogate.data.splits import Split, split_by_shape, split_by_state

Read = TypeVar("Read")


def training_device(name: str) -> torch.device:
    """The torch device with that name. Raises SoftprintError if it is not available."""
    if name == "cuda" and not torch.cuda.is_available():
        raise SoftprintError('training.device = "cuda", but torch finds no CUDA device: use "cpu"')
    return torch.device(name)


class TrainingData:
    """Training data of one run. split: rows of the truth file for training and for validation; held_out: those of the
    validation rows on which errors are measured; collider: name of the collider that is trained for, or
    `ANY_COLLIDER`; mechanics: of the run directory, by default those of the context."""

    def __init__(
        self, truth: TruthData, body: ReducedBody, context: Context, mechanics: RunMechanics | None = None
    ) -> None:
        self.truth, self.body, self.context = truth, body, context
        self.mechanics = mechanics or RunMechanics(context, body)
        self.spec = spec = context.experiment.training
        if not truth.header.colliders:
            raise SoftprintError(
                f"{truth.path}: has states without contact alone, and [[training.models]] are corrections of contact; "
                "[[training.internal]] learns from them"
            )
        if spec.collider == LIBRARY:
            self.split: Split = split_by_shape(
                truth, spec.validation_states, context.experiment.library_roles
            )
            self.collider = ANY_COLLIDER
        else:
            self.split = split_by_state(truth, spec.collider, spec.validation_states)
            self.collider = spec.collider
        self.device = training_device(spec.device)
        self._colliders: dict[str, Collider] = {}
        self._read: dict[Hashable, object] = {}

    @property
    def held_out(self) -> IntArray:
        """Rows of the truth file on which errors are measured while training. Raises SoftprintError without any."""
        validation, most = self.split.validation, self.spec.validation_states
        if not len(validation):
            count = len(np.unique(self.truth.sample_state[self.split.whole]))
            raise SoftprintError(
                f"{self.truth.path}: has usable samples at {count} states; holding out {most} for validation "
                "(training.validation_states) leaves none for training"
            )
        drawn = np.random.default_rng(self.context.seed).permutation(validation)
        return np.sort(drawn[: self.spec.validation_samples])

    def once(self, key: Hashable, read: Callable[[], Read]) -> Read:
        """The result of `read`, called at first use and cached under the key for later models."""
        if key not in self._read:
            self._read[key] = read()
        return cast(Read, self._read[key])

    def by_collider(self, samples: IntArray) -> Iterator[tuple[Collider, IntArray]]:
        """Each collider with its samples."""
        number = self.truth.contacts["collider"][self.truth.samples["contact"][samples]]
        for collider in np.unique(number):
            yield self.build(self.truth.header.colliders[collider]), samples[number == collider]

    def build_colliders(self, samples: IntArray) -> None:
        """Build the colliders of samples (n,), for workers that are forked afterwards."""
        for _ in self.by_collider(samples):
            pass

    def build(self, name: str) -> Collider:
        """The collider with that name, built once."""
        if name not in self._colliders:
            experiment = self.context.experiment
            self._colliders[name] = build_collider(experiment.collider(name), experiment.base_dir)
        return self._colliders[name]
