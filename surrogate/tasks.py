"""What `train.py` needs of a kind of model: fresh weights, a loss on some samples, the error on held-out
states."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Protocol, TypeVar

import numpy as np
import torch
from torch import Tensor

from runtime.learned.force.model import ForceModel
from runtime.learned.thesis5.model import ContactCentricModel, ContactCentricOptions
from runtime.learned.thesis6.model import DescriptorModel
from surrogate.dataset import ContactDataset
from surrogate.losses import FieldError, contact_loss, field_error

ModelT = TypeVar("ModelT", ContactCentricModel, ForceModel, DescriptorModel)

# Samples from which the normalisation of inputs and outputs is measured.
NORMALISATION_SAMPLES = 512


class LearningTask(Protocol[ModelT]):
    """A model to learn from samples 0 .. n_samples - 1."""

    @property
    def n_samples(self) -> int: ...
    @property
    def device(self) -> torch.device: ...
    @property
    def identity(self) -> dict[str, Any]:
        """What the task is, as plain values: a checkpoint of another identity is not resumed."""
        ...

    def fresh_model(self, seed: int) -> ModelT: ...
    def loss(self, model: ModelT, index: Tensor) -> Tensor:
        """Loss on samples `index` (b,), dimensionless."""
        ...

    def held_out_error(self, model: ModelT) -> FieldError: ...
    def finish(self, model: ModelT) -> None:
        """What a model is given once it is trained, beside its weights."""
        ...


@dataclass(frozen=True)
class InputGains:
    """Initial weights of a field network's first layer, relative to torch's: of all inputs, and once more of the
    position z.

    Normalised inputs vary by 1 over the whole body, but a dent is a tenth of the body wide. Weights of order one
    start from fields as wide as the body, and gradient descent takes very long to narrow them (spectral bias).
    """

    inputs: float
    position: float

    @torch.no_grad()
    def apply(self, model: ContactCentricModel) -> None:
        """Scale the weights of a fresh model. Both encodings begin with z."""
        layer = model.network.local
        for weights in (layer.weight, layer.bias):
            weights *= self.inputs
        layer.weight[:, : model.dim] *= self.position


class FieldTask:
    """A `ContactCentricModel`, a network evaluated at every point, learned from pools of nodes and edges."""

    def __init__(
        self,
        options: ContactCentricOptions,
        data: ContactDataset,
        validation: ContactDataset,
        edge_weight: float,
        gains: InputGains,
    ) -> None:
        self._options, self._data, self._validation = options, data, validation
        self._edge_weight, self._gains = edge_weight, gains

    @property
    def n_samples(self) -> int:
        """Pools, each a few points of a sample of the truth file."""
        return len(self._data)

    @property
    def device(self) -> torch.device:
        return self._data.rows.device

    @property
    def identity(self) -> dict[str, Any]:
        gains = asdict(self._gains)
        return {"form": "field", **self._options.to_json(), "edge_weight": self._edge_weight, **gains}

    def fresh_model(self, seed: int) -> ContactCentricModel:
        """Initial weights from the seed, normalisation from the data."""
        data = self._data
        model = seeded(
            lambda: ContactCentricModel(self._options, data.rows.shape[-1], data.rows.shape[1]), seed
        )
        model.to(self.device)
        batch = data.batch(some_samples(len(data), seed, self.device))
        local = model.encoding.encode(batch.state).flatten(0, 1)
        model.normalise(local, data.shared, data.depth, batch.target.flatten(0, 1))
        self._gains.apply(model)
        return model

    def loss(self, model: ContactCentricModel, index: Tensor) -> Tensor:
        """Volume and edge terms, see `losses.contact_loss`."""
        return contact_loss(model, self._data.batch(index), self._edge_weight)

    def held_out_error(self, model: ContactCentricModel) -> FieldError:
        """At all nodes of the validation samples."""
        return field_error(model, self._validation)

    def finish(self, model: ContactCentricModel) -> None:
        """Nothing."""


def seeded(make: Callable[[], ModelT], seed: int) -> ModelT:
    """A model whose initial weights come from `seed`; torch's own generator is left as it was."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return make()


def some_samples(count: int, seed: int, device: torch.device) -> Tensor:
    """At most NORMALISATION_SAMPLES of `count` samples, drawn from the seed."""
    chosen = np.random.default_rng(seed).permutation(count)[:NORMALISATION_SAMPLES]
    return torch.from_numpy(chosen).to(device)
