"""Cubic B-spline interpolation of samples on a regular grid: a C2 field with cheap exact derivatives.

Along each axis the value in a cell is the sum of four basis polynomials b_i of the fraction f in [0, 1]:

    b_0 = (1-f)^3/6,  b_1 = (3 f^3 - 6 f^2 + 4)/6,  b_2 = (-3 f^3 + 3 f^2 + 3 f + 1)/6,  b_3 = f^3/6,

times the coefficients of the 4^dim nodes around (Unser 1999). All derivatives up to the second along each axis come
from one chain of matrix products a point, axis by axis from the last: contact asks for some tens of points many times
a step, where the number of operations is what costs.

The b_i are not negative and sum to one, so that the value is never below the least of the coefficients around.
"""

from __future__ import annotations

import itertools
from functools import cached_property

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
    """The four polynomials at fractions f (n, dim) and their derivatives below `orders`: (n, dim, orders, 4)."""
    powers = np.empty((*f.shape, 4))
    powers[..., 0], powers[..., 1] = 1.0, f
    np.multiply(f, f, out=powers[..., 2])
    np.multiply(powers[..., 2], f, out=powers[..., 3])
    values = powers.reshape(-1, 4) @ _CUBICS[: 4 * orders].T
    return values.reshape(*f.shape, orders, 4)


class SplineGrid:
    """The interpolant of values (n_0, ..) given at origin + index * spacing, for points within the grid."""

    def __init__(self, values: Array, origin: Array, spacing: float) -> None:
        self.origin, self.spacing = np.asarray(origin, dtype=float), float(spacing)
        self.shape = np.array(values.shape)
        self.upper = self.origin + (self.shape - 1) * self.spacing
        coefficients = spline_filter(values, order=3, mode="mirror")
        padded = np.pad(coefficients, [(1, 2)] * values.ndim, mode="reflect")
        self._padded_shape = padded.shape
        self._coefficients = np.ascontiguousarray(padded).ravel()
        self._strides = np.array([float(np.prod(padded.shape[a + 1 :])) for a in range(values.ndim)])
        corners = np.array(list(itertools.product(range(4), repeat=values.ndim)))
        self._stencil: IntArray = (corners @ self._strides).astype(np.int64)
        self._last_cell = self.shape - 2.0
        # Where the derivatives stand among the 3^dim combinations of orders along the axes.
        unit = 3 ** np.arange(values.ndim)[::-1]
        self._gradient_orders: IntArray = unit
        self._hessian_orders: IntArray = (unit[:, None] + unit).ravel()

    @property
    def dim(self) -> int:
        return int(self.shape.size)

    @cached_property
    def _least(self) -> Array:
        """The least of the coefficients around a cell, where the first of them is."""
        least = self._coefficients.reshape(self._padded_shape)
        for axis in range(self.dim):
            # What comes around from the other end belongs to no cell.
            least = np.minimum.reduce([np.roll(least, -i, axis) for i in range(4)])
        return least.ravel()

    def _cells(self, z: Array) -> tuple[IntArray, Array]:
        """Where the first coefficient of each point's cell is (n,), and the fractions within the cell (n, dim)."""
        t = (z - self.origin) / self.spacing
        cell = np.minimum(np.maximum(np.floor(t), 0.0), self._last_cell)
        return (cell @ self._strides).astype(np.int64), t - cell

    def _orders(self, z: Array, orders: int) -> Array:
        """Derivatives below `orders` along each axis, by fractions of a cell: (n, orders^dim)."""
        n = len(z)
        first, fractions = self._cells(z)
        c = self._coefficients.take(first[:, None] + self._stencil)
        basis = _polynomials(fractions, orders)
        c = c.reshape(n, -1, 4) @ basis[:, -1].transpose(0, 2, 1)
        for axis in reversed(range(self.dim - 1)):
            c = basis[:, axis, None] @ c.reshape(n, 4**axis, 4, -1)
        return c.reshape(n, -1)

    def at_least(self, z: Array) -> Array:
        """(n,) what the values at points z (n, dim) are not below, for a single look at memory each."""
        return self._least.take(self._cells(z)[0])

    def value(self, z: Array) -> Array:
        """Values (n,) at points z (n, dim)."""
        result = np.empty(len(z))
        for start in range(0, len(z), CHUNK):
            chunk = slice(start, start + CHUNK)
            result[chunk] = self._orders(z[chunk], 1)[:, 0]
        return result

    def derivatives(self, z: Array) -> SdfDerivatives:
        """Value (n,), gradient (n, dim) and Hessian (n, dim, dim) at points z (n, dim)."""
        n, dim = z.shape
        result = SdfDerivatives(np.empty(n), np.empty((n, dim)), np.empty((n, dim, dim)))
        for start in range(0, n, CHUNK):
            self._fill(z[start : start + CHUNK], result.take(slice(start, start + CHUNK)))
        return result

    def _fill(self, z: Array, out: SdfDerivatives) -> None:
        # Orders above two come along unused: cheaper than picking them out of the products.
        orders = self._orders(z, 3)
        out.value[:] = orders[:, 0]
        np.divide(orders[:, self._gradient_orders], self.spacing, out=out.gradient)
        hessian = orders[:, self._hessian_orders] / self.spacing**2
        out.hessian[:] = hessian.reshape(out.hessian.shape)
