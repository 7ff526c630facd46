"""What a network of principal components is trained on: the coefficients of displacement fields.

The components are orthonormal in the volume, so that the squared error of coefficients is that of the displacement over
the volume. The held-out error is that of the whole field, with what the components leave out.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from softprint.runtime.arrays import Array
from softprint.surrogate.data.components import principal_components
from softprint.surrogate.learning_task import HeldOutError


class ComponentTargets:
    """Of fields (s, n_nodes, dim) on nodes with volumes (n_nodes,). modes: (count, n_nodes, dim); target: (s, count);
    scale: (count,) their root mean squares; discarded: the share of the energy beyond the components."""

    def __init__(
        self, fields: Array, held_out: Array, volumes: Array, count: int, device: torch.device | None = None
    ) -> None:
        components = principal_components(fields, volumes, count)
        self.discarded = components.discarded
        self.modes = torch.from_numpy(components.modes).float().to(device)
        self.target = torch.from_numpy(components.coefficients).float().to(device)
        self.scale = self.target.square().mean(0).sqrt()
        projected = np.einsum("snd,knd,n->sk", held_out, components.modes, volumes, optimize=True)
        self._held_target = torch.from_numpy(projected).to(device)
        energy = np.einsum("snd,n->s", held_out.astype(np.float64) ** 2, volumes)
        self._held_energy = torch.from_numpy(energy).to(device)

    def loss(self, found: Tensor, index: Tensor) -> Tensor:
        """Squared error of the field over the volume, relative to the mean square of the targets, of coefficients
        (b, count) of the fields of the given indices (b,)."""
        return (found - self.target[index]).square().sum(1).mean() / self.scale.square().sum()

    def held_out_error(self, found: Tensor) -> HeldOutError:
        """Error over the volume of coefficients (s, count) of the held-out fields, relative to these."""
        beyond = self._held_energy - self._held_target.square().sum(1)
        error = (found.double() - self._held_target).square().sum(1) + beyond.clamp(min=0.0)
        return HeldOutError.of(error, self._held_energy)
