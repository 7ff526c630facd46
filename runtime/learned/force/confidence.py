"""A confidence factor that reduces the correction of a contact outside the training range.

The output of a network is arbitrary for contacts unlike those it was trained on. Its correction c_j of the contact
forces l_j is multiplied by one factor for the whole contact,

    t = 1 / (1 + (M / M0)^16) * 1 / (1 + (rho / rho0)^8),        rho^2 = sum_j |c_j|^2 / sum_j |l_j|^2,

M the distance of the contact from those of training, and rho the size of the correction relative to the forces. M is
that of Mahalanobis, of a few measures of the contact as a whole,

    a = ( mean z, spread z, D, |sum_j l_j| / sum_j |l_j|, -log sum_j s_j^2 ),        s_j = |l_j| / sum_j |l_j|,
    M^2 = |W (a - a_0)|^2 / n,

mean and spread of the normalised inputs z_j with the weights s_j, D the depth, the resultant of the forces over their
sum (small where they surround the body), and the number of points that bear. Ranges of single inputs are not enough:
each input of a contact that wraps a ring occurs in contacts from one side, too. M0 and rho0 are from contacts that the
network was not trained on (`surrogate/force/crossed.py`): M0 is the M that 95 of 100 stay below, or 99 of 100, or 1.5
times that, where that lowers the error on them, and rho0 1.5 times the rho that 99 of 100 stay below, here or in
training. Both factors fall off smoothly, and what remains is linear mechanics; so it does where no point bears, and all
l_j are zero.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

Floats = NDArray[np.floating[Any]]

# Shares of contacts beside training that M0 is beyond: by default, and where they bear out that more is known.
NEAR, FAR = 0.95, 0.99
_LARGEST, _CEILING = 0.99, 1.5  # rho0 from rho of these
# Powers of M / M0 and of rho / rho0. There are as many measures as some bodies have contacts, so that M is about the
# same for all of them: half of it to the power of 16 is nothing, and 0.8 of it 3 %.
_OF_DISTANCE, _OF_RATIO = 16, 8
# Added to the correlation of the measures, which are more than some bodies have contacts.
_RIDGE = 0.05
# The least spread of a measure, in standard deviations of the inputs, for measures that hardly varied.
_LEAST_SPREAD = 0.03
_NOTHING = 1e-30


def n_measures(n_local: int) -> int:
    """The number of measures of a contact with n_local inputs per contact point."""
    return 2 * n_local + 3


class Confidence(nn.Module):
    """t of contacts with n_local normalised inputs per contact point. Buffers: a_0 (n,), W (n, n), M0, and rho0; before
    any training t is 1."""

    centre: Tensor
    whitening: Tensor
    farthest: Tensor
    ceiling: Tensor

    def __init__(self, n_local: int) -> None:
        super().__init__()
        n = n_measures(n_local)
        self.register_buffer("centre", torch.zeros(n))
        self.register_buffer("whitening", torch.zeros(n, n))
        self.register_buffer("farthest", torch.tensor(torch.inf))
        self.register_buffer("ceiling", torch.tensor(torch.inf))

    @torch.no_grad()
    def fit(self, measures: Tensor) -> None:
        """Set a_0 and W from the measures (s, n) of training contacts, at least two."""
        a = measures.double()
        centre, spread = a.mean(0), a.std(0)
        spread = spread.clamp(min=_LEAST_SPREAD)
        scaled = (a - centre) / spread
        correlation = scaled.T @ scaled / (len(a) - 1)
        correlation.fill_diagonal_(1.0 + _RIDGE)
        root = torch.linalg.cholesky(torch.linalg.inv(correlation))
        self.centre.copy_(centre)
        self.whitening.copy_(root.T / spread)

    @torch.no_grad()
    def limit(self, distance: Tensor, ratio: Tensor, within: float = NEAR, times: float = 1.0) -> None:
        """Set M0 and rho0 from M (s,) and rho (s,) of contacts with contact forces; within: the share of them that M0
        is to be beyond, or so many times what they stay below."""
        self.farthest.copy_(times * torch.quantile(distance, within))
        self.ceiling.copy_(_CEILING * torch.quantile(ratio, _LARGEST))

    def distance(self, measures: Tensor) -> Tensor:
        """M (...,) of measures (..., n)."""
        return ((measures - self.centre) @ self.whitening.T).square().mean(-1).sqrt()

    def forward(self, z: Tensor, depth: Tensor, force: Tensor, correction: Tensor) -> Tensor:
        """t (..., 1, 1) for inputs (..., m, n_local), depths (...), contact forces (..., m, dim) and their
        corrections (..., m, 2 dim)."""
        far = self.distance(contact_measures(z, depth, force)) / self.farthest.clamp(min=_NOTHING)
        excess = squared_ratio(force, correction) / self.ceiling.square().clamp(min=_NOTHING)
        return (1.0 / (1.0 + far**_OF_DISTANCE) / (1.0 + excess ** (_OF_RATIO // 2)))[..., None, None]


def contact_measures(z: Tensor, depth: Tensor, force: Tensor) -> Tensor:
    """a (..., n) of contacts: normalised inputs (..., m, n_local), depths (...) [any unit], contact forces (..., m,
    dim)."""
    size = force.square().sum(-1).clamp(min=_NOTHING).sqrt() * (force != 0.0).any(-1)
    whole = size.sum(-1).clamp(min=_NOTHING)
    share = size / whole[..., None]
    mean = (share[..., None] * z).sum(-2)
    spread = (share[..., None] * (z - mean[..., None, :]).square()).sum(-2).sqrt()
    resultant = force.sum(-2).square().sum(-1).sqrt() / whole
    bearing = -share.square().sum(-1).clamp(min=_NOTHING).log()
    return torch.cat([mean, spread, torch.stack([depth, resultant, bearing], -1)], -1)


def squared_ratio(force: Tensor, correction: Tensor) -> Tensor:
    """rho^2 (...,) of contacts, for forces (..., m, dim) and their corrections (..., m, 2 dim). The square, as rho has
    no derivative at a zero correction."""
    whole = force.square().sum((-1, -2)).clamp(min=_NOTHING)
    return correction.square().sum((-1, -2)) / whole


class ConfidenceEvaluation:
    """`Confidence` for one contact, in numpy. Buffers are shared, not copied."""

    def __init__(self, confidence: Confidence) -> None:
        self._centre, self._whitening = confidence.centre.numpy(), confidence.whitening.numpy()
        self._farthest = max(float(confidence.farthest), _NOTHING)
        self._squared_ceiling = max(float(confidence.ceiling) ** 2, _NOTHING)

    def of(self, z: Floats, depth: float, force: Floats, correction: Floats) -> float:
        """t for inputs (m, n_local), the depth, contact forces (m, dim) and their corrections (m, 2 dim)."""
        square = (force * force).sum(axis=1)
        size = np.sqrt(square)
        whole = max(float(size.sum()), _NOTHING)
        share = size / whole
        mean = share @ z
        spread = np.sqrt(share @ np.square(z - mean))
        resultant = float(np.linalg.norm(force.sum(axis=0))) / whole
        bearing = -np.log(max(float(share @ share), _NOTHING))
        a = np.concatenate([mean, spread, [depth, resultant, bearing]]) - self._centre
        far = np.sqrt(np.mean(np.square(self._whitening @ a))) / self._farthest
        excess = float(np.vdot(correction, correction)) / max(float(square.sum()), _NOTHING)
        excess /= self._squared_ceiling
        return float(1.0 / (1.0 + far**_OF_DISTANCE) / (1.0 + excess ** (_OF_RATIO // 2)))
