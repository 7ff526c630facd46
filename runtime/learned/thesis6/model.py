"""The network of thesis 6.2.4: contact deformation from the local descriptor of any collider.

    r = s N(phi, W(X) R^-1 T^-1 (q - x)),        u = a(phi_0) b(g) D^2 / (D^2 + D_0^2) T R r   (thesis eqs. 6.1 and 6.5)

with W = diag(U(X)); of frames, x is subtracted from the translation row alone. s [m] is the output scale, a the
attenuation at distance d, and b that where the smoothed gradient g defines no normal. The factor with the depth D of
the contact reduces the field to zero as contact opens: the local inputs of one point do not show whether the body is
touched anywhere (see `fade.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import torch
from torch import Tensor

from softprint.runtime.arrays import Array
from softprint.runtime.learned.fade import Fade
from softprint.runtime.learned.form import LearnedModel, ModelOptions
from softprint.runtime.learned.network import Mlp, spread
from softprint.runtime.learned.thesis6.descriptors import LocalDescriptor
from softprint.runtime.learned.thesis6.descriptors.local_descriptor import Samples


@dataclass(frozen=True)
class DescriptorModelOptions(ModelOptions):
    """Architecture of a descriptor model; stored in the header of its file.

    widths: neurons of each hidden layer; radius: d [m]; sets: of differences in the smoothed gradient, 0 for the raw
    gradient; samples: of the descriptor; fade_depth: D_0 [m].
    """

    widths: tuple[int, ...]
    activation: Literal["tanh", "silu", "softplus", "elu"]
    radius: float
    sets: int
    samples: Samples
    fade_depth: float


class DescriptorModel(LearnedModel):
    """r for bodies with n_rows handle rows in dim dimensions. Buffers hold the normalisation of the inputs, and s."""

    form: ClassVar[str] = "thesis6"
    options: DescriptorModelOptions
    mean: Tensor
    scale: Tensor
    output_scale: Tensor

    def __init__(self, options: DescriptorModelOptions, dim: int, n_rows: int) -> None:
        super().__init__()
        self.options, self.dim, self.n_rows = options, dim, n_rows
        self.descriptor = LocalDescriptor(dim, options.radius, options.samples)
        self.fade = Fade("saturating", options.fade_depth)
        n_inputs = len(self.descriptor) + n_rows * dim
        self.network = Mlp(n_inputs, 0, options.widths, dim, options.activation)
        self.register_buffer("mean", torch.zeros(n_inputs))
        self.register_buffer("scale", torch.ones(n_inputs))
        self.register_buffer("output_scale", torch.ones(()))

    @torch.no_grad()
    def normalise(self, inputs: Tensor, output_scale: Tensor) -> None:
        """Set the normalisation from inputs (n, n_inputs)."""
        self.mean.copy_(inputs.mean(0))
        self.scale.copy_(spread(inputs))
        self.output_scale.copy_(output_scale)

    def forward(self, inputs: Tensor) -> Tensor:
        """r (..., dim) [m] in the contact frame; inputs (..., n_inputs), see `inputs_in_frame`."""
        return self.output_scale * self.network((inputs - self.mean) / self.scale, inputs[..., :0])

    @torch.no_grad()
    def evaluate(self, inputs: Array) -> Array:
        """r (n, dim) [m] of inputs (n, n_inputs)."""
        r: Array = self(torch.from_numpy(inputs).to(self.mean)).double().numpy()
        return r

    @torch.no_grad()
    def derivatives(self, inputs: Array) -> tuple[Array, Array]:
        """r (n, dim) [m] and dr/d inputs (n, dim, n_inputs)."""
        normalised = (torch.from_numpy(inputs).to(self.mean) - self.mean) / self.scale
        found = self.network.derivatives(normalised, normalised[0, :0], torch.eye(self.dim).to(self.mean))
        r, jacobian = self.output_scale * found.value, found.local * (self.output_scale / self.scale)
        return r.double().numpy(), jacobian.double().numpy()
