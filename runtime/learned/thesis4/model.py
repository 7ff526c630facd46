"""The network of an object-centric correction (thesis 4.3.3): a few principal components of a displacement in the
undeformed body, as functions of the collider relative to the handles.

    r(z, D) = phi(D) sum_k s_k N_k((z - mean) / spread) m_k

with z the interaction state (`inputs.py`), D the depth of the contact patch, phi the fade (`fade.py`), N a network of
tanh layers, m_k the principal components, orthonormal in the volumes of the nodes, and s their spreads. The thesis has
no fade: its network is asked near the body alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Self

import numpy as np
import torch
from torch import Tensor

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.kinds.sphere import Sphere
from softprint.runtime.colliders.shape_samples import shape_samples
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.fade import Fade
from softprint.runtime.learned.form import LearnedModel, ModelOptions
from softprint.runtime.learned.internal.tanh_network import TanhNetwork, tanh_network
from softprint.runtime.learned.network import Mlp, spread

# Of a collider of the same shape, sizes outside the trained range by this share of themselves are still taken, and
# signed distances may differ by this share of the size: a mesh of a ball is a ball.
SAME_SIZE, SAME_SHAPE = 0.01, 0.02


@dataclass(frozen=True)
class ObjectCentricOptions(ModelOptions):
    """Architecture of an object-centric correction.

    widths: neurons of each hidden layer; components: number of principal components; n_inputs: of the network; n_nodes:
    of the body; parameters: of the collider, which are inputs too (`inputs.PARAMETERS`); target: what contact adds, or
    all that the subspace lacks; fade, fade_depth [m]: see the module.
    """

    widths: tuple[int, ...]
    components: int
    n_inputs: int
    n_nodes: int
    parameters: tuple[str, ...]
    target: Literal["contact", "whole"]
    fade: Literal["saturating", "proportional"]
    fade_depth: float

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Self:
        """See `ModelOptions`."""
        return super().from_json({**values, "parameters": tuple(values["parameters"])})


class ObjectCentricModel(LearnedModel):
    """c(z, D) of a body with n_rows handle rows in dim dimensions. Buffers: modes m (components, n_nodes, dim)
    [m^(-dim/2)], coefficient_scale s (components,) [m m^(dim/2)], input_mean and input_scale (n_inputs,); shape: that
    of the colliders it was trained with, at size one; sizes (2,): the least and largest of them [m]."""

    form: ClassVar[str] = "thesis4"
    options: ObjectCentricOptions
    modes: Tensor
    coefficient_scale: Tensor
    input_mean: Tensor
    input_scale: Tensor
    shape: Tensor
    sizes: Tensor

    def __init__(self, options: ObjectCentricOptions, dim: int, n_rows: int) -> None:
        super().__init__()
        self.options, self.dim, self.n_rows = options, dim, n_rows
        self.fade = Fade(options.fade, options.fade_depth)
        count, n_inputs = options.components, options.n_inputs
        self.network = Mlp(n_inputs, 0, options.widths, count, "tanh")
        self.register_buffer("modes", torch.zeros(count, options.n_nodes, dim))
        self.register_buffer("coefficient_scale", torch.ones(count))
        self.register_buffer("input_mean", torch.zeros(n_inputs))
        self.register_buffer("input_scale", torch.ones(n_inputs))
        self.register_buffer("shape", torch.zeros(n_samples(dim)))
        self.register_buffer("sizes", torch.zeros(2))

    @torch.no_grad()
    def normalise(self, z: Tensor) -> None:
        """Set the normalisation from inputs (n, n_inputs)."""
        self.input_mean.copy_(z.mean(0))
        self.input_scale.copy_(spread(z))

    def forward(self, z: Tensor, depth: Tensor) -> Tensor:
        """Coefficients of the components (n, components) of inputs z (n, n_inputs) and depths (n,)."""
        value = self.network((z - self.input_mean) / self.input_scale, z.new_zeros(len(z), 0))
        return self.fade.value(depth)[:, None] * self.coefficient_scale * value

    @torch.no_grad()
    def as_arrays(self) -> TanhNetwork:
        """The same function of one input z, without the fade, in NumPy and double precision."""
        scale = self.coefficient_scale.double().numpy()
        return tanh_network(self.network, self.input_mean, self.input_scale, scale)

    def require(self, collider: Collider, name: str) -> None:
        """Raise SoftprintError where the correction `name` was not trained for this shape, or not for this size."""
        shape, size = unit_shape(collider), collider.size
        known = self.shape.double().numpy()
        if shape.shape != known.shape or np.abs(shape - known).max() > SAME_SHAPE:
            raise SoftprintError(
                f"correction {name!r} was trained for another shape than that of collider {collider.name!r}: an "
                "object-centric correction knows one shape, so train it for this one"
            )
        least, largest = self.sizes.tolist()
        if not least * (1.0 - SAME_SIZE) <= size <= largest * (1.0 + SAME_SIZE):
            trained = f"{least:.3g} m" if least == largest else f"{least:.3g} to {largest:.3g} m"
            raise SoftprintError(
                f"correction {name!r} was trained for colliders of size {trained}, and {collider.name!r} has "
                f'{size:.3g} m: train it with that size too, and parameters = ["size"]'
            )


def n_samples(dim: int) -> int:
    """The length of `unit_shape` in so many dimensions."""
    return len(shape_samples(Sphere(1.0, dim)))


def unit_shape(collider: Collider) -> Array:
    """The `shape_samples` of a collider, in units of its size."""
    return np.asarray(shape_samples(collider) / collider.size)
