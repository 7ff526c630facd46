"""The learned energy of condensed contact: how it departs from that of linear mechanics, for any collider.

Linear mechanics gives the energy W of a contact and of its dent as a function of the handle rows and the poses
(`runtime/contact/linearised/`). Perturbation theory gives what it lacks
(`runtime/contact/dents/dent_energies.py`): the energy W_E of the dent in the strain that the body has without it, which
makes the flesh there stiffer or softer, for the energy W_2 that linear mechanics has in the same cells; and W_3 and
W_4, by which the body hardens as the dent grows:

    W~ = W exp(tanh(W_E / W_2)) (1 + chi),    chi = (W_3 + b W_4) / W,

for chi < 0, where 1 + chi may vanish, with exp(chi - chi^2 / 2) in place of 1 + chi. W_E and W_3 count once, which is
what the material says. Only b is learned: how much of the energy of fourth order is left when the body has relaxed
where linear mechanics displaces it too much. So the smaller a dent is, the less is learned of it. Contacts that lie
apart are dents of their own, with energies that add up.

Derivatives of W~ by all five energies are in closed form, so that forces are exact, whatever the solve depends on
(`hardened_contact.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array

#: The least and the largest b: all of W_4 relaxes; or nothing does, and the cells below the layer have twice as much.
LEAST, MOST = 0.0, 3.0
# Energies below it [J] are none.
_TINY = 1e-100


class EnergyTerms(NamedTuple):
    """W~ [J], and its derivatives by (log W, W_2, W_3, W_4, W_E) (5,) and (5, 5)."""

    value: float
    slope: Array
    curvature: Array


@dataclass(frozen=True)
class LearnedEnergy:
    """fourth: b of the module. Of mechanics, or `held`, are energies that nothing counts in but W, with a ratio to
    it."""

    fourth: float
    ratio: float = 1.0
    is_proportional: bool = False

    @classmethod
    def of_mechanics(cls) -> LearnedEnergy:
        """W~ = W: that of linear mechanics."""
        return cls(LEAST, is_proportional=True)

    @classmethod
    def of(cls, values: tuple[float, ...]) -> LearnedEnergy:
        """From `values`. Raises ValueError where they are not of an energy that grows with that of mechanics."""
        if len(values) != 1 or not np.isfinite(values).all():
            raise ValueError(f"a learned energy has one finite value, not {values}")
        (fourth,) = values
        if not LEAST <= fourth <= MOST:
            raise ValueError(
                f"a learned energy with b = {fourth:g} is of no body: it needs {LEAST:g} <= b <= {MOST:g}"
            )
        return cls(fourth)

    @property
    def values(self) -> tuple[float, ...]:
        """(b,)."""
        return (self.fourth,)

    def held(self, ratio: float) -> LearnedEnergy:
        """W~ = ratio W."""
        return LearnedEnergy(LEAST, ratio, is_proportional=True)

    def terms(self, W: float, of_dent: Array) -> EnergyTerms:
        """W~ at an energy W [J] of mechanics, and those of the dent, (W_2, W_3, W_4, W_E) (4,) [J]."""
        if self.is_proportional:
            value = self.ratio * W
            only = np.zeros((5, 5))
            only[0, 0] = value
            return EnergyTerms(value, only[0], only)
        W_2, W_3, W_4, W_E = (float(of) for of in of_dent)
        of_chi = np.array([1.0, self.fourth]) / W
        strain, growth = _StrainFactor.of(W_E, max(W_2, _TINY)), _Growth.of((W_3 + self.fourth * W_4) / W)
        chi, p, q = growth.chi, growth.slope, growth.bend
        slope = np.concatenate([[1.0 - chi * p], strain.slope[:1], p * of_chi, strain.slope[1:]])
        bend = np.zeros((5, 5))
        bend[0, 0] = chi * p + chi**2 * q
        bend[0, 2:4] = bend[2:4, 0] = -(p + chi * q) * of_chi
        bend[2:4, 2:4] = q * np.outer(of_chi, of_chi)
        bend[1::3, 1::3] = strain.bend
        value = W * float(np.exp(strain.value + growth.value))
        return EnergyTerms(value, value * slope, value * (np.outer(slope, slope) + bend))


class _StrainFactor(NamedTuple):
    """tanh(W_E / W_2), and its derivatives by (W_2, W_E) (2,) and (2, 2)."""

    value: float
    slope: Array
    bend: Array

    @classmethod
    def of(cls, W_E: float, W_2: float) -> _StrainFactor:
        ratio = W_E / W_2
        t = float(np.tanh(ratio))
        u = 1.0 - t**2
        v = -2.0 * t * u
        crossed = -(v * ratio + u)
        bend = np.array([[v * ratio**2 + 2.0 * u * ratio, crossed], [crossed, v]]) / W_2**2
        return cls(t, np.array([-u * ratio, u]) / W_2, bend)


class _Growth(NamedTuple):
    """log(1 + chi), for chi < 0 continued to second order, and its derivatives by chi."""

    chi: float
    value: float
    slope: float
    bend: float

    @classmethod
    def of(cls, chi: float) -> _Growth:
        if chi > 0.0:
            return cls(chi, float(np.log1p(chi)), 1.0 / (1.0 + chi), -1.0 / (1.0 + chi) ** 2)
        return cls(chi, chi - chi**2 / 2.0, 1.0 - chi, -1.0)
