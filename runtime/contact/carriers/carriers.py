"""Carriers A of points: u = A v is the displacement in the deformed body that v = G phi is in the body at rest.

A = R, the rotation of the body there (`point_rotations.py`), or A = s R where a learned scale s = exp theta of the
compliance depends on the strain (`compliance_scale.py`). With moments M held,

    d(M : A) = s d(M : R) + (M : A) dtheta,
    d2(M : A) = s d2(M : R) + s (d(M : R) dtheta^T + dtheta d(M : R)^T) + (M : A) (dtheta dtheta^T + d2theta).

Carried by the deformation gradient F of the subspace in place of its rotation, the compliance F G F^T grows with the
square of a stretch. In full space it hardly does: of a slab pushed into the small Jelly, at the states of full space,
the force was 48 % off so, and is 14 % off; elasticity linearised at each state is 6 % off
(`python -m reproduction.linear_response`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.contact.carriers.compliance_scale import ScaleDerivatives
from softprint.runtime.contact.carriers.point_rotations import PointRotations
from softprint.runtime.lazy import lazy


@dataclass(frozen=True, eq=False)
class Carriers:
    """A at m points. scale: s and its derivatives there, None for 1."""

    rotations: PointRotations
    scale: ScaleDerivatives | None = None

    @lazy
    def value(self) -> Array:
        """A (m, dim, dim)."""
        R = self.rotations.value
        return R if self.scale is None else self.scale.scale[:, None, None] * R

    @lazy
    def slope(self) -> Array:
        """dA_ab/dF_cd (m, dim, dim, dim, dim)."""
        if self.scale is None:
            return self.rotations.slope
        found = self.scale.scale[:, None, None, None, None] * self.rotations.slope
        found += self.value[:, :, :, None, None] * self.scale.slope[:, None, None]
        return found

    def pulled_back(self, moments: Array) -> Array:
        """d(M : A)/dF (m, dim, dim); moments: M (m, dim, dim)."""
        if self.scale is None:
            return self.rotations.pulled_back(moments)
        return self.rotations.pulled_back(moments, self.scale.scale, self.scale.slope)

    def curvature(self, moments: Array) -> Array:
        """d2(M : A)/dF2 (m, dim, dim, dim, dim); moments: M (m, dim, dim)."""
        bent = self.rotations.curvature(moments)
        if self.scale is None:
            return bent
        s, theta = self.scale.scale[:, None, None, None, None], self.scale.slope
        turned = self.rotations.pulled_back(moments)
        crossed = turned[:, :, :, None, None] * theta[:, None, None]
        work = (self.value * moments).sum(axis=(1, 2))[:, None, None, None, None]
        found = s * (bent + crossed + crossed.transpose(0, 3, 4, 1, 2))
        found += work * (theta[:, :, :, None, None] * theta[:, None, None] + self.scale.curvature)
        return np.asarray(found)

    def by_rows(self, basis_gradient: Array) -> Array:
        """dA/drows (m, dim, dim, n_rows*dim); basis_gradient: (m, n_rows, dim), which gives dF."""
        m, n_rows, dim = basis_gradient.shape
        found = self.slope.reshape(m, dim**3, dim) @ basis_gradient.swapaxes(1, 2)  # (m, abc, r)
        return found.reshape(m, dim, dim, dim, n_rows).swapaxes(3, 4).reshape(m, dim, dim, -1)

    def bending(self, moments: Array, basis_gradient: Array) -> Array:
        """d2(sum_j M_j : A_j)/drows2 (n_rows*dim, n_rows*dim) of moments M (m, dim, dim); basis_gradient: see
        `by_rows`."""
        m, n_rows, dim = basis_gradient.shape
        by_F = self.curvature(moments).transpose(0, 2, 1, 3, 4).reshape(m, dim, dim**3)
        half = np.matmul(basis_gradient, by_F).reshape(m, n_rows * dim * dim, dim)
        left = half.transpose(1, 0, 2).reshape(n_rows * dim * dim, m * dim)
        whole = left @ basis_gradient.transpose(0, 2, 1).reshape(m * dim, n_rows)
        found = whole.reshape(n_rows, dim, dim, n_rows).transpose(0, 1, 3, 2)
        return found.reshape(n_rows * dim, n_rows * dim)


def carried_along(turned: Array, v: Array) -> Array:
    """dA v (m*dim, n) of dA (m, dim, dim, n) and displacements v (m, dim)."""
    m, dim, _, n = turned.shape
    return np.asarray((v[:, None, None] @ turned).reshape(m * dim, n))


def pulled_back_along(turned: Array, f: Array) -> Array:
    """dA^T f (m*dim, n) of dA (m, dim, dim, n) and forces f (m, dim)."""
    m, dim, _, n = turned.shape
    found = f[:, None] @ turned.reshape(m, dim, dim * n)
    return np.asarray(found.reshape(m * dim, n))
