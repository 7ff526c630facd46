"""The loss of thesis 6.2.4: the squared error, plus the variance between predictions in different tangent frames.

With u_k = f R_k r_k the prediction in the k-th frame of a point, f being attenuation times fade, and w its weight,

    L = < w sum_k |u_k - u|^2 / K  +  consistency * w sum_k |u_k - mean_k u_k|^2 / K > / < w |u|^2 >.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from softprint.runtime.learned.thesis6.model import DescriptorModel
from softprint.surrogate.thesis6.data import DescriptorData


@dataclass(frozen=True)
class DescriptorLoss:
    """consistency: weight of the variance between frames; input_gain: gain on the initial weights of the first layer,
    relative to torch's (see `InputGains` of thesis5)."""

    consistency: float
    input_gain: float


def mean_loss(model: DescriptorModel, data: DescriptorData, index: Tensor, consistency: float) -> Tensor:
    """The numerator of L over points `index` (b,) [m^2]."""
    r = model(data.inputs(index))
    u = data.factor[index, None, None] * (data.rotation[index] @ r[..., None])[..., 0]
    error = (u - data.target[index, None]).square().sum(-1).mean(1)
    if consistency:
        error = error + consistency * (u - u.mean(1, keepdim=True)).square().sum(-1).mean(1)
    return (data.weight[index] * error).mean()


@torch.no_grad()
def sample_errors(model: DescriptorModel, data: DescriptorData, batch: int = 4096) -> tuple[Tensor, Tensor]:
    """(mean squared error (s,), mean squared displacement (s,)) over the body [m^2] of samples with all their nodes."""
    error = data.beyond.clone()
    for index in torch.arange(len(data), device=error.device).split(batch):
        r = model(data.inputs(index))
        rotated = (data.rotation[index] @ r[..., None])[..., 0]
        u = data.factor[index, None] * (data.share[index][..., None] * rotated).sum(1)
        square = data.weight[index] * (u - data.target[index]).square().sum(-1)
        error.index_add_(0, data.sample[index], square.double())
    return error, data.whole
