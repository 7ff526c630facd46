"""The contact model: encoding, normalisation, network and fade in one module, used by training and by
inference.

    r = s phi(D) N(a, b),        u = R r        (thesis eqs. 5.2 to 5.4; r in collider space)

with local inputs a of a point, shared inputs b of the contact (both normalised), s [m] the output scale and D
the depth of the contact patch. The fade phi reduces the field to zero as contact opens, see `fade.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import torch
from torch import Tensor

from softprint.runtime.learned.contact_patch import n_shared_inputs
from softprint.runtime.learned.fade import Fade
from softprint.runtime.learned.form import LearnedModel, ModelOptions
from softprint.runtime.learned.network import Mlp, spread
from softprint.runtime.learned.point_states import PointStates
from softprint.runtime.learned.thesis5.inputs import ENCODINGS


@dataclass(frozen=True)
class ContactCentricOptions(ModelOptions):
    """Architecture of a contact model; stored in the header of its file.

    encoding: local inputs, see `inputs.py`; patch_inputs: whether the network also has the shared inputs of the contact
    patch; widths: neurons of each hidden layer; fade, fade_depth [m]: see the module.
    """

    encoding: Literal["weighted_rows", "all_rows", "local_geometry"]
    patch_inputs: bool
    widths: tuple[int, ...]
    activation: Literal["tanh", "silu", "softplus", "elu"]
    fade: Literal["saturating", "proportional"]
    fade_depth: float


class ContactCentricModel(LearnedModel):
    """r(a, b, D) for bodies with n_rows handle rows in dim dimensions. Buffers hold the normalisation."""

    form: ClassVar[str] = "thesis5"
    options: ContactCentricOptions
    local_mean: Tensor
    local_scale: Tensor
    shared_mean: Tensor
    shared_scale: Tensor
    output_scale: Tensor

    def __init__(self, options: ContactCentricOptions, dim: int, n_rows: int) -> None:
        super().__init__()
        self.options, self.dim, self.n_rows = options, dim, n_rows
        self.encoding = ENCODINGS[options.encoding]
        self.fade = Fade(options.fade, options.fade_depth)
        n_local = self.encoding.n_inputs(dim, n_rows)
        n_shared = n_shared_inputs(dim) if options.patch_inputs else 0
        self.network = Mlp(n_local, n_shared, options.widths, dim, options.activation)
        self.register_buffer("local_mean", torch.zeros(n_local))
        self.register_buffer("local_scale", torch.ones(n_local))
        self.register_buffer("shared_mean", torch.zeros(n_shared))
        self.register_buffer("shared_scale", torch.ones(n_shared))
        self.register_buffer("output_scale", torch.ones(()))

    @torch.no_grad()
    def normalise(self, local: Tensor, shared: Tensor, depth: Tensor, displacement: Tensor) -> None:
        """Set the normalisation from inputs (n, n_local), (samples, n_shared), patch depths (samples,) and
        the displacements (n, dim) in collider space."""
        self.local_mean.copy_(local.mean(0))
        self.local_scale.copy_(spread(local))
        if self.shared_mean.numel():
            self.shared_mean.copy_(shared.mean(0))
            self.shared_scale.copy_(spread(shared))
        self.output_scale.copy_(displacement.square().mean().sqrt() / self.fade.value(depth.mean()))

    def shared_inputs(self, shared: Tensor) -> Tensor:
        """Normalised shared inputs; none where the model does not use them."""
        if not self.options.patch_inputs:
            return shared[..., :0]
        return (shared - self.shared_mean) / self.shared_scale

    def forward(self, state: PointStates, shared: Tensor, depth: Tensor) -> Tensor:
        """r (..., n, dim) [m] in collider space; shared (..., n_shared) and depth (...) of each contact."""
        local = (self.encoding.encode(state) - self.local_mean) / self.local_scale
        values = self.network(local, self.shared_inputs(shared))
        return (self.output_scale * self.fade.value(depth))[..., None, None] * values

    @torch.no_grad()
    def linearise(
        self, state: PointStates, shared: Tensor, shared_slope: Tensor, depth: Tensor, rotation: Tensor
    ) -> tuple[Tensor, Tensor]:
        """u = R r (n, dim) [m] in the world and du/drows (n, dim, n_rows, dim) of one contact.

        shared_slope: (n_shared, n_rows, dim) derivatives of the shared inputs, the first of which is D.
        """
        local = (self.encoding.encode(state) - self.local_mean) / self.local_scale
        y = self.network.derivatives(local, self.shared_inputs(shared), rotation)
        factor = self.output_scale * self.fade.value(depth)
        jacobian = self.encoding.pull_back(state, y.local * (factor / self.local_scale), rotation)
        # Terms through the shared inputs: the slope of the fade along dD, and the network's own.
        by_depth = (self.output_scale * self.fade.slope(depth)) * y.value
        if self.options.patch_inputs:
            to_shared = y.shared * (factor / self.shared_scale)
            to_shared[..., 0] += by_depth
        else:
            to_shared, shared_slope = by_depth[..., None], shared_slope[:1]
        jacobian = jacobian + torch.tensordot(to_shared, shared_slope, dims=1)
        return factor * y.value, jacobian
