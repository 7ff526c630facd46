"""A small network in the learned energy of contact: how a dent hardens by its size, its shape, and what bears it.

The energy W [J] of mechanics knows how large a dent is. How steep it is shows in the contact forces f_j = p_j g_j [N]:
where the surface wraps around a tip they turn away from each other, and their resultant is smaller than their sum,

    rho = sum_c |sum_{j touches c} f_j| / sum_j p_j,

over colliders c. And where a collider is curved more finely than contact points are apart, sharp points of it press the
body (`runtime/contact/solver/pressed_points.py`): they bear the share

    psi = sum_pressed p_j / sum_j p_j.

The energy is multiplied by exp eta,

    eta = t R tanh(o / R),    o = v . tanh(V y + b),    y = (sigma(z_1 - c), psi, rho),    z = (log W^(1/3), psi, rho),

sigma(z) = 1 / (1 + exp -z), with c the median of training. The confidence

    t = 1 / (1 + sum_k n_k^2 / n_0^2)

takes eta back to nothing where z_k is outside of the range of training, by n_k of the widths of that range. All this is
known of every contact, whatever the collider, and no direction is in it, so that rotating body and collider changes
nothing; whatever the weights are, exp eta is between e^-R and e^R.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.compiled import compiled
from softprint.runtime.contact.solver.solved_contact import SolvedContact

#: The number of measures, W, psi and rho, and of inputs.
N_MEASURES = 3
#: R.
BOUND = 0.7
# n_0, in widths of the range. The energy changes with the confidence, and so do forces: where it falls within half a
# width, as that of the drawn correction does, a dent that leaves the range is drawn on, and steps do not converge.
_BEYOND = 2.0


class DentShape(NamedTuple):
    """What bears a dent of k active points. borne, shape: psi and rho; slopes: omega (k, dim, 2) [1/m] of each: they
    change by -sum_j omega_j . dy_j with the deformed positions y, of the penalty law p ~ e^2; lengths (n_colliders,)
    [N] and directions (n_colliders, dim) of the resultants of the forces on each collider, zeros for no direction."""

    borne: float
    shape: float
    slopes: Array
    lengths: Array
    directions: Array

    @classmethod
    def of(cls, solved: SolvedContact) -> DentShape:
        """Of a solved contact with active points."""
        solution, b = solved.solution, solved.solution.active
        p, e = solution.pressure[b], solution.penetration[b]
        distance = solution.normal[b], solution.curvature[b]
        return cls(*dent_shape(p, e, *distance, solved.owner[b], solved.is_pressed, len(solved.names)))


def dent_measures(solved: SolvedContact, shape: DentShape | None = None) -> Array:
    """(W [J], psi, rho) of a solved contact with active points."""
    shape = DentShape.of(solved) if shape is None else shape
    return np.array([solved.solution.energy, shape.borne, shape.shape])


def _dent_shape(
    p: Array, e: Array, g: Array, H: Array, owner: IntArray, pressed: BoolArray, n: int
) -> tuple[float, float, Array, Array, Array]:
    sums, total = np.zeros((n, g.shape[1])), p.sum()
    np.add.at(sums, owner, p[:, None] * g)
    lengths = np.linalg.norm(sums, axis=1)
    directions = sums / np.where(lengths > 0.0, lengths, 1.0)[:, None]
    along, borne, shape = directions[owner], p[pressed].sum() / total, lengths.sum() / total
    stiff = (2.0 * p / e)[:, None] * g
    by_force = stiff * (g * along).sum(axis=1, keepdims=True)
    by_force -= p[:, None] * np.einsum("kab,kb->ka", H, along)
    slopes = np.stack([stiff * (pressed - borne)[:, None], by_force - shape * stiff], axis=2) / total
    return borne, shape, slopes, lengths, directions


@compiled(reference=_dent_shape)
def dent_shape(
    p: Array, e: Array, g: Array, H: Array, owner: IntArray, pressed: BoolArray, n: int
) -> tuple[float, float, Array, Array, Array]:
    """The values of `DentShape`. p [N], e [m]: (k,); g (k, dim), H (k, dim, dim) [1/m]: derivatives of the distance;
    owner: (k,) numbers of n colliders; pressed: (k,) by sharp points."""
    k, dim = g.shape
    lengths, directions, slopes = np.zeros(n), np.zeros((n, dim)), np.empty((k, dim, 2))
    total = borne = shape = 0.0
    for j in range(k):
        total += p[j]
        borne += p[j] if pressed[j] else 0.0
        for a in range(dim):
            directions[owner[j], a] += p[j] * g[j, a]
    for c in range(n):
        for a in range(dim):
            lengths[c] += directions[c, a] ** 2
        lengths[c] = np.sqrt(lengths[c])
        shape += lengths[c] / total
        for a in range(dim):
            directions[c, a] /= lengths[c] if lengths[c] > 0.0 else 1.0
    borne /= total
    for j in range(k):
        u, along, stiff = directions[owner[j]], 0.0, 2.0 * p[j] / e[j]
        for a in range(dim):
            along += g[j, a] * u[a]
        for a in range(dim):
            turned = 0.0
            for b in range(dim):
                turned += H[j, a, b] * u[b]
            slopes[j, a, 0] = stiff * g[j, a] * ((1.0 if pressed[j] else 0.0) - borne) / total
            slopes[j, a, 1] = (stiff * g[j, a] * (along - shape) - p[j] * turned) / total
    return borne, shape, slopes, lengths, directions


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
        """eta at (W, psi, rho), W positive, with derivatives by (log W, psi, rho)."""
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
    rise = np.array([size * (1.0 - size), 1.0, 1.0])
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


# d z / d(log W, psi, rho).
_BY_LOG = np.array([1.0 / 3.0, 1.0, 1.0])
_BY_LOG_TWICE = np.outer(_BY_LOG, _BY_LOG)
