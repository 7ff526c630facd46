"""A small network in the learned energy of contact: how a dent hardens by its size and its width.

The energy of n dents with energy W [J] together, as wide as omega says (`dent_shape.py`), is multiplied by exp eta of
one of them, with W_1 = W / n,

    eta = t R tanh(o / R),    o = v . tanh(V y + b),
    z = (log W_1^(1/3), omega),    y = (sigma(z_1 - c), omega),

sigma(z) = 1 / (1 + exp -z), with c the median of training. The confidence

    t = 1 / (1 + sum_k n_k^2 / n_0^2)

takes eta back to nothing where z_k is outside of the range of training, by n_k of the widths of that range. All this is
known of every contact, whatever the collider; whatever the weights are, exp eta is between e^-R and e^R.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.compiled import compiled

#: The number of measures of a dent, W_1 and omega, and of inputs.
N_MEASURES = 2
#: R.
BOUND = 0.7
# n_0, in widths of the range. The energy changes with the confidence, and so do forces: where it falls within half a
# width, as that of the drawn correction does, a dent that leaves the range is drawn on, and steps do not converge.
_BEYOND = 2.0


class Factor(NamedTuple):
    """eta, or a part of it, and its derivatives by n arguments (n,), (n, n)."""

    value: float
    slope: Array
    curvature: Array


@dataclass(frozen=True, eq=False)
class DentNetwork:
    """centre: c; lowest, highest: the range of z in training (N_MEASURES,); hidden: V (h, N_MEASURES); bias: b (h,);
    output: v (h,)."""

    centre: float
    lowest: Array
    highest: Array
    hidden: Array
    bias: Array
    output: Array

    @classmethod
    def of(cls, values: tuple[float, ...]) -> DentNetwork:
        """From `values`. Raises ValueError where there are not as many as of any network, or not finite, or a range is
        empty."""
        first = 1 + 2 * N_MEASURES
        h, left = divmod(len(values) - first, N_MEASURES + 2)
        if left or h < 1 or not np.isfinite(values).all():
            raise ValueError(
                f"the network of a learned energy has {first} + {N_MEASURES + 2} h finite values with h neurons, not "
                f"{len(values)}"
            )
        ends = np.cumsum([1, N_MEASURES, N_MEASURES, N_MEASURES * h, h])
        centre, lowest, highest, hidden, bias, output = np.split(np.asarray(values, dtype=np.float64), ends)
        if not (lowest < highest).all():
            raise ValueError(
                f"the network of a learned energy has an empty range, from {lowest} to {highest}: it needs samples "
                "that differ"
            )
        return cls(float(centre[0]), lowest, highest, hidden.reshape(h, N_MEASURES), bias, output)

    @property
    def values(self) -> tuple[float, ...]:
        """All of it as plain numbers."""
        parts = self.lowest, self.highest, self.hidden.ravel(), self.bias, self.output
        return (self.centre, *map(float, np.concatenate(parts)))

    def factor(self, measures: Array) -> Factor:
        """eta at (W_1, omega), W_1 positive, with derivatives by (log W_1, omega)."""
        z = np.array([np.log(measures[0]) / 3.0, *measures[1:]])
        own = Factor(*network_output(z, self.centre, self.hidden, self.bias, self.output))
        if ((self.lowest <= z) & (z <= self.highest)).all():
            return Factor(own.value, own.slope * _BY_LOG, own.curvature * _BY_LOG_TWICE)
        t = self.confidence(z)
        crossed = np.outer(t.slope, own.slope)
        by_z = t.value * own.slope + t.slope * own.value
        second = t.value * own.curvature + crossed + crossed.T + own.value * t.curvature
        return Factor(t.value * own.value, by_z * _BY_LOG, second * _BY_LOG_TWICE)

    def confidence(self, z: Array) -> Factor:
        """t at z (N_MEASURES,)."""
        scale = (self.highest - self.lowest) * _BEYOND
        n = (np.maximum(z - self.highest, 0.0) - np.maximum(self.lowest - z, 0.0)) / scale
        t = 1.0 / (1.0 + n @ n)
        slope = 2.0 * n / scale
        bend = np.diag(2.0 * (n != 0.0) / scale**2)
        return Factor(float(t), -slope * t**2, 2.0 * np.outer(slope, slope) * t**3 - bend * t**2)


def _network_output(
    z: Array, centre: float, hidden: Array, bias: Array, output: Array
) -> tuple[float, Array, Array]:
    size = 1.0 / (1.0 + np.exp(centre - z[0]))
    rise = np.array([size * (1.0 - size), 1.0])
    s = np.tanh(hidden @ np.array([size, *z[1:]]) + bias)
    bounded = np.tanh(output @ s / BOUND)
    rate = output * (1.0 - s * s)
    along, left = rate @ hidden, 1.0 - bounded**2
    bend = (hidden.T * (-2.0 * s * rate)) @ hidden
    bend -= 2.0 / BOUND * bounded * np.outer(along, along)
    second = left * bend * np.outer(rise, rise)
    second[0, 0] += left * along[0] * rise[0] * (1.0 - 2.0 * size)
    return float(BOUND * bounded), left * along * rise, second


@compiled(reference=_network_output)
def network_output(
    z: Array, centre: float, hidden: Array, bias: Array, output: Array
) -> tuple[float, Array, Array]:
    """R tanh(o / R) at z (N_MEASURES,), with its derivatives by z (N_MEASURES,), (N_MEASURES, N_MEASURES)."""
    h, n = hidden.shape
    size, y = 1.0 / (1.0 + np.exp(centre - z[0])), z.copy()
    y[0] = size
    total, along, bend = 0.0, np.zeros(n), np.zeros((n, n))
    for k in range(h):
        o = bias[k]
        for a in range(n):
            o += hidden[k, a] * y[a]
        s = np.tanh(o)
        rate = output[k] * (1.0 - s * s)
        total += output[k] * s
        for a in range(n):
            along[a] += rate * hidden[k, a]
            for b in range(n):
                bend[a, b] -= 2.0 * s * rate * hidden[k, a] * hidden[k, b]
    bounded, rise = np.tanh(total / BOUND), np.ones(n)
    left, rise[0] = 1.0 - bounded**2, size * (1.0 - size)
    for a in range(n):
        for b in range(n):
            bend[a, b] -= 2.0 / BOUND * bounded * along[a] * along[b]
            bend[a, b] *= left * rise[a] * rise[b]
    bend[0, 0] += left * along[0] * rise[0] * (1.0 - 2.0 * size)
    return BOUND * bounded, left * along * rise, bend


# d z / d(log W_1, omega).
_BY_LOG = np.array([1.0 / 3.0, 1.0])
_BY_LOG_TWICE = np.outer(_BY_LOG, _BY_LOG)
