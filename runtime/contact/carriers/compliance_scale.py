"""How the compliance at contact points depends on the strain of the body, learned from contact forces.

Displacements of the body at rest, v = G phi, are carried along by the rotation R of the body (`carriers.py`). That the
compliance changes with the strain, too, is seen in forces on the handles, which are derivatives of the energy by the
strain. So with a scale s of the compliance at every point,

    u = A v,    phi = A^T f,    A = s R,    s = exp theta,    theta = R tanh(z / R),
    z = c_1 (tr C / dim - 1) / 2 + c_2 (N . C N - 1) / 2,    C = F^T F,

with N the surface normal at rest: by how much the body is stretched, and by how much of it along the normal. To first
order no other strain is the same in all directions of the surface. theta depends on invariants of the strain alone:
rotating the body changes nothing, at rest s is 1, and no collider is named. s is between e^-R and e^R whatever the
coefficients are, so that the energy stays positive.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.compiled import compiled
from softprint.runtime.lazy import lazy

# R.
_BOUND = 1.0
#: The number of coefficients c.
N_COEFFICIENTS = 2


@dataclass(frozen=True, eq=False)
class ScaleDerivatives:
    """At m points: scale s (m,), and of theta the slope dtheta/dF (m, dim, dim) and the curvature d2theta/dF2 (m, dim,
    dim, dim, dim), computed at its first use."""

    scale: Array
    slope: Array
    _curvature: Callable[[], Array] = field(repr=False)

    @lazy
    def curvature(self) -> Array:
        """See the class."""
        return self._curvature()


@dataclass(frozen=True)
class ComplianceScale:
    """coefficients: c (N_COEFFICIENTS,). With zeros s is 1 everywhere."""

    coefficients: tuple[float, ...]

    @property
    def largest(self) -> float:
        """e^R."""
        return float(np.exp(_BOUND))

    def scale(self, F: Array, normal: Array) -> Array:
        """s (m,) at deformation gradients F (m, dim, dim) and rest normals N (m, dim)."""
        z, _ = combined_strain(F, normal, np.asarray(self.coefficients))
        return np.exp(_BOUND * np.tanh(z / _BOUND))

    def derivatives(self, F: Array, normal: Array) -> ScaleDerivatives:
        """s and the derivatives of theta there."""
        c = np.asarray(self.coefficients)
        z, slope = combined_strain(F, normal, c)
        bounded = np.tanh(z / _BOUND)
        rate = 1.0 - bounded**2

        def curvature() -> Array:
            bend = (-2.0 / _BOUND * rate * bounded)[:, None, None] * slope
            crossed = bend[:, :, :, None, None] * slope[:, None, None]
            return rate[:, None, None, None, None] * _curvature(c, normal) + crossed

        return ScaleDerivatives(np.exp(_BOUND * bounded), rate[:, None, None] * slope, curvature)

    def by_coefficients(self, F: Array, normal: Array) -> tuple[Array, Array]:
        """dtheta/dc (m, N_COEFFICIENTS) and d2theta/dF dc (m, N_COEFFICIENTS, dim, dim): for training."""
        c = np.asarray(self.coefficients)
        measures, slopes = strain_measures(F, normal), measure_slopes(F, normal)
        bounded = np.tanh(measures @ c / _BOUND)
        rate = 1.0 - bounded**2
        bend = -2.0 * rate * bounded / _BOUND
        slope = np.einsum("k,mkab->mab", c, slopes)
        mixed = rate[:, None, None, None] * slopes
        mixed += (bend[:, None] * measures)[:, :, None, None] * slope[:, None]
        return rate[:, None] * measures, mixed


def strain_measures(F: Array, normal: Array) -> Array:
    """(m, N_COEFFICIENTS) the two strains of the module; zero where F is a rotation."""
    along = (F @ normal[..., None])[..., 0]
    trace = (F * F).sum(axis=(1, 2)) / F.shape[1]
    return 0.5 * np.stack([trace - 1.0, (along**2).sum(axis=1) - 1.0], axis=1)


def measure_slopes(F: Array, normal: Array) -> Array:
    """The derivatives of `strain_measures` by F (m, N_COEFFICIENTS, dim, dim)."""
    along = (F @ normal[..., None])[..., 0]
    return np.stack([F / F.shape[1], along[:, :, None] * normal[:, None, :]], axis=1)


def _combined(F: Array, normal: Array, c: Array) -> tuple[Array, Array]:
    return strain_measures(F, normal) @ c, np.tensordot(measure_slopes(F, normal), c, axes=(1, 0))


@compiled(reference=_combined)
def combined_strain(F: Array, normal: Array, c: Array) -> tuple[Array, Array]:
    """z (m,) and dz/dF (m, dim, dim) for coefficients c (N_COEFFICIENTS,)."""
    m, dim = normal.shape
    z, slope = np.empty(m), np.empty((m, dim, dim))
    for j in range(m):
        trace = stretch = 0.0
        for a in range(dim):
            along = 0.0
            for b in range(dim):
                trace += F[j, a, b] * F[j, a, b]
                along += F[j, a, b] * normal[j, b]
            stretch += along * along
            for b in range(dim):
                slope[j, a, b] = c[0] * F[j, a, b] / dim + c[1] * along * normal[j, b]
        z[j] = 0.5 * c[0] * (trace / dim - 1.0) + 0.5 * c[1] * (stretch - 1.0)
    return z, slope


def _curvature(c: Array, normal: Array) -> Array:
    """d2z/dF2 (m, dim, dim, dim, dim)."""
    dim = normal.shape[1]
    by_normal = np.eye(dim)[:, None, :, None] * (normal[:, :, None] * normal[:, None])[:, None, :, None]
    return np.asarray(c[0] * _BY_TRACE[dim] + c[1] * by_normal)


# d2 (tr C / dim) / 2 dF_ab dF_cd.
_BY_TRACE = {dim: np.einsum("ac,bd->abcd", np.eye(dim), np.eye(dim)) / dim for dim in (2, 3)}
