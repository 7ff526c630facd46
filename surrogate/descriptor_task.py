"""Learning contact deformation from local collider descriptors (thesis 6.2.4): the square of the error, and of what
tangent frames disagree about.

With u_k = f R_k r_k the prediction in the k-th frame of a point, f being attenuation times fade, and w its weight,

    L = < w sum_k |u_k - u|^2 / K  +  consistency * w sum_k |u_k - mean_k u_k|^2 / K > / < w |u|^2 >.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import torch
from torch import Tensor

from runtime.learned.thesis6.model import DescriptorModel, DescriptorModelOptions
from surrogate.descriptor_data import DescriptorData
from surrogate.losses import FieldError
from surrogate.tasks import seeded

# Points from which the normalisation of inputs is measured.
NORMALISATION_POINTS = 20_000


@dataclass(frozen=True)
class DescriptorLoss:
    """consistency: weight of what frames disagree about; input_gain: initial weights of the first layer, relative to
    torch's (see `tasks.InputGains`)."""

    consistency: float
    input_gain: float


class DescriptorTask:
    """A `DescriptorModel`, learned from points of interest; a sample of the task is a point. weights: of the loss."""

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
        # RMS of what the network has to say, over the points of interest of all samples.
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
        return {"form": "descriptor", **self._options.to_json(), **asdict(self.weights)}

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
        """See the module."""
        data = self.data
        r = model(data.inputs(index))
        u = data.factor[index, None, None] * (data.rotation[index] @ r[..., None])[..., 0]
        missed = (u - data.target[index, None]).square().sum(-1).mean(1)
        if self.weights.consistency:
            missed = missed + self.weights.consistency * (u - u.mean(1, keepdim=True)).square().sum(-1).mean(
                1
            )
        return (data.weight[index] * missed).mean() / self._scale

    def held_out_error(self, model: DescriptorModel) -> FieldError:
        """Over the volume of the validation samples, in the frames of run time; what is beyond d counts as missed."""
        missed, whole = sample_errors(model, self.validation)
        return FieldError(
            float((missed.sum() / whole.sum()).sqrt()), float((missed / whole).max().sqrt()), len(whole)
        )

    def finish(self, model: DescriptorModel) -> None:
        """Nothing."""


@torch.no_grad()
def sample_errors(model: DescriptorModel, data: DescriptorData, batch: int = 4096) -> tuple[Tensor, Tensor]:
    """Mean square of the error and of the displacement over the body (s,) [m^2] of samples with all their nodes."""
    missed = data.beyond.clone()
    for index in torch.arange(len(data), device=missed.device).split(batch):
        r = model(data.inputs(index))
        turned = (data.rotation[index] @ r[..., None])[..., 0]
        u = data.factor[index, None] * (data.share[index][..., None] * turned).sum(1)
        square = data.weight[index] * (u - data.target[index]).square().sum(-1)
        missed.index_add_(0, data.sample[index], square.double())
    return missed, data.whole
