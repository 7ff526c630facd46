"""The force model of `model.py` for one contact, in numpy. With some tens of rows the overhead per operation dominates,
and within a step that of torch is several times that of numpy.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from softprint.runtime.learned.force.confidence import ConfidenceEvaluation
from softprint.runtime.learned.force.contact_state import ContactState
from softprint.runtime.learned.force.model import SATURATION, ForceModel

Floats = NDArray[np.floating[Any]]

_ACTIVATIONS: dict[str, Callable[[Floats], Floats]] = {
    "tanh": np.tanh,
    "silu": lambda x: 0.5 * x * (1.0 + np.tanh(0.5 * x)),
    "softplus": lambda x: np.logaddexp(0.0, x),
}


class ForceEvaluation:
    """phi of a `ForceModel` on the CPU. Its parameters are shared, not copied."""

    def __init__(self, model: ForceModel) -> None:
        network = model.network
        self._fade, self._scale = model.fade, float(model.traction_scale)
        self._confidence = ConfidenceEvaluation(model.confidence)
        self._mean, self._spread = _shared(model.local_mean), _shared(model.local_scale)
        self._depth_mean, self._depth_spread = float(model.depth_mean), float(model.depth_scale)
        assert network.shared is not None  # the depth of the contact
        self._by_depth = _shared(network.shared.weight)[:, 0]
        layers = (network.local, *network.hidden, network.head)
        self._layers = [(_shared(layer.weight).T, _shared(layer.bias)) for layer in layers]
        self._activation = _ACTIVATIONS[model.options.activation]

    @property
    def dtype(self) -> np.dtype[np.floating[Any]]:
        """The type of the model."""
        return self._mean.dtype

    def forces(self, contact: ContactState) -> Floats:
        """phi and psi (m, 2 dim) [N] as of `ForceModel`, in the precision of the model."""
        correction, confidence = self._corrected(contact)
        forces = confidence * correction
        forces[:, : contact.force.shape[1]] += contact.force
        return np.asarray(forces.astype(self.dtype))

    def confidence(self, contact: ContactState) -> float:
        """The factor in [0, 1] by which the correction of this contact is multiplied (`confidence.py`)."""
        return self._corrected(contact)[1]

    def _corrected(self, contact: ContactState) -> tuple[Floats, float]:
        """(m, 2 dim) [N], of phi and of psi, and its confidence."""
        force, depth = contact.force, contact.depth
        z = (contact.inputs.astype(self.dtype) - self._mean) / self._spread
        D = (depth - self._depth_mean) / self._depth_spread
        y = self._network(_saturated(z), D).reshape(len(z), 2, -1)
        forces = force[:, None] * y[..., :1] + self._scale * (y[..., 1:] @ contact.lever)
        correction = (self._fade.value(depth) * forces).reshape(len(z), -1)
        return correction, self._confidence.of(z, D, force, correction)

    def _network(self, local: Floats, depth: float) -> Floats:
        """y (m, 2 (1 + DIRECTIONS)) of normalised inputs."""
        (first, bias), *hidden, (head, last) = self._layers
        shared = _saturated(depth) * self._by_depth
        h = self._activation(local @ first + (bias + shared.astype(local.dtype)))
        for weight, offset in hidden:
            h = self._activation(h @ weight + offset)
        return h @ head + last


def _saturated(z: Any) -> Any:
    """See `model.saturated`."""
    return SATURATION * np.tanh(z / SATURATION)


def _shared(parameter: Tensor) -> Floats:
    return np.asarray(parameter.detach().numpy())
