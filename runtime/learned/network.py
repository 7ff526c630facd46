"""A multilayer perceptron whose Jacobian is formed by hand, in one backward sweep of matrix products.

The network has only dim outputs, so its whole Jacobian costs dim backward passes. They run together as one
stack of dim rows per point, without the overhead of automatic differentiation:

    h_0 = act(A a + B b + c),   h_k = act(W_k h_{k-1} + c_k),   y = V h_L + d
    dy/da = V D_L W_L D_{L-1} ... W_1 D_0 A,   D_k = diag(act'(.))

with a the *local* inputs of a point and b the *shared* inputs of the whole contact, whose product B b is
computed once. The hidden layers dominate the cost; they are evaluated in chunks that fit into the cache.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, cast

import torch
from torch import Tensor, nn

# Points in a chunk: 512 to 1,024 were fastest on a CPU.
CHUNK = 768


@dataclass(frozen=True)
class Activation:
    """A scalar function, and its slope as a function of the argument x and the value y (whichever is cheaper)."""

    value: Callable[[Tensor], Tensor]
    slope: Callable[[Tensor, Tensor], Tensor]


def _silu_slope(x: Tensor, y: Tensor) -> Tensor:
    sigmoid = torch.sigmoid(x)
    return sigmoid + y * (1.0 - sigmoid)


ACTIVATIONS = {
    "tanh": Activation(torch.tanh, lambda x, y: 1.0 - y * y),
    "silu": Activation(nn.functional.silu, _silu_slope),
    "softplus": Activation(nn.functional.softplus, lambda x, y: torch.sigmoid(x)),
    "elu": Activation(nn.functional.elu, lambda x, y: torch.where(x > 0.0, 1.0, y + 1.0)),
}


class NetworkDerivatives(NamedTuple):
    """value (n, n_out); local (n, n_out, n_local) = dy/da; shared (n, n_out, n_shared) = dy/db."""

    value: Tensor
    local: Tensor
    shared: Tensor


class Mlp(nn.Module):
    """`widths` hidden layers between n_local + n_shared inputs and n_out outputs."""

    def __init__(
        self, n_local: int, n_shared: int, widths: tuple[int, ...], n_out: int, activation: str
    ) -> None:
        super().__init__()
        self.local = nn.Linear(n_local, widths[0])
        self.shared = nn.Linear(n_shared, widths[0], bias=False) if n_shared else None
        self.hidden = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(widths))
        self.head = nn.Linear(widths[-1], n_out)
        self.n_shared = n_shared
        self.activation = ACTIVATIONS[activation]

    def forward(self, local: Tensor, shared: Tensor) -> Tensor:
        """y (..., n, n_out) of local inputs (..., n, n_local) and shared inputs (..., n_shared)."""
        h = self.local(local)
        if self.shared is not None:
            h = h + self.shared(shared)[..., None, :]
        h = self.activation.value(h)
        for layer in self.hidden:
            h = self.activation.value(layer(h))
        return self.head(h)

    def along(self, local: Tensor, directions: Tensor) -> tuple[Tensor, Tensor]:
        """y (n, n_out) of local inputs (n, n_local) alone, and its derivatives (n, k, n_out) along directions (n, k,
        n_local). Both can be differentiated by the weights."""
        h, moved = local, directions
        for layer in (self.local, *self.hidden):
            x = layer(h)
            h = self.activation.value(x)
            moved = self.activation.slope(x, h)[:, None, :] * (moved @ cast(nn.Linear, layer).weight.T)
        return self.head(h), moved @ self.head.weight.T

    @torch.no_grad()
    def derivatives(self, local: Tensor, shared: Tensor, rotation: Tensor) -> NetworkDerivatives:
        """rotation @ y and both of its Jacobians, for local inputs (n, n_local) of one contact with shared inputs
        (n_shared,); rotation: (n_out, n_out), applied to the output layer at no cost."""
        offset = self.local.bias if self.shared is None else self.local.bias + self.shared(shared)
        head, bias = rotation @ self.head.weight, rotation @ self.head.bias
        parts = [self._chunk(part, offset, head, bias) for part in local.split(CHUNK)]
        return NetworkDerivatives(*(torch.cat(columns) for columns in zip(*parts, strict=True)))

    def _chunk(
        self, local: Tensor, offset: Tensor, head: Tensor, bias: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        x = torch.addmm(offset, local, self.local.weight.T)
        y = self.activation.value(x)
        slopes = [self.activation.slope(x, y)]
        for layer in self.hidden:
            x = layer(y)
            y = self.activation.value(x)
            slopes.append(self.activation.slope(x, y))
        n, n_out = len(local), len(head)
        back = head * slopes[-1][:, None, :]
        for layer, slope in zip(reversed(list(self.hidden)), reversed(slopes[:-1]), strict=True):
            weight = cast(nn.Linear, layer).weight
            back = (back.view(n * n_out, -1) @ weight).view(n, n_out, -1)
            back *= slope[:, None, :]
        flat = back.view(n * n_out, -1)
        to_local = (flat @ self.local.weight).view(n, n_out, -1)
        if self.shared is None:
            to_shared = local.new_zeros(n, n_out, 0)
        else:
            to_shared = (flat @ self.shared.weight).view(n, n_out, -1)
        return torch.addmm(bias, y, head.T), to_local, to_shared


def spread(values: Tensor) -> Tensor:
    """Standard deviation of every column; 1 for a constant column."""
    spread = values.std(0)
    return torch.where(spread > 1e-6 * values.abs().amax(0).clamp(min=1e-30), spread, torch.ones_like(spread))
