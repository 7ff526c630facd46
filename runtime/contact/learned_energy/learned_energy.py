"""The learned energy of condensed contact: how it departs from that of linear mechanics, for any collider.

Linear mechanics gives the energy W of a contact and of its dent as a function of the handle rows and the poses
(`runtime/contact/linearised/`). Two measures of the dent correct it (`runtime/contact/dents/dent_measures.py`): the
strain that the body has without the dent makes the flesh there stiffer or softer, by sigma; and the body hardens as its
dent grows, by the excess chi,

    W~ = W exp(sigma) (1 + chi)^b.

The material and linear mechanics give both measures. That sigma counts once is what a strain does to first order; only
how much of the excess counts, b, is learned, so that it holds for dents much deeper than those of training. The smaller
a dent is, the nearer is its energy to that of linear mechanics in the strained body; with exp(b chi) shallow dents
would be too stiff where deep ones are right (docs/method.md, the learned energy). Contacts that lie apart are dents of
their own, with energies that add up.
Derivatives of W~ by W and the measures are in closed form, so that forces are exact, whatever the solve depends on
(`hardened_contact.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.contact.dents.ratio_functions import RatioFunction, continued_logarithm

#: The least and the largest b. From the least on W~ grows with the dent: chi grows by at most 10 d|H|/|H|, as no solid
#: here has an energy of more than the twelfth power of H where that is large, and W grows with H^2 at least. At the
#: largest nothing relaxes that linear mechanics displaces too much.
LEAST, MOST = -0.2, 1.0


class EnergyTerms(NamedTuple):
    """W~ [J], and its derivatives by (log W, sigma, chi) (3,), (3, 3) [J]."""

    value: float
    slope: Array
    curvature: Array


def hardening(excess: float) -> RatioFunction:
    """eta = log(1 + chi) and its derivatives, see `continued_logarithm`."""
    return continued_logarithm(np.asarray(excess))


@dataclass(frozen=True)
class LearnedEnergy:
    """growth: b of the module. Of mechanics, or `held`, are energies that sigma does not count in, with a ratio to that
    of linear mechanics."""

    growth: float
    ratio: float = 1.0
    is_proportional: bool = False

    @classmethod
    def of_mechanics(cls) -> LearnedEnergy:
        """W~ = W: that of linear mechanics."""
        return cls(0.0, is_proportional=True)

    @classmethod
    def of(cls, values: tuple[float, ...]) -> LearnedEnergy:
        """From `values`. Raises ValueError where they are not of an energy that grows with that of mechanics."""
        if len(values) != 1 or not np.isfinite(values).all():
            raise ValueError(f"a learned energy has one finite value, not {values}")
        (growth,) = values
        if not LEAST <= growth <= MOST:
            raise ValueError(
                f"a learned energy with b = {growth:g} does not grow: it needs {LEAST:g} <= b <= {MOST:g}"
            )
        return cls(growth)

    @property
    def values(self) -> tuple[float, ...]:
        """(b,)."""
        return (self.growth,)

    def held(self, ratio: float) -> LearnedEnergy:
        """W~ = ratio W."""
        return LearnedEnergy(0.0, ratio, is_proportional=True)

    def terms(self, energy: float, stiffening: float, excess: float) -> EnergyTerms:
        """W~ at an energy W [J] of mechanics, and the measures sigma and chi."""
        eta, counted = hardening(excess), 0.0 if self.is_proportional else 1.0
        value = self.ratio * energy * float(np.exp(counted * stiffening + self.growth * eta.value))
        slope = np.array([1.0, counted, self.growth * float(eta.slope)])
        curvature = np.outer(slope, slope)
        curvature[2, 2] += self.growth * eta.bend
        return EnergyTerms(value, value * slope, value * curvature)
