"""Cubic B-spline interpolation of samples on a regular grid: a C2 field with cheap exact derivatives.

Along each axis the value in a cell is the sum of four basis polynomials b_i of the fraction f in [0, 1]:

    b_0 = (1-f)^3/6,  b_1 = (3 f^3 - 6 f^2 + 4)/6,  b_2 = (-3 f^3 + 3 f^2 + 3 f + 1)/6,  b_3 = f^3/6,

times the coefficients of the 4^dim nodes around (Unser 1999); `spline_kernels.py` computes the sums.

The b_i are nonnegative and sum to one, so the value is never below the smallest of these coefficients.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.ndimage import spline_filter

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.collider import SdfDerivatives
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.colliders.sampled import spline_kernels


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
        self._strides = np.array(
            [np.prod(padded.shape[axis + 1 :], dtype=np.int64) for axis in range(values.ndim)]
        )
        self._last_cell = self.shape - 2.0

    @property
    def dim(self) -> int:
        return int(self.shape.size)

    @cached_property
    def _least(self) -> Array:
        """The smallest coefficient of each cell, at the index of its first coefficient."""
        least = self._coefficients.reshape(self._padded_shape)
        for axis in range(self.dim):
            # Entries that wrap around from the other end belong to no cell.
            least = np.minimum.reduce([np.roll(least, -i, axis) for i in range(4)])
        return least.ravel()

    def at_least(self, z: Array) -> Array:
        """(n,) lower bounds of the values at points z (n, dim), with one memory access each."""
        cell = np.clip(np.floor((z - self.origin) / self.spacing), 0.0, self._last_cell).astype(np.int64)
        return self._least.take(cell @ self._strides)

    def value(self, z: Array) -> Array:
        """Values (n,) at points z (n, dim)."""
        result = np.empty(len(z))
        spline_kernels.values(*self._kernel_arguments(z), result)
        return result

    def gradients(self, z: Array) -> tuple[Array, Array]:
        """Value (n,) and gradient (n, dim) at points z (n, dim)."""
        result = np.empty(len(z)), np.empty(z.shape)
        spline_kernels.gradients(*self._kernel_arguments(z), *result)
        return result

    def derivatives(self, z: Array) -> SdfDerivatives:
        """Value (n,), gradient (n, dim) and Hessian (n, dim, dim) at points z (n, dim)."""
        n, dim = z.shape
        result = SdfDerivatives(np.empty(n), np.empty((n, dim)), np.empty((n, dim, dim)))
        spline_kernels.derivatives(*self._kernel_arguments(z), *result)
        return result

    def derivatives_within(
        self, x: Array, pose: RigidPose, lower: Array, upper: Array
    ) -> SdfDerivatives | None:
        """The derivatives at world points x (n, dim) with the grid at a pose, in the grid's coordinates; None unless
        all points are in the box from lower to upper (dim,) of the grid."""
        inside, *found = spline_kernels.derivatives_within(
            pose.rotation, pose.translation, lower, upper, *self._kernel_arguments(x)
        )
        return SdfDerivatives(*found) if inside else None

    def closer_to(
        self, x: Array, pose: RigidPose, lower: Array, upper: Array, distance: float
    ) -> tuple[IntArray, Array, Array]:
        """Indices (m,) of the world points x (n, dim) that are within `distance` of the box from lower to upper (dim,)
        of the grid at a pose and have values below `distance`, with their local coordinates (m, dim) and values
        (m,)."""
        at = np.ascontiguousarray(x, dtype=np.float64)
        return spline_kernels.closer(
            at,
            pose.rotation,
            pose.translation,
            lower - distance,
            upper + distance,
            distance,
            self.origin,
            self.spacing,
            self._last_cell,
            self._strides,
            self._least,
            self._coefficients,
        )

    def _kernel_arguments(self, z: Array) -> tuple[Array, Array, float, Array, IntArray, Array]:
        """The arguments that all kernels share."""
        at = np.ascontiguousarray(z, dtype=np.float64)
        return at, self.origin, self.spacing, self._last_cell, self._strides, self._coefficients
