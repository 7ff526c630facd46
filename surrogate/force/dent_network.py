"""Trains the network in the learned energy (`runtime/contact/learned_energy/dent_network.py`) on solved contacts.

The network changes no contact solve, so that all it needs are the number of dents n = exp nu of each sample, the
measures l = (log W_1, omega) of one, with W_1 = W / n, and their derivatives: with g(W_1) from `energy.py`,

    W~ = n g e^eta,    h~ = W~ [ dnu + (dg/dl / g + d eta/dl) . dl ],

and weights minimise the residuals of handle forces, force on the collider and energy, each relative to what is true,
with the pseudo-Huber loss, which grows linearly for contacts that no weights fit. There are tens of weights and a full
batch, so that a quasi-Newton method finds them in seconds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from softprint.runtime.arrays import Array
from softprint.runtime.contact.learned_energy.dent_network import BOUND, N_MEASURES, DentNetwork
from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy

NEURONS = 6
_ITERATIONS = 300
# Of the squares of the weights, in the mean loss of a sample.
_DECAY = 1e-5
# The least width of a range of training.
_NARROWEST = 0.1
# log W_1 = log W - nu, the first of two.
_SIZE = np.eye(N_MEASURES)[0]


@dataclass(frozen=True, eq=False)
class Dents:
    """s samples under g alone. measures: (W_1, omega) (s, 2); energy: n g (s,); by_energy: dlog g/dlog W_1 (s,);
    slopes: dl by kind of force (s, n_k, 2); by_number: dnu by kind (s, n_k); truth: by kind (s, n_k), the energy among
    them; weights: by kind (s,), of squared residuals; threshold: by kind, of the weighted residual from which on a
    sample counts less."""

    measures: Array
    energy: Tensor
    by_energy: Tensor
    slopes: Mapping[str, Tensor]
    by_number: Mapping[str, Tensor]
    truth: Mapping[str, Tensor]
    weights: Mapping[str, Tensor]
    threshold: Mapping[str, float]

    @classmethod
    def of(
        cls,
        learned: LearnedEnergy,
        measures: Array,
        slopes: Mapping[str, Array],
        truth: Mapping[str, Array],
        weights: Mapping[str, Array],
        threshold: Mapping[str, float],
    ) -> Dents:
        """measures: (W, omega, nu) (s, 3); slopes: of (log W, omega, nu) by kind (s, n_k, 3)."""
        number = np.exp(measures[:, 2])
        W = measures[:, 0] / number
        g = np.array([learned.energy(one) for one in W])
        slope = np.array([learned.slope(one) for one in W])
        by_number = {kind: of[..., 2] for kind, of in slopes.items()}
        return cls(
            np.column_stack([W, measures[:, 1]]),
            torch.from_numpy(number * g),
            torch.from_numpy(W * slope / g),
            _tensors({kind: of[..., :2] - of[..., 2:] * _SIZE for kind, of in slopes.items()}),
            _tensors(by_number),
            _tensors(truth),
            _tensors(weights),
            threshold,
        )

    def found(self, eta: Tensor, slope: Tensor) -> dict[str, Tensor]:
        """W~ and forces by kind, for eta (s,) and its derivatives by l (s, 2)."""
        energy = self.energy * torch.exp(eta)
        slope = slope + torch.nn.functional.pad(self.by_energy[:, None], (0, slope.shape[1] - 1))
        forces = {
            kind: energy[:, None] * (self.by_number[kind] + torch.einsum("sfl,sl->sf", by, slope))
            for kind, by in self.slopes.items()
        }
        return {**forces, "energy": energy[:, None]}

    def under(self, network: DentNetwork) -> dict[str, Array]:
        """What is found with a network: energies and forces by kind (s, n_k)."""
        factors = [network.factor(one) for one in self.measures]
        eta, slope = (torch.from_numpy(np.array(part)) for part in list(zip(*factors, strict=True))[:2])
        return {kind: found.numpy() for kind, found in self.found(eta, slope).items()}

    def loss(self, eta: Tensor, slope: Tensor, labels: tuple[str, ...]) -> Tensor:
        """The mean over samples of the sum over the labels."""
        found, total = self.found(eta, slope), torch.zeros((), dtype=torch.float64)
        for kind in labels:
            squared = self.weights[kind] * (found[kind] - self.truth[kind]).square().sum(1)
            squared = squared / self.threshold[kind] ** 2
            total = total + self.threshold[kind] ** 2 * 2.0 * (torch.sqrt(1.0 + squared) - 1.0).mean()
        return total


def _tensors(arrays: Mapping[str, Array]) -> dict[str, Tensor]:
    return {kind: torch.from_numpy(array) for kind, array in arrays.items()}


def train_network(dents: Dents, labels: tuple[str, ...], seed: int) -> DentNetwork:
    """The weights that fit the samples best, from random ones. labels: the kinds of residuals to learn from."""
    size = torch.from_numpy(np.log(dents.measures[:, 0]) / 3.0)
    others = torch.from_numpy(dents.measures[:, 1:])
    z = torch.cat([size[:, None], others], dim=1)
    lowest, highest = z.amin(0), z.amax(0).maximum(z.amin(0) + _NARROWEST)
    centre = size.median()
    large = torch.sigmoid(size - centre)
    y = torch.cat([large[:, None], others], dim=1)
    by_l = torch.cat([(large * (1.0 - large) / 3.0)[:, None], torch.ones_like(others)], dim=1)
    generator = torch.Generator().manual_seed(seed)

    def random(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator, dtype=torch.float64)

    weights = [2.0 * random(NEURONS, N_MEASURES), random(NEURONS), 0.1 * random(NEURONS)]
    # Differences from the middle are what varies.
    weights[1] -= 0.5 * weights[0].sum(1)
    for part in weights:
        part.requires_grad_()
    optimiser = torch.optim.LBFGS(
        weights, max_iter=_ITERATIONS, history_size=30, line_search_fn="strong_wolfe"
    )

    def closure() -> Tensor:
        optimiser.zero_grad()
        hidden, bias, output = weights
        t = torch.tanh(y @ hidden.T + bias)
        bounded = torch.tanh(t @ output / BOUND)
        by_y = (1.0 - bounded.square())[:, None] * (((1.0 - t.square()) * output) @ hidden)
        loss = dents.loss(BOUND * bounded, by_y * by_l, labels)
        loss = loss + _DECAY * sum(part.square().sum() for part in (hidden, output))
        loss.backward()
        return loss

    optimiser.step(closure)
    hidden, bias, output = (part.detach().numpy() for part in weights)
    return DentNetwork(float(centre), lowest.numpy(), highest.numpy(), hidden, bias, output)
