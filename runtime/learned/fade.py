"""Fade functions: factors that take a learned field to zero as contact opens. The thesis has none (its network does not
vanish there).

phi(D) of the depth D of the contact patch is C1, and zero with zero slope at D = 0:

    saturating     phi = D^2 / (D^2 + d^2)      1 in deep contact: the network is the thesis's
    proportional   phi = D^2 / (D + d) / d      ~ D in deep contact: the network learns displacement per depth

Networks are trained with this factor included.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeVar

from torch import Tensor

Depth = TypeVar("Depth", float, Tensor)


@dataclass(frozen=True)
class Fade:
    """depth: d [m]."""

    kind: Literal["saturating", "proportional"]
    depth: float

    def value(self, depth: Depth) -> Depth:
        """phi(D)."""
        d = self.depth
        return depth**2 / (depth**2 + d**2) if self.kind == "saturating" else depth**2 / ((depth + d) * d)

    def slope(self, depth: Depth) -> Depth:
        """dphi/dD [1/m]."""
        d = self.depth
        if self.kind == "saturating":
            return 2.0 * depth * d**2 / (depth**2 + d**2) ** 2
        return depth * (depth + 2.0 * d) / ((depth + d) ** 2 * d)
