"""How far what was learned is believed in a contact, so that it does no harm where nothing was learned.

A network says anything about contacts unlike those it was trained on. Its correction c_j of the loads l_j is taken
t times, with one factor for the whole contact,

    t = 1 / (1 + (N / N0)^2) * 1 / (1 + (rho / rho0)^8),
    N^2 = sum_j |l_j|^2 sum_k n_jk^2 / sum_j |l_j|^2,        rho^2 = sum_j |c_j|^2 / sum_j |l_j|^2,

n_jk how far input k of load j lies outside all that it was in training, in widths of that range, and rho how large the
correction is beside the loads; rho0 is half as large again as what 99 of 100 training contacts came to ask for. Both
fall off smoothly, and what remains is linear mechanics. N0 and rho0 are as tight as validation shapes do not notice.
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
# A range is counted as at least so wide, in spreads of the input: of an input that hardly varied no one knows.
_LEAST_WIDTH = 1.0
_NOTHING = 1e-30


class Confidence(nn.Module):
    """t of contacts with n_local normalised inputs a load. Buffers: lowest, highest (n_local,) input, and rho0; without
    any training all is believed."""

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
        """Inputs (n, n_local) are to be believed."""
        self.lowest.copy_(z.amin(0))
        self.highest.copy_(z.amax(0))

    @torch.no_grad()
    def limit(self, ratio: Tensor) -> None:
        """Corrections as large beside the loads as rho (n,) are to be believed."""
        self.ceiling.copy_(_CEILING * torch.quantile(ratio, _QUANTILE))

    def forward(self, z: Tensor, load: Tensor, correction: Tensor) -> Tensor:
        """t (..., 1, 1) for inputs (..., m, n_local), loads and their corrections (..., m, dim)."""
        width = (self.highest - self.lowest).clamp(min=_LEAST_WIDTH)
        outside = (torch.relu(z - self.highest) + torch.relu(self.lowest - z)) / width
        square = load.square().sum(-1)
        whole = square.sum(-1).clamp(min=_NOTHING)
        novelty = (outside.square().sum(-1) * square).sum(-1) / whole
        excess = squared_ratio(load, correction) / self.ceiling.square().clamp(min=_NOTHING)
        return (1.0 / (1.0 + novelty / _BEYOND**2) / (1.0 + excess ** (_STEEP // 2)))[..., None, None]


def squared_ratio(load: Tensor, correction: Tensor) -> Tensor:
    """rho^2 (...,) of contacts, for (..., m, dim) both; its root has no derivative where nothing is corrected."""
    whole = load.square().sum((-1, -2)).clamp(min=_NOTHING)
    return correction.square().sum((-1, -2)) / whole


class ConfidenceEvaluation:
    """The same for one contact, in numpy. Buffers are shared, not copied."""

    def __init__(self, trust: Confidence) -> None:
        self._lowest, self._highest = trust.lowest.numpy(), trust.highest.numpy()
        self._width = np.maximum(self._highest - self._lowest, _LEAST_WIDTH)
        self._squared_ceiling = max(float(trust.ceiling) ** 2, _NOTHING)

    def of(self, z: Floats, load: Floats, correction: Floats) -> float:
        """t for inputs (m, n_local), loads and their corrections (m, dim)."""
        outside = (np.maximum(z - self._highest, 0.0) + np.maximum(self._lowest - z, 0.0)) / self._width
        square = (load * load).sum(axis=1)
        whole = max(float(square.sum()), _NOTHING)
        novelty = float((outside * outside).sum(axis=1) @ square) / whole
        excess = float(np.vdot(correction, correction)) / whole / self._squared_ceiling
        return 1.0 / (1.0 + novelty / _BEYOND**2) / (1.0 + excess ** (_STEEP // 2))
