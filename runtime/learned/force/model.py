"""What the network adds to the mechanics: corrected contact forces, under any collider.

    phi_j = l_j + t fade(D) [ y_0 l_j + w_j c F_j^T sum_k y_k v_jk ],        u_X = F_X sum_j G_Xj phi_j

l_j the load that balances a linearly elastic body (`equilibrium.py`), w_j [m^(dim-1)] an area that fades with
distance, D the depth of the contact, t how far it is believed (`confidence.py`), c [N/m^(dim-1)] a scale, v_jk
directions that the contact itself gives, and y(a_j, D) a network that runs on the few loads in contact and not on
all points of the body. Its inputs a_j are invariants of the contact at the load and around it (`contact_state.py`):
body and collider may be turned together, or the collider's axes chosen otherwise, and nothing changes but that u
turns along. Nothing is told of which collider it is, or where on it. With y = 0 the field is that of linear elasticity.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

import torch
from torch import Tensor, nn

from runtime.learned.fade import Fade
from runtime.learned.force.confidence import Confidence
from runtime.learned.force.inputs import DIRECTIONS, least_spread, n_contact_inputs
from runtime.learned.network import Mlp, spread

SATURATION = 4.0  # R


@dataclass(frozen=True)
class ForceModelOptions:
    """widths, activation: of the network; fade_depth [m]: its share fades out below; band [m]: how far
    outside the collider loads take part; stiffness: of the penalty contact [N/m^4]."""

    widths: tuple[int, ...]
    activation: Literal["tanh", "silu", "softplus", "elu"]
    fade_depth: float
    band: float
    stiffness: float

    def to_json(self) -> dict[str, Any]:
        """As plain values for a file's header."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> ForceModelOptions:
        """From the values of :meth:`to_json`; TypeError or KeyError where they are not such."""
        return cls(**{**values, "widths": tuple(values["widths"])})


class ForceModel(nn.Module):
    """phi(loads) for bodies in dim dimensions with n_rows handle rows. Buffers hold the normalisation."""

    local_mean: Tensor
    local_scale: Tensor
    depth_mean: Tensor
    depth_scale: Tensor
    traction_scale: Tensor

    def __init__(self, options: ForceModelOptions, dim: int, n_rows: int) -> None:
        super().__init__()
        self.options, self.dim, self.n_rows = options, dim, n_rows
        n_local = n_contact_inputs(dim)
        self.network = Mlp(n_local, 1, options.widths, 1 + DIRECTIONS, options.activation)
        # Untrained, the field is that of linear elasticity.
        nn.init.zeros_(self.network.head.weight)
        nn.init.zeros_(self.network.head.bias)
        self.fade = Fade("saturating", options.fade_depth)
        self.trust = Confidence(n_local)
        self.register_buffer("local_mean", torch.zeros(n_local))
        self.register_buffer("local_scale", torch.ones(n_local))
        self.register_buffer("depth_mean", torch.zeros(1))
        self.register_buffer("depth_scale", torch.ones(1))
        self.register_buffer("traction_scale", torch.ones(()))

    @torch.no_grad()
    def normalise(self, local: Tensor, depth: Tensor, load: Tensor, lever: Tensor) -> None:
        """Set the normalisation from inputs (n, n_local) and (samples,), and from loads (n, dim) with their levers (n,
        DIRECTIONS, dim), so that outputs of order one correct the loads by their size."""
        self.local_mean.copy_(local.mean(0))
        least = torch.from_numpy(least_spread(self.dim)).to(local)
        self.local_scale.copy_(torch.maximum(spread(local), least))
        self.depth_mean.copy_(depth.mean())
        self.depth_scale.copy_(spread(depth[:, None]))
        self.traction_scale.copy_(
            load.square().sum(-1).mean().sqrt() / lever.square().sum((-1, -2)).mean().sqrt()
        )

    def forward(self, local: Tensor, depth: Tensor, load: Tensor, lever: Tensor) -> Tensor:
        """phi (..., m, dim) [N] from the columns of `ContactState`: inputs a (..., m, n_local), D (...), loads (..., m,
        dim) and levers (..., m, DIRECTIONS, dim)."""
        correction = self.correction(local, depth, load, lever)
        return load + self.trust(self.normalised(local), load, correction) * correction

    def correction(self, local: Tensor, depth: Tensor, load: Tensor, lever: Tensor) -> Tensor:
        """fade(D) [y_0 l + c sum_k y_k w F^T v_k] (..., m, dim), believed or not."""
        y = self.network(saturated(self.normalised(local)), self._depth(depth))
        traction = torch.einsum("...ki,...k->...i", lever, y[..., 1:])
        return self.fade.value(depth)[..., None, None] * (load * y[..., :1] + self.traction_scale * traction)

    def normalised(self, local: Tensor) -> Tensor:
        """z of inputs (..., n_local): mean zero and spread one over what was learned from."""
        return (local - self.local_mean) / self.local_scale

    def _depth(self, depth: Tensor) -> Tensor:
        return saturated((depth[..., None] - self.depth_mean) / self.depth_scale)


def saturated(z: Tensor) -> Tensor:
    """R tanh(z / R) of normalised inputs: what lies far from all that was learned from is told apart no further, and so
    the correction of a contact of another kind stays as small as those that were learned."""
    return SATURATION * torch.tanh(z / SATURATION)
