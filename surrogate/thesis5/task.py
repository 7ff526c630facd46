"""The training task of a contact-centric displacement field (thesis 5.3)."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import torch
from torch import Tensor

from softprint.runtime.learned.thesis5.model import ContactCentricModel, ContactCentricOptions
from softprint.surrogate.learning_task import HeldOutError, seeded, some_samples
from softprint.surrogate.thesis5.data import ContactDataset
from softprint.surrogate.thesis5.loss import contact_loss, held_out_error


@dataclass(frozen=True)
class InputGains:
    """Gains on the initial weights of a network's first layer, relative to torch's: `inputs` for all inputs, and
    `position` in addition for the position z.

    Normalised inputs vary by 1 over the whole body, but the contact deformation is only a tenth of the body wide.
    With weights of order one, the initial field varies on the scale of the body, and gradient descent takes very long
    to resolve smaller scales (spectral bias).
    """

    inputs: float
    position: float

    @torch.no_grad()
    def apply(self, model: ContactCentricModel) -> None:
        """Scale the weights of a newly initialised model. Both encodings begin with z."""
        layer = model.network.local
        for weights in (layer.weight, layer.bias):
            weights *= self.inputs
        layer.weight[:, : model.dim] *= self.position


class ContactCentricTask:
    """Trains a `ContactCentricModel`, a network evaluated at every point, on pools of nodes and edges."""

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
        """Number of pools; each is a few points of a sample of the truth file."""
        return len(self._data)

    @property
    def device(self) -> torch.device:
        return self._data.rows.device

    @property
    def identity(self) -> dict[str, Any]:
        gains = asdict(self._gains)
        return {
            "form": ContactCentricModel.form,
            **self._options.to_json(),
            "edge_weight": self._edge_weight,
            **gains,
        }

    @property
    def notes(self) -> dict[str, Any]:
        return {}

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
        """The volume and edge terms, see `contact_loss`."""
        return contact_loss(model, self._data.batch(index), self._edge_weight)

    def held_out_error(self, model: ContactCentricModel) -> HeldOutError:
        """Error over all nodes of the validation samples."""
        return held_out_error(model, self._validation)

    def finish(self, model: ContactCentricModel) -> None:
        """Nothing to set."""
