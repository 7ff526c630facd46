"""The learned energy of condensed contact: how it departs from that of linear mechanics, for any collider.

Linear mechanics gives the energy W of a contact and of its dent as a function of the handle rows and the poses
(`runtime/contact/linearised/`). It is corrected twice. The compliance is scaled by the strain of the body
(`runtime/contact/carriers/compliance_scale.py`), which changes W. And the body hardens as its dent grows, for which the
excess chi of the dent (`dent_excess.py`) is the measure:

    W~ = a W exp eta(chi),    eta = b chi_0 tanh(chi / chi_0),    chi_0 = 2.

The material and linear mechanics give chi; only how much of it counts is learned, so that it holds for dents much
deeper than those of training. Where it is large, as under a tip, it says little: linear mechanics concentrates strain
there that the body spreads. Contacts that lie apart are dents of their own, with energies that add up. Derivatives of
W~ by W and chi are in closed form, so that forces are exact, whatever the solve depends on (`hardened_contact.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.contact.carriers.compliance_scale import N_COEFFICIENTS, ComplianceScale

#: The number of values of `LearnedEnergy.values`.
N_VALUES = N_COEFFICIENTS + 2
#: chi_0. Without it the force on a cone, pressed in by 20 mm with a tip of 2 mm radius, is two thirds too large, and
#: with half of it that on a ball of 40 mm a third too small at 28 mm.
LARGE = 2.0
#: The largest |b|. With b < 0, W~ grows with the dent up to 3: chi grows with W^(1/3), and t / cosh(t)^2 is below 0.45.
BOUND = 1.0


class EnergyTerms(NamedTuple):
    """W~ [J], and its derivatives by the measures (log W, chi) (2,), (2, 2) [J]."""

    value: float
    slope: Array
    curvature: Array


@dataclass(frozen=True)
class LearnedEnergy:
    """scale: of the compliance; first: a, and growth: b of the module."""

    scale: ComplianceScale
    first: float
    growth: float

    @classmethod
    def of_mechanics(cls) -> LearnedEnergy:
        """W~ = W: that of linear mechanics."""
        return cls(ComplianceScale((0.0,) * N_COEFFICIENTS), 1.0, 0.0)

    @classmethod
    def of(cls, values: tuple[float, ...]) -> LearnedEnergy:
        """From `values`. Raises ValueError where they are not of an energy that grows with that of mechanics."""
        if len(values) != N_VALUES or not np.isfinite(values).all():
            raise ValueError(f"a learned energy has {N_VALUES} finite values, not {values}")
        *coefficients, first, growth = values
        if first <= 0.0 or abs(growth) > BOUND:
            raise ValueError(
                f"a learned energy with a = {first:g} and b = {growth:g} does not grow: it needs a > 0 and |b| <= "
                f"{BOUND:g}"
            )
        return cls(ComplianceScale(tuple(coefficients)), first, growth)

    @property
    def values(self) -> tuple[float, ...]:
        """The coefficients of the scale, a and b (N_VALUES,)."""
        return *self.scale.coefficients, self.first, self.growth

    def held(self, ratio: float) -> LearnedEnergy:
        """W~ = ratio W, with the same scale."""
        return LearnedEnergy(self.scale, ratio, 0.0)

    def terms(self, energy: float, excess: float) -> EnergyTerms:
        """W~ at an energy W [J] of mechanics and an excess chi."""
        t = float(np.tanh(excess / LARGE))
        value, rate = self.first * energy * float(np.exp(self.growth * LARGE * t)), self.growth * (1.0 - t**2)
        slope = np.array([1.0, rate])
        curvature = np.outer(slope, slope)
        curvature[1, 1] -= 2.0 / LARGE * t * rate
        return EnergyTerms(value, value * slope, value * curvature)


def hardening(excess: float) -> tuple[float, float]:
    """eta and deta/dchi, by b."""
    t = float(np.tanh(excess / LARGE))
    return LARGE * t, 1.0 - t**2
