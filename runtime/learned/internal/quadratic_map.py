"""A quadratic function of an input, in NumPy, with first and second derivatives in closed form.

    y(z) = d + L w + 1/2 Q w w,    w = P^T z,    dy/dw = L + Q w,    d2(a . y)/dw2 = a . Q,

so that one product, Q w, gives value and slope.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.lazy import lazy


@dataclass(frozen=True, eq=False)
class QuadraticMap:
    """directions: P (n_in, r), in which the input can change; offset: d (n_out,); linear: L (n_out, r); quadratic: Q
    (n_out, r, r), symmetric in the last two."""

    directions: Array
    offset: Array
    linear: Array
    quadratic: Array

    def value(self, z: Array) -> Array:
        """y (n_out,) of one input z (n_in,)."""
        return self.at(z).value

    def at(self, z: Array) -> QuadraticPoint:
        """The function at one input, with its derivatives."""
        w = z @ self.directions
        return QuadraticPoint(self, w, (self.quadratic.reshape(-1, len(w)) @ w).reshape(-1, len(w)))


@dataclass(frozen=True, eq=False)
class QuadraticPoint:
    """At one input. reduced: w (r,); turned: Q w (n_out, r)."""

    map: QuadraticMap
    reduced: Array
    turned: Array

    @lazy
    def value(self) -> Array:
        """y (n_out,)."""
        return np.asarray(self.map.offset + (self.map.linear + 0.5 * self.turned) @ self.reduced)

    @lazy
    def reduced_slope(self) -> Array:
        """dy/dw (n_out, r)."""
        return np.asarray(self.map.linear + self.turned)

    def moved(self, directions: Array) -> MovedQuadratic:
        """The function along directions (n_in, k)."""
        reduced = self.map.directions.T @ directions
        return MovedQuadratic(self.map, reduced, self.reduced_slope @ reduced)

    def pulled_back(self, along: Array) -> Array:
        """d(a . y)/dz (n_in,) of a direction a (n_out,)."""
        return np.asarray(self.map.directions @ (along @ self.reduced_slope))


@dataclass(frozen=True, eq=False)
class MovedQuadratic:
    """The derivatives along k directions. reduced: (r, k) of these; slope: dy (n_out, k)."""

    map: QuadraticMap
    reduced: Array
    slope: Array

    def curvature(self, along: Array) -> Array:
        """d2(a . y) (k, k) between the directions, of a (n_out,)."""
        r = len(self.reduced)
        bent = (along @ self.map.quadratic.reshape(-1, r * r)).reshape(r, r)
        return np.asarray(self.reduced.T @ (bent @ self.reduced))
