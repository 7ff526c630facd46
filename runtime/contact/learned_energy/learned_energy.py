"""The learned energy of condensed contact: how it departs from that of linear mechanics, for any collider.

Linear mechanics gives the energy W of a contact and of its dent as a function of the handle rows and the poses
(`runtime/contact/linearised/`). It is corrected twice. The compliance is scaled by the strain of the body
(`runtime/contact/carriers/compliance_scale.py`), which changes W. And the body hardens with the size of the dent, for
which W itself is the measure:

    W~ = g(W),    g'(W) = a (1 + b x / (x + x_0)),    x = W^(1/3).

x / (x + x_0) is between 0 and 1: beyond the dents of training, and for any coefficients with a > 0 and b > -1, g grows,
and forces stay within a and a (1 + b) of those of mechanics. A small network (`dent_network.py`) multiplies g by exp
eta, of its width. Contacts that lie apart are dents of their own, and each hardens by
itself: where there are n of them,

    W~ = n g(W / n) exp eta(W / n, omega),    n = exp nu.

omega and nu (`dent_shape.py`) are functions of the contact forces. Derivatives of W~ by all three are in closed form,
so that forces are exact, whatever the solve depends on (`hardened_contact.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.contact.carriers.compliance_scale import N_COEFFICIENTS, ComplianceScale
from softprint.runtime.contact.learned_energy.dent_network import N_MEASURES, DentNetwork, Factor

#: The number of values of `LearnedEnergy.values` without a network.
N_VALUES = N_COEFFICIENTS + 4
# d(log W_1, omega) / d(log W, omega, nu).
_OF_ONE = np.hstack([np.eye(N_MEASURES), -np.eye(N_MEASURES)[:, :1]])
_NUMBER = np.eye(N_MEASURES + 1)[-1]


class EnergyTerms(NamedTuple):
    """W~ [J], and its derivatives by the measures (log W, omega, nu) (3,), (3, 3) [J]."""

    value: float
    slope: Array
    curvature: Array


@dataclass(frozen=True)
class LearnedEnergy:
    """scale: of the compliance; first: a, growth: b, and size: x_0 [J^(1/3)] of the module; reach: [m] of one dent, see
    `dent_shape.py`; network: None without."""

    scale: ComplianceScale
    first: float
    growth: float
    size: float
    reach: float
    network: DentNetwork | None = None

    @classmethod
    def of_mechanics(cls) -> LearnedEnergy:
        """W~ = W: that of linear mechanics."""
        return cls(ComplianceScale((0.0,) * N_COEFFICIENTS), 1.0, 0.0, 1.0, 1.0)

    @classmethod
    def of(cls, values: tuple[float, ...]) -> LearnedEnergy:
        """From `values`. Raises ValueError where they are not of an energy that grows with that of mechanics."""
        if len(values) < N_VALUES or not np.isfinite(values).all():
            raise ValueError(
                f"a learned energy has {N_VALUES} finite values, and those of its network, not {values}"
            )
        *coefficients, first, growth, size, reach = values[:N_VALUES]
        if first <= 0.0 or growth <= -1.0 or size <= 0.0 or reach <= 0.0:
            raise ValueError(
                f"a learned energy with a = {first:g}, b = {growth:g}, x_0 = {size:g} and reach = {reach:g} does not "
                "grow: it needs a > 0, b > -1, x_0 > 0 and reach > 0"
            )
        network = DentNetwork.of(values[N_VALUES:]) if len(values) > N_VALUES else None
        return cls(ComplianceScale(tuple(coefficients)), first, growth, size, reach, network)

    @property
    def values(self) -> tuple[float, ...]:
        """The coefficients of the scale, a, b, x_0 and the reach (N_VALUES,), and those of the network."""
        own = *self.scale.coefficients, self.first, self.growth, self.size, self.reach
        return own if self.network is None else (*own, *self.network.values)

    def terms(self, measures: Array) -> EnergyTerms:
        """W~ at measures (W, omega, nu) (3,), W positive."""
        number = float(np.exp(measures[2]))
        one = self._of_one_dent(np.array([measures[0] / number, measures[1]]))
        slope = one.slope @ _OF_ONE
        crossed = np.outer(slope, _NUMBER)
        curvature = _OF_ONE.T @ one.curvature @ _OF_ONE + crossed + crossed.T
        curvature += one.value * np.outer(_NUMBER, _NUMBER)
        return EnergyTerms(number * one.value, number * (slope + one.value * _NUMBER), number * curvature)

    def _of_one_dent(self, measures: Array) -> Factor:
        """g exp eta at (W_1, omega), with its derivatives by (log W_1, omega)."""
        W, own = measures[0], np.eye(N_MEASURES)[0]
        g, slope = self.energy(W), self.slope(W) * W
        second = (slope + self.curvature(W) * W**2) * np.outer(own, own)
        if self.network is None:
            return Factor(g, slope * own, second)
        eta = self.network.factor(measures)
        crossed = slope * np.outer(own, eta.slope)
        second += crossed + crossed.T + g * (np.outer(eta.slope, eta.slope) + eta.curvature)
        factor = float(np.exp(eta.value))
        return Factor(factor * g, factor * (slope * own + g * eta.slope), factor * second)

    def energy(self, mechanics: float) -> float:
        """g [J] of the energy W [J] of mechanics of one dent, without the network."""
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
