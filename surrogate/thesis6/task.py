"""The training task of contact deformation from local collider descriptors (thesis 6.2.4)."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import torch
from torch import Tensor

from softprint.runtime.learned.thesis6.model import DescriptorModel, DescriptorModelOptions
from softprint.surrogate.learning_task import HeldOutError, seeded
from softprint.surrogate.thesis6.data import DescriptorData
from softprint.surrogate.thesis6.loss import DescriptorLoss, mean_loss, sample_errors

# Number of points used to measure the normalisation of inputs.
NORMALISATION_POINTS = 20_000


class DescriptorTask:
    """Trains a `DescriptorModel` on points of interest; a sample of the task is a point. weights: of the loss."""

    def __init__(
        self,
        options: DescriptorModelOptions,
        loss: DescriptorLoss,
        data: DescriptorData,
        validation: DescriptorData,
    ) -> None:
        self._options, self.weights, self.data, self.validation = options, loss, data, validation
        square = data.weight * data.target.square().sum(1)
        self._scale = square.double().mean().float()
        # RMS of the network's target output, over the points of interest of all samples.
        self._output_scale = (
            square.double().sum() / data.weight.double().sum() / data.target.shape[1]
        ).sqrt()

    @property
    def n_samples(self) -> int:
        return len(self.data)

    @property
    def device(self) -> torch.device:
        return self.data.factor.device

    @property
    def identity(self) -> dict[str, Any]:
        return {"form": DescriptorModel.form, **self._options.to_json(), **asdict(self.weights)}

    @property
    def notes(self) -> dict[str, Any]:
        return {}

    def fresh_model(self, seed: int) -> DescriptorModel:
        """Initial weights from the seed, normalisation from the data."""
        data = self.data
        dim, n_rows = data.target.shape[1], data.relative.shape[1]
        model = seeded(lambda: DescriptorModel(self._options, dim, n_rows), seed).to(self.device)
        generator = torch.Generator().manual_seed(seed)
        some = torch.randperm(len(data), generator=generator)[:NORMALISATION_POINTS].to(self.device)
        model.normalise(data.inputs(some).flatten(0, 1), self._output_scale)
        with torch.no_grad():
            for weights in (model.network.local.weight, model.network.local.bias):
                weights *= self.weights.input_gain
        return model

    def loss(self, model: DescriptorModel, index: Tensor) -> Tensor:
        """See `loss.py`."""
        return mean_loss(model, self.data, index, self.weights.consistency) / self._scale

    def held_out_error(self, model: DescriptorModel) -> HeldOutError:
        """Error over the volume of the validation samples, in the frames used at run time; displacement beyond d counts
        as error in full."""
        return HeldOutError.of(*sample_errors(model, self.validation))

    def finish(self, model: DescriptorModel) -> None:
        """Nothing to set."""
