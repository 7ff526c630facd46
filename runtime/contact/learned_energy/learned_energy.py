"""The learned energy of condensed contact: how it departs from that of linear mechanics, for any collider.

Linear mechanics gives the energy W of a contact and of its dent as a function of the handle rows and the poses
(`runtime/contact/linearised/`). It is corrected twice. The compliance is scaled by the strain of the body
(`runtime/contact/carriers/compliance_scale.py`), which changes W. And the body hardens as its dent grows, for which the
excess chi of the dent (`dent_excess.py`) is the measure:

    W~ = a W exp eta(chi),    eta = b chi_0 tanh(chi / chi_0).

Psi and linear mechanics give chi; only how much of it counts is learned. Where chi is far beyond that of training,
eta is at most b chi_0. Contacts that lie apart are dents of their own, with energies that add up. Derivatives of W~ by
W and chi are in closed form, so that forces are exact, whatever the solve depends on (`hardened_contact.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.contact.carriers.compliance_scale import N_COEFFICIENTS, ComplianceScale

#: The number of values of `LearnedEnergy.values`.
N_VALUES = N_COEFFICIENTS + 3
#: The largest |b| chi_0. W~ grows with the dent up to six: chi grows with W^(1/3), and t / cosh(t)^2 is below 0.45.
BOUND = 2.0


class EnergyTerms(NamedTuple):
    """W~ [J], and its derivatives by the measures (log W, chi) (2,), (2, 2) [J]."""

    value: float
    slope: Array
    curvature: Array


@dataclass(frozen=True)
class LearnedEnergy:
    """scale: of the compliance; first: a, growth: b, and size: chi_0 of the module."""

    scale: ComplianceScale
    first: float
    growth: float
    size: float

    @classmethod
    def of_mechanics(cls) -> LearnedEnergy:
        """W~ = W: that of linear mechanics."""
        return cls(ComplianceScale((0.0,) * N_COEFFICIENTS), 1.0, 0.0, 1.0)

    @classmethod
    def of(cls, values: tuple[float, ...]) -> LearnedEnergy:
        """From `values`. Raises ValueError where they are not of an energy that grows with that of mechanics."""
        if len(values) != N_VALUES or not np.isfinite(values).all():
            raise ValueError(f"a learned energy has {N_VALUES} finite values, not {values}")
        *coefficients, first, growth, size = values
        if first <= 0.0 or size <= 0.0 or abs(growth) * size > BOUND:
            raise ValueError(
                f"a learned energy with a = {first:g}, b = {growth:g} and chi_0 = {size:g} does not grow: it needs a > "
                f"0, chi_0 > 0 and |b| chi_0 <= {BOUND:g}"
            )
        return cls(ComplianceScale(tuple(coefficients)), first, growth, size)

    @property
    def values(self) -> tuple[float, ...]:
        """The coefficients of the scale, a, b and chi_0 (N_VALUES,)."""
        return *self.scale.coefficients, self.first, self.growth, self.size

    def terms(self, energy: float, excess: float) -> EnergyTerms:
        """W~ at an energy W [J] of mechanics and an excess chi."""
        grown, rate = self.hardening(excess), self.growth * self.hardening_rate(excess)
        value = self.first * energy * float(np.exp(self.growth * grown))
        slope = np.array([1.0, rate])
        curvature = np.outer(slope, slope)
        curvature[1, 1] -= 2.0 * rate * grown / self.size**2
        return EnergyTerms(value, value * slope, value * curvature)

    def hardening(self, excess: float) -> float:
        """eta / b = chi_0 tanh(chi / chi_0)."""
        return float(self.size * np.tanh(excess / self.size))

    def hardening_rate(self, excess: float) -> float:
        """Its derivative."""
        return float(1.0 - np.tanh(excess / self.size) ** 2)
