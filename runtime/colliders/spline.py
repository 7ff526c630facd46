"""Cubic B-spline interpolation of samples on a regular grid: a C2 field with cheap exact derivatives.

Along each axis the value in a cell is the sum of four basis polynomials b_i of the fraction f in [0, 1]:

    b_0 = (1-f)^3/6,  b_1 = (3 f^3 - 6 f^2 + 4)/6,  b_2 = (-3 f^3 + 3 f^2 + 3 f + 1)/6,  b_3 = f^3/6,

times the coefficients of the 4^dim nodes around (Unser 1999). The arrays here carry the points on the *last*
axis, so that every operation runs over contiguous memory: 1,000 points in 3D take well under 2 ms.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from scipy.ndimage import spline_filter

from runtime.arrays import Array, IntArray
from runtime.colliders.collider import SdfDerivatives

# Points are worked on in chunks whose gathered coefficients (64 numbers a point in 3D) stay in cache.
CHUNK = 2048


# The four polynomials, their first and their second derivatives, as coefficients of 1, f, f^2, f^3: (12, 4).
_CUBICS = (
    np.array(
        [
            [1, -3, 3, -1],
            [4, 0, -6, 3],
            [1, 3, 3, -3],
            [0, 0, 0, 1],
            [-3, 6, -3, 0],
            [0, -12, 9, 0],
            [3, 6, -9, 0],
            [0, 0, 3, 0],
            [6, -6, 0, 0],
            [-12, 18, 0, 0],
            [6, -18, 0, 0],
            [0, 6, 0, 0],
        ]
    )
    / 6.0
)


def _polynomials(f: Array, orders: int) -> Array:
    """The four polynomials at fractions f (dim, n) and their derivatives below `orders`: (orders, 4, dim, n)."""
    powers = np.empty((4, *f.shape))
    powers[0], powers[1] = 1.0, f
    np.multiply(f, f, out=powers[2])
    np.multiply(powers[2], f, out=powers[3])
    values = _CUBICS[: 4 * orders] @ powers.reshape(4, -1)
    return values.reshape(orders, 4, *f.shape)


class SplineGrid:
    """The interpolant of values (n_0, ..) given at origin + index * spacing, for points within the grid."""

    def __init__(self, values: Array, origin: Array, spacing: float) -> None:
        self.origin, self.spacing = np.asarray(origin, dtype=float), float(spacing)
        self.shape = np.array(values.shape)
        self.upper = self.origin + (self.shape - 1) * self.spacing
        coefficients = spline_filter(values, order=3, mode="mirror")
        padded = np.pad(coefficients, [(1, 2)] * values.ndim, mode="reflect")
        self._coefficients = np.ascontiguousarray(padded).ravel()
        self._strides = np.array([int(np.prod(padded.shape[a + 1 :])) for a in range(values.ndim)])
        stencil = [sum(i * s for i, s in zip(corner, self._strides, strict=True)) for corner in self._corners]
        self._stencil: IntArray = np.array(stencil, dtype=np.int64)
        # Where the derivatives stand among the 3^dim combinations of orders along the axes.
        unit = 3 ** np.arange(values.ndim)[::-1]
        self._gradient_orders: IntArray = unit
        self._hessian_orders: IntArray = (unit[:, None] + unit).ravel()

    @property
    def dim(self) -> int:
        return int(self.shape.size)

    @property
    def _corners(self) -> Iterator[tuple[int, ...]]:
        return itertools.product(range(4), repeat=self.dim)

    def _gather(self, z: Array) -> tuple[Array, Array]:
        """Coefficients around each point (4, .., 4, n) and fractions within its cell (dim, n)."""
        t = (z - self.origin).T / self.spacing
        cell = np.clip(np.floor(t), 0, (self.shape - 2)[:, None])
        base = self._strides @ cell.astype(np.int64)
        coefficients = self._coefficients.take(self._stencil[:, None] + base)
        return coefficients.reshape((4,) * self.dim + (len(z),)), t - cell

    def value(self, z: Array) -> Array:
        """Values (n,) at points z (n, dim)."""
        result = np.empty(len(z))
        for start in range(0, len(z), CHUNK):
            chunk = slice(start, start + CHUNK)
            c, fractions = self._gather(z[chunk])
            basis = _polynomials(fractions, 1)[0]
            for axis in reversed(range(self.dim)):
                c = (c * basis[:, axis]).sum(axis=-2)
            result[chunk] = c
        return result

    def derivatives(self, z: Array) -> SdfDerivatives:
        """Value (n,), gradient (n, dim) and Hessian (n, dim, dim) at points z (n, dim)."""
        n, dim = z.shape
        result = SdfDerivatives(np.empty(n), np.empty((n, dim)), np.empty((n, dim, dim)))
        for start in range(0, n, CHUNK):
            self._fill(z[start : start + CHUNK], result.take(slice(start, start + CHUNK)))
        return result

    def _fill(self, z: Array, out: SdfDerivatives) -> None:
        c, fractions = self._gather(z)
        basis = _polynomials(fractions, 3)
        # Sum the stencil axes from the last to the first, each into a front axis for the order of its derivative.
        # Orders above two come along unused: cheaper than picking them out, for the few points that contact asks for.
        partial = c
        for axis in reversed(range(self.dim)):
            weights = basis[:, :, axis].reshape(3, *(1,) * (partial.ndim - 2), 4, -1)
            partial = (partial * weights).sum(axis=-2)
        orders = partial.reshape(-1, partial.shape[-1])
        out.value[:] = orders[0]
        np.divide(orders[self._gradient_orders].T, self.spacing, out=out.gradient)
        hessian = orders[self._hessian_orders].T / self.spacing**2
        out.hessian[:] = hessian.reshape(out.hessian.shape)
