"""The learned energy of condensed contact: how it departs from that of linear mechanics, for any collider.

Linear mechanics gives the energy W of a contact and of its dent as a function of the handle rows and the poses
(`runtime/contact/linearised/`). It is corrected twice. The compliance is scaled by the strain of the body
(`runtime/contact/carriers/compliance_scale.py`), which changes W. And the body hardens as its dent grows, for which the
excess chi of the dent (`dent_excess.py`) is the measure:

    W~ = W (1 + chi)^b.

The material and linear mechanics give chi; only how much of it counts, b, is learned, so that it holds for dents much
deeper than those of training. The smaller a dent is, the nearer is its energy to that of linear mechanics; with
exp(b chi) shallow dents would be too stiff where deep ones are right (docs/method.md, the learned energy). Contacts
that lie apart are dents of their own, with energies that add up.
Derivatives of W~ by W and chi are in closed form, so that forces are exact, whatever the solve depends on
(`hardened_contact.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.contact.carriers.compliance_scale import N_COEFFICIENTS, ComplianceScale
from softprint.runtime.contact.learned_energy.continued_logarithm import ContinuedLogarithm

#: The number of values of `LearnedEnergy.values`.
N_VALUES = N_COEFFICIENTS + 1
#: The least and the largest b. From the least on W~ grows with the dent: chi grows by at most 10 d|H|/|H|, as no solid
#: here has an energy of more than the twelfth power of H where that is large, and W grows with H^2 at least. At the
#: largest nothing relaxes that linear mechanics displaces too much.
LEAST, MOST = -0.2, 1.0


class EnergyTerms(NamedTuple):
    """W~ [J], and its derivatives by the measures (log W, chi) (2,), (2, 2) [J]."""

    value: float
    slope: Array
    curvature: Array


def hardening(excess: float) -> ContinuedLogarithm:
    """eta = log(1 + chi) and its derivatives, see `ContinuedLogarithm`."""
    return ContinuedLogarithm.of(np.asarray(excess))


@dataclass(frozen=True)
class LearnedEnergy:
    """scale: of the compliance; growth: b of the module; ratio: to the energy of the module, one but where hardening is
    `held`."""

    scale: ComplianceScale
    growth: float
    ratio: float = 1.0

    @classmethod
    def of_mechanics(cls) -> LearnedEnergy:
        """W~ = W: that of linear mechanics."""
        return cls(ComplianceScale((0.0,) * N_COEFFICIENTS), 0.0)

    @classmethod
    def of(cls, values: tuple[float, ...]) -> LearnedEnergy:
        """From `values`. Raises ValueError where they are not of an energy that grows with that of mechanics."""
        if len(values) != N_VALUES or not np.isfinite(values).all():
            raise ValueError(f"a learned energy has {N_VALUES} finite values, not {values}")
        *coefficients, growth = values
        if not LEAST <= growth <= MOST:
            raise ValueError(
                f"a learned energy with b = {growth:g} does not grow: it needs {LEAST:g} <= b <= {MOST:g}"
            )
        return cls(ComplianceScale(tuple(coefficients)), growth)

    @property
    def values(self) -> tuple[float, ...]:
        """The coefficients of the scale, and b (N_VALUES,)."""
        return *self.scale.coefficients, self.growth

    def held(self, ratio: float) -> LearnedEnergy:
        """W~ = ratio W, with the same scale."""
        return LearnedEnergy(self.scale, 0.0, ratio)

    def terms(self, energy: float, excess: float) -> EnergyTerms:
        """W~ at an energy W [J] of mechanics and an excess chi."""
        eta = hardening(excess)
        value = self.ratio * energy * float(np.exp(self.growth * eta.value))
        slope = np.array([1.0, self.growth * eta.slope])
        curvature = np.outer(slope, slope)
        curvature[1, 1] += self.growth * eta.bend
        return EnergyTerms(value, value * slope, value * curvature)
