"""Models of an internal correction (thesis 4.3.3): a few principal components, as functions of the reduced state.

    r(q) = sum_k s_k (L_k z / s_z + N_k(z / s_z) - N_k(0)) m_k

with z the rigid-free rows (`inputs.py`), N a network of tanh layers, m_k the principal components, orthonormal in the
volumes of the nodes, and s their spreads. L, where there is one, is the linear part, fitted before N is trained: with
it the network learns what is nonlinear. Without gravity the correction at rest is zero, and so it is here; under
gravity z knows how the body lies, and N(0) is not subtracted. Or, without a network, they are quadratic in z
(`quadratic_map.py`), or follow from the elasticity of the body (`equilibrium/`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
import torch
from torch import Tensor

from softprint.runtime.arrays import Array
from softprint.runtime.learned.form import LearnedModel, ModelOptions
from softprint.runtime.learned.internal.quadratic_map import QuadraticMap
from softprint.runtime.learned.internal.tanh_network import TanhNetwork, tanh_network
from softprint.runtime.learned.network import Mlp


@dataclass(frozen=True)
class InternalOptions(ModelOptions):
    """Architecture of an internal correction. widths: neurons of each hidden layer; components: number of principal
    components; linear: whether there is a linear part; on_condensation: whether it adds to the static condensation of
    the body, or to U q alone; gravity: (dim,) [m/s^2] of its training, empty without."""

    widths: tuple[int, ...]
    components: int
    linear: bool
    on_condensation: bool
    gravity: tuple[float, ...] = ()

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Self:
        """See `ModelOptions`."""
        return super().from_json({**values, "gravity": tuple(values.get("gravity", ()))})


@dataclass(frozen=True)
class ModesOptions(ModelOptions):
    """Of modes in elastic equilibrium. components: number of modes; gravity: (dim,) [m/s^2] of their states, empty
    without; widths: of no network."""

    components: int
    gravity: tuple[float, ...] = ()
    widths: tuple[int, ...] = ()

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Self:
        """See `ModelOptions`."""
        return super().from_json({**values, "gravity": tuple(values["gravity"])})


class ModesModel(LearnedModel):
    """Modes of a body with n_nodes nodes and n_rows handle rows in dim dimensions, without a network. Buffers: modes
    (components, n_nodes, dim); linear (components, n_inputs) and offset (components,) of a first estimate of their
    amplitudes, linear in the inputs z."""

    form: ClassVar[str] = "equilibrium"
    line: ClassVar[str] = "modes in elastic equilibrium"
    options: ModesOptions
    modes: Tensor
    linear: Tensor
    offset: Tensor

    def __init__(self, options: ModesOptions, dim: int, n_rows: int, n_nodes: int) -> None:
        super().__init__()
        self.options, self.dim, self.n_rows = options, dim, n_rows
        count, n_inputs = options.components, n_rows * dim + len(options.gravity)
        self.register_buffer("modes", torch.zeros(count, n_nodes, dim))
        self.register_buffer("linear", torch.zeros(count, n_inputs))
        self.register_buffer("offset", torch.zeros(count))

    def estimate(self) -> tuple[Array, Array]:
        """linear and offset, in double precision."""
        return self.linear.double().numpy(), self.offset.double().numpy()


@dataclass(frozen=True)
class QuadraticOptions(ModelOptions):
    """Of a quadratic correction. components: number of principal components; directions: in which the inputs change;
    on_condensation and gravity: see `InternalOptions`; widths: of no network."""

    components: int
    directions: int
    on_condensation: bool
    gravity: tuple[float, ...] = ()
    widths: tuple[int, ...] = ()

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Self:
        """See `ModelOptions`."""
        return super().from_json({**values, "gravity": tuple(values["gravity"])})


class QuadraticModel(LearnedModel):
    """Coefficients that are quadratic in the inputs z, of a body with n_nodes nodes and n_rows handle rows in dim
    dimensions. Buffers: modes m (components, n_nodes, dim), and those of `QuadraticMap`: directions P (n_inputs, r),
    offset (components,), zero without gravity, linear L (components, r), quadratic Q (components, r, r)."""

    form: ClassVar[str] = "quadratic"
    line: ClassVar[str] = "principal components, quadratic in the state"
    options: QuadraticOptions
    modes: Tensor
    directions: Tensor
    offset: Tensor
    linear: Tensor
    quadratic: Tensor

    def __init__(self, options: QuadraticOptions, dim: int, n_rows: int, n_nodes: int) -> None:
        super().__init__()
        self.options, self.dim, self.n_rows = options, dim, n_rows
        count, r, n_inputs = options.components, options.directions, n_rows * dim + len(options.gravity)
        self.register_buffer("modes", torch.zeros(count, n_nodes, dim))
        self.register_buffer("directions", torch.zeros(n_inputs, r))
        self.register_buffer("offset", torch.zeros(count))
        self.register_buffer("linear", torch.zeros(count, r))
        self.register_buffer("quadratic", torch.zeros(count, r, r))

    def as_arrays(self) -> QuadraticMap:
        """The function, in NumPy and double precision."""
        parts = self.directions, self.offset, self.linear, self.quadratic
        return QuadraticMap(*(part.double().numpy() for part in parts))


class InternalModel(LearnedModel):
    """r(z) of a body with n_nodes nodes and n_rows handle rows in dim dimensions. Buffers: modes m (components,
    n_nodes, dim) [m^(-dim/2)], coefficient_scale s (components,) [m m^(dim/2)], input_scale s_z (n_inputs,), linear
    L (components, n_inputs), zero where there is none."""

    form: ClassVar[str] = "internal"
    line: ClassVar[str] = "principal components with a network"
    options: InternalOptions
    modes: Tensor
    coefficient_scale: Tensor
    input_scale: Tensor
    linear: Tensor

    def __init__(self, options: InternalOptions, dim: int, n_rows: int, n_nodes: int) -> None:
        super().__init__()
        self.options, self.dim, self.n_rows = options, dim, n_rows
        count, n_inputs = options.components, n_rows * dim + len(options.gravity)
        self.network = Mlp(n_inputs, 0, options.widths, count, "tanh")
        self.register_buffer("modes", torch.zeros(count, n_nodes, dim))
        self.register_buffer("coefficient_scale", torch.ones(count))
        self.register_buffer("input_scale", torch.ones(n_inputs))
        self.register_buffer("linear", torch.zeros(count, n_inputs))

    def forward(self, z: Tensor) -> Tensor:
        """Coefficients of the components (..., components) of inputs z (..., n_inputs)."""
        scaled = z / self.input_scale
        value = self.network(scaled, z.new_zeros(*z.shape[:-1], 0))
        return self._coefficients(scaled, value)

    def along(self, z: Tensor, directions: Tensor) -> tuple[Tensor, Tensor]:
        """Coefficients (b, components) of inputs z (b, n_inputs), and their derivatives (b, k, components) along
        directions (b, k, n_inputs)."""
        scaled = z / self.input_scale
        moved = directions / self.input_scale
        value, slope = self.network.along(scaled, moved)
        return self._coefficients(scaled, value), self.coefficient_scale * (moved @ self.linear.T + slope)

    @torch.no_grad()
    def as_arrays(self) -> TanhNetwork:
        """The same function of one input z, in NumPy and double precision."""
        scale, spread = self.coefficient_scale.double().numpy(), self.input_scale
        network = tanh_network(self.network, torch.zeros_like(spread), spread, scale)
        at_rest = 0.0 if self.options.gravity else network.value(np.zeros(len(spread)))
        linear = scale[:, None] * (self.linear.double() / spread.double()).numpy()
        return replace(network, offset=network.offset - at_rest, linear=linear)

    def _coefficients(self, scaled: Tensor, value: Tensor) -> Tensor:
        """Of scaled inputs and the network's value there."""
        found = scaled @ self.linear.T + value
        if not self.options.gravity:
            found = found - self.network(scaled.new_zeros(1, scaled.shape[-1]), scaled.new_zeros(0))[0]
        return self.coefficient_scale * found
