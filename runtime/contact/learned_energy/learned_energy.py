"""The learned energy of condensed contact: how it departs from that of linear mechanics, for any collider.

Linear mechanics gives the energy W of a contact and of its dent as a function of the handle rows and the poses
(`runtime/contact/linearised/`). It is corrected twice. The compliance is scaled by the strain of the body
(`runtime/contact/solver/compliance_scale.py`), which changes W. And the body hardens with the size of the dent, for
which W itself is the measure:

    W~ = g(W),    g'(W) = a (1 + b x / (x + x_0)),    x = W^(1/3),

so that the forces are g' times those of the contact solve, and

    dW~ = g' dW,    d2W~ = g' d2W + g'' dW dW^T

are exact, whatever the solve depends on. A small network (`dent_network.py`) multiplies g by
exp eta, of the shape of the dent and what bears it. x / (x + x_0) is between 0 and 1: beyond the dents of training, and
for any coefficients with a > 0 and b > -1, g grows, and forces stay within a and a (1 + b) of those of mechanics, times
what the network makes of them. Contacts with several colliders are one dent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.contact.learned_energy.dent_network import N_MEASURES, DentNetwork
from softprint.runtime.contact.solver.compliance_scale import N_COEFFICIENTS, ComplianceScale

#: The number of values of `LearnedEnergy.values` without a network.
N_VALUES = N_COEFFICIENTS + 3


class EnergyTerms(NamedTuple):
    """W~ [J], and its derivatives by the n measures (log W, psi, rho) that it depends on (n,), (n, n) [J]."""

    value: float
    slope: Array
    curvature: Array


@dataclass(frozen=True)
class LearnedEnergy:
    """scale: of the compliance; first: a, growth: b, and size: x_0 [J^(1/3)] of the module; network: None without."""

    scale: ComplianceScale
    first: float
    growth: float
    size: float
    network: DentNetwork | None = None

    @classmethod
    def of(cls, values: tuple[float, ...]) -> LearnedEnergy:
        """From `values`. Raises ValueError where they are not of an energy that grows with that of mechanics."""
        if len(values) < N_VALUES or not np.isfinite(values).all():
            raise ValueError(
                f"a learned energy has {N_VALUES} finite values, and those of its network, not {values}"
            )
        *coefficients, first, growth, size = values[:N_VALUES]
        if first <= 0.0 or growth <= -1.0 or size <= 0.0:
            raise ValueError(
                f"a learned energy with a = {first:g}, b = {growth:g}, x_0 = {size:g} does not grow: it needs a > 0, "
                "b > -1 and x_0 > 0"
            )
        network = DentNetwork.of(values[N_VALUES:]) if len(values) > N_VALUES else None
        return cls(ComplianceScale(tuple(coefficients)), first, growth, size, network)

    @property
    def values(self) -> tuple[float, ...]:
        """The coefficients of the scale, a, b and x_0 (N_VALUES,), and those of the network."""
        own = *self.scale.coefficients, self.first, self.growth, self.size
        return own if self.network is None else (*own, *self.network.values)

    def terms(self, measures: Array) -> EnergyTerms:
        """W~ at measures (W, psi, rho) of `dent_network.py`, W positive; without a network, of W alone."""
        W = measures[0]
        g, slope = self.energy(W), self.slope(W) * W
        second = slope + self.curvature(W) * W**2
        if self.network is None:
            return EnergyTerms(g, np.array([slope]), np.array([[second]]))
        eta = self.network.factor(measures)
        own, crossed = np.eye(N_MEASURES)[0], np.zeros((N_MEASURES, N_MEASURES))
        crossed[0] = slope * eta.slope
        curvature = second * np.outer(own, own) + crossed + crossed.T
        curvature += g * (np.outer(eta.slope, eta.slope) + eta.curvature)
        factor = float(np.exp(eta.value))
        return EnergyTerms(factor * g, factor * (slope * own + g * eta.slope), factor * curvature)

    def energy(self, mechanics: float) -> float:
        """g [J] of the energy W [J] of mechanics, without the network."""
        risen = 3.0 * self.size**3 * _risen(np.cbrt(mechanics) / self.size)
        return float(self.first * (mechanics + self.growth * risen))

    def slope(self, mechanics: float) -> float:
        """g' of the energy W [J] of mechanics."""
        x = np.cbrt(mechanics)
        return float(self.first * (1.0 + self.growth * x / (x + self.size)))

    def curvature(self, mechanics: float) -> float:
        """g'' [1/J] of the energy W [J] of mechanics; 0 where it is zero, as is dW there."""
        x = np.cbrt(mechanics)
        if x <= 0.0:
            return 0.0
        return float(self.first * self.growth * self.size / (x + self.size) ** 2 / (3.0 * x**2))


def _risen(t: float) -> float:
    """The integral of t^3 / (t + 1) from 0: t^3/3 - t^2/2 + t - log(1 + t)."""
    if t > _SMALL:
        return t**3 / 3.0 - t**2 / 2.0 + t - float(np.log1p(t))
    # The terms would cancel.
    return sum((-t) ** k / k for k in range(4, 4 + _TERMS))


# (1/20)^12 is round-off.
_SMALL, _TERMS = 0.05, 12
