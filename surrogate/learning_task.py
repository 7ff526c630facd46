"""What `train.py` needs from a kind of model: initial weights, a loss on a batch of samples, the error on held-out
states."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor

from softprint.runtime.arrays import Array
from softprint.runtime.learned.form import ModelT
from softprint.runtime.learned.worst_error import worst_relative_error

# Number of samples used to measure the normalisation of inputs and outputs.
NORMALISATION_SAMPLES = 512


@dataclass(frozen=True)
class HeldOutError:
    """Errors over a set of samples, relative to the displacement (0: perfect; 1: no better than no correction).

    rms = sqrt(sum w |u_pred - u|^2 / sum w |u|^2) over samples and nodes, w the node volumes; worst: the
    largest rms of a single sample, of those with a hundredth of the mean squared displacement or more; samples: number
    of samples.
    """

    rms: float
    worst: float
    samples: int

    @classmethod
    def of(cls, missed: Array | Tensor, whole: Array | Tensor) -> HeldOutError:
        """Of samples with squared errors and squared displacements (n,), each summed over the nodes; NaN of none."""
        error, square = (
            np.asarray(part.cpu() if isinstance(part, Tensor) else part) for part in (missed, whole)
        )
        error = np.maximum(error, 0.0)  # differences of large numbers
        if not len(square):
            return cls(float("nan"), float("nan"), 0)
        return cls(float(error.sum() / square.sum()) ** 0.5, worst_relative_error(error, square), len(square))

    @property
    def squared(self) -> float:
        """Mean squared error relative to the mean squared displacement: rms^2."""
        return self.rms**2


class LearningTask(Protocol[ModelT]):
    """A model to train on samples 0 .. n_samples - 1."""

    @property
    def n_samples(self) -> int: ...
    @property
    def device(self) -> torch.device: ...
    @property
    def identity(self) -> dict[str, Any]:
        """What defines the task, as plain values: a checkpoint with a different identity is not resumed."""
        ...

    @property
    def notes(self) -> dict[str, Any]:
        """What was found before training, as plain values, for the file of the curves."""
        ...

    def fresh_model(self, seed: int) -> ModelT: ...
    def loss(self, model: ModelT, index: Tensor) -> Tensor:
        """Loss on samples `index` (b,), dimensionless."""
        ...

    def held_out_error(self, model: ModelT) -> HeldOutError: ...
    def finish(self, model: ModelT) -> None:
        """Set what a trained model needs besides its weights."""
        ...


class CrossedTask(Protocol[ModelT]):
    """Tasks of cross-validation. whole: on all samples; folds: on parts of them, each judged by others; notes: as of
    `LearningTask`."""

    @property
    def whole(self) -> LearningTask[ModelT]: ...
    @property
    def folds(self) -> Sequence[LearningTask[ModelT]]: ...
    @property
    def notes(self) -> dict[str, Any]: ...
    def conclude(self, model: ModelT, by_fold: Sequence[ModelT]) -> HeldOutError:
        """Keep of the model of all samples what those of the folds bear out; the error of these."""
        ...


def seeded(make: Callable[[], ModelT], seed: int) -> ModelT:
    """A model with initial weights drawn from `seed`; torch's global generator is not changed."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return make()


def some_samples(count: int, seed: int, device: torch.device) -> Tensor:
    """Indices of at most NORMALISATION_SAMPLES of `count` samples, drawn from the seed."""
    chosen = np.random.default_rng(seed).permutation(count)[:NORMALISATION_SAMPLES]
    return torch.from_numpy(chosen).to(device)
