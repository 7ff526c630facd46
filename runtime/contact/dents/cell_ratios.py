"""Functions f(y) of ratios y = N / psi of energy densities in cells, and their derivatives.

With z the displacement gradient H of linear mechanics, followed by what else N depends on,

    d f = f'/psi s,    s = dN - y dpsi,
    d2f = f'/psi [d2N - y d2psi - (s dpsi^T + dpsi s^T) / psi] + f''/psi^2 s s^T.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.contact.dents.ratio_functions import RatioFunction
from softprint.runtime.lazy import lazy


class Density(NamedTuple):
    """An energy density (n,) [J/m^dim] and its derivatives by z (n, z) and (n, z, z), the second computed when
    called."""

    value: Array
    slope: Array
    bend: Callable[[], Array]


@dataclass(frozen=True, eq=False)
class CellRatios:
    """f(N / psi) in n cells. numerator: N; below: psi > 0, with its derivatives by H, of which z begins, alone."""

    f: RatioFunction
    numerator: Density
    below: Density

    @lazy
    def slope(self) -> Array:
        """df/dz (n, z)."""
        return np.asarray((self.f.slope / self.below.value)[:, None] * self._s)

    @lazy
    def bend(self) -> Array:
        """d2f/dz2 (n, z, z)."""
        N, psi, s, k = self.numerator, self.below, self._s, self.below.slope.shape[1]
        found = N.bend().copy()
        found[:, :k, :k] -= self._ratio[:, None, None] * psi.bend()
        crossed = (s / psi.value[:, None])[:, :, None] * psi.slope[:, None, :]
        found[:, :, :k] -= crossed
        found[:, :k, :] -= crossed.transpose(0, 2, 1)
        found *= (self.f.slope / psi.value)[:, None, None]
        found += (self.f.bend / psi.value**2)[:, None, None] * s[:, :, None] * s[:, None, :]
        return np.asarray(found)

    @lazy
    def _ratio(self) -> Array:
        """y (n,)."""
        return self.numerator.value / self.below.value

    @lazy
    def _s(self) -> Array:
        """(n, z)."""
        found = self.numerator.slope.copy()
        found[:, : self.below.slope.shape[1]] -= self._ratio[:, None] * self.below.slope
        return found
