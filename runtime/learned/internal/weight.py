"""The work of gravity along an internal correction.

With u_n = F_n r_n, r_n = sum_k c_k m_kn and F_n = rows^T G_n, the weight of a body needs no node of it:

    E = - sum_n m_n g . u_n = - (rows g) . w,    w = W c,    W_sk = sum_n m_n G_ns . m_kn  [kg],

so that w (n_rows,) is a displacement field at a single place, and

    dE/drows = - w (x) g - (rows g) . dw/drows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.lazy import lazy
from softprint.runtime.learned.internal.local_field import LocalField, LocalPoint


@dataclass(frozen=True, eq=False)
class InternalWeight:
    """moment: w as a field (1, n_rows) [kg] of the rows; gravity: (dim,) [m/s^2]."""

    moment: LocalField
    gravity: Array

    def at(self, rows: Array) -> InternalWeightPoint:
        """E at handle rows (n_rows, dim)."""
        return InternalWeightPoint(self, rows)


@dataclass(frozen=True, eq=False)
class InternalWeightPoint:
    """E and its derivatives at one state."""

    weight: InternalWeight
    rows: Array

    @lazy
    def _moment(self) -> LocalPoint:
        return self.weight.moment.at(self.rows)

    @lazy
    def _height(self) -> Array:
        """rows g (1, n_rows)."""
        return (self.rows @ self.weight.gravity)[None]

    @property
    def energy(self) -> float:
        """[J]"""
        return -float(np.vdot(self._height, self._moment.value))

    @property
    def gradient(self) -> Array:
        """dE/drows (n_rows, dim) [N]."""
        direct = np.outer(self._moment.value[0], self.weight.gravity)
        return -direct - self._moment.pulled_back(self._height).reshape(self.rows.shape)

    def hessian(self, along: Array | None = None) -> Array:
        """d2E/drows2 [N/m], see `RowHessian`."""
        dim = self.rows.shape[1]
        total = self._moment.curvature(self._height, along)
        slope = self._moment.along(along)[0].astype(np.float64)  # (n_rows, k)
        for axis in range(dim):
            if along is None:
                total[axis::dim] += self.weight.gravity[axis] * slope
                total[:, axis::dim] += self.weight.gravity[axis] * slope.T
            else:
                both = self.weight.gravity[axis] * (along[axis::dim].T @ slope)
                total += both + both.T
        return -total
