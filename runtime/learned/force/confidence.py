"""A confidence factor that reduces the correction of a contact outside the training range.

The output of a network is arbitrary for contacts unlike those it was trained on. Its correction c_j of the contact
forces l_j is multiplied by one factor for the whole contact,

    t = 1 / (1 + (N / N0)^2) * 1 / (1 + (rho / rho0)^8),
    N^2 = sum_j |l_j|^2 sum_k n_jk^2 / sum_j |l_j|^2,        rho^2 = sum_j |c_j|^2 / sum_j |l_j|^2,

n_jk the distance of input k of contact point j from its range in training, in widths of that range, and rho the size of
the correction relative to the forces; rho0 is 1.5 times the rho that 99 of 100 training contacts stay below. Both
factors fall off smoothly, and what remains is linear mechanics. N0 and rho0 are as small as leaves the error on
validation shapes unchanged.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

Floats = NDArray[np.floating[Any]]

_BEYOND = 0.5  # N0
_CEILING, _QUANTILE = 1.5, 0.99  # rho0 from the rho of training
_STEEP = 8
# The least width of a training range, in standard deviations of the input, for inputs that hardly varied.
_LEAST_WIDTH = 1.0
_NOTHING = 1e-30


class Confidence(nn.Module):
    """t of contacts with n_local normalised inputs per contact point. Buffers: lowest, highest (n_local,) input, and
    rho0; before any training t is 1."""

    lowest: Tensor
    highest: Tensor
    ceiling: Tensor

    def __init__(self, n_local: int) -> None:
        super().__init__()
        self.register_buffer("lowest", torch.full((n_local,), -torch.inf))
        self.register_buffer("highest", torch.full((n_local,), torch.inf))
        self.register_buffer("ceiling", torch.tensor(torch.inf))

    @torch.no_grad()
    def span(self, z: Tensor) -> None:
        """Set the training range to that of inputs (n, n_local)."""
        self.lowest.copy_(z.amin(0))
        self.highest.copy_(z.amax(0))

    @torch.no_grad()
    def limit(self, ratio: Tensor) -> None:
        """Set rho0 from the rho (n,) of training contacts."""
        self.ceiling.copy_(_CEILING * torch.quantile(ratio, _QUANTILE))

    def forward(self, z: Tensor, force: Tensor, correction: Tensor) -> Tensor:
        """t (..., 1, 1) for inputs (..., m, n_local), contact forces and their corrections (..., m, dim)."""
        width = (self.highest - self.lowest).clamp(min=_LEAST_WIDTH)
        outside = (torch.relu(z - self.highest) + torch.relu(self.lowest - z)) / width
        square = force.square().sum(-1)
        whole = square.sum(-1).clamp(min=_NOTHING)
        novelty = (outside.square().sum(-1) * square).sum(-1) / whole
        excess = squared_ratio(force, correction) / self.ceiling.square().clamp(min=_NOTHING)
        return (1.0 / (1.0 + novelty / _BEYOND**2) / (1.0 + excess ** (_STEEP // 2)))[..., None, None]


def squared_ratio(force: Tensor, correction: Tensor) -> Tensor:
    """rho^2 (...,) of contacts, for arguments (..., m, dim). The square, as rho has no derivative at a zero
    correction."""
    whole = force.square().sum((-1, -2)).clamp(min=_NOTHING)
    return correction.square().sum((-1, -2)) / whole


class ConfidenceEvaluation:
    """`Confidence` for one contact, in numpy. Buffers are shared, not copied."""

    def __init__(self, confidence: Confidence) -> None:
        self._lowest, self._highest = confidence.lowest.numpy(), confidence.highest.numpy()
        self._width = np.maximum(self._highest - self._lowest, _LEAST_WIDTH)
        self._squared_ceiling = max(float(confidence.ceiling) ** 2, _NOTHING)

    def of(self, z: Floats, force: Floats, correction: Floats) -> float:
        """t for inputs (m, n_local), contact forces and their corrections (m, dim)."""
        outside = (np.maximum(z - self._highest, 0.0) + np.maximum(self._lowest - z, 0.0)) / self._width
        square = (force * force).sum(axis=1)
        whole = max(float(square.sum()), _NOTHING)
        novelty = float((outside * outside).sum(axis=1) @ square) / whole
        excess = float(np.vdot(correction, correction)) / whole / self._squared_ceiling
        return 1.0 / (1.0 + novelty / _BEYOND**2) / (1.0 + excess ** (_STEEP // 2))
