"""A collider whose signed distance is a C2 spline through exact distances sampled on regular grids.

A fine grid covers the solid and its surroundings, and a coarse grid the space where a soft body may be. Beyond that,
the distance to the bounding ball is used, which is never too large. From the outside in, each is blended into the next,

    s <- s + w (grid - s),    w = prod_i S(u_i),    S(u) = 6 u^5 - 15 u^4 + 10 u^3,

u_i being the distance to the grid's border along axis i over the width of a band, at most 1. So s is C2
throughout and its derivatives are exact. Where the exact distance has a kink (medial axis, sharp edges) the
spline rounds it off over about one cell.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.colliders.collider import ColliderBase, SdfDerivatives, norm_derivatives
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.colliders.sampled.spline import SplineGrid

# How far each grid reaches beyond the solid, as a share of the solid's largest extent.
FINE_MARGIN, COARSE_MARGIN = 0.25, 2.0
# Cells of the coarse grid are this many times larger: it is only used where the field is smooth.
COARSENING = 4
# Share of each grid's margin over which it is blended into the surrounding field.
BLEND_BAND = 0.5


@dataclass(frozen=True, eq=False)
class _Level:
    """A grid and the width of the band along its border in which it is blended into the surrounding field."""

    grid: SplineGrid
    band: float

    @cached_property
    def core_bounds(self) -> tuple[Array, Array]:
        """Bounds of the box in which the blend weight is 1."""
        return self.grid.origin + self.band, self.grid.upper - self.band

    def core(self, z: Array) -> BoolArray:
        """Which points lie where the blend weight is 1."""
        lower, upper = self.core_bounds
        return np.asarray(((z >= lower) & (z <= upper)).all(axis=1))

    def within(self, z: Array) -> IntArray:
        """Indices of the points where the blend weight is not zero."""
        return np.flatnonzero(((z > self.grid.origin) & (z < self.grid.upper)).all(axis=1))

    def weight(self, z: Array) -> SdfDerivatives:
        """w and its derivatives for points within the grid."""
        dim = z.shape[1]
        from_lower, from_upper = z - self.grid.origin, self.grid.upper - z
        towards = np.where(from_lower < from_upper, 1.0, -1.0) / self.band
        u, step = self._steps(z)
        first = 30 * u**2 * (1 - u) ** 2 * towards
        second = 60 * u * (1 - u) * (1 - 2 * u) * towards**2
        factors = np.repeat(step[:, None, :], dim, axis=1)  # row i: the factors of dw/dz_i
        diagonal = np.arange(dim)
        factors[:, diagonal, diagonal] = first
        hessian = np.repeat(factors[:, :, None, :], dim, axis=2)  # [i, j]: the factors of d2w/dz_i dz_j
        for i in range(dim):
            for j in range(dim):
                hessian[:, i, j, j] = second[:, i] if i == j else first[:, j]
        return SdfDerivatives(step.prod(axis=1), factors.prod(axis=2), hessian.prod(axis=3))

    def weight_value(self, z: Array) -> Array:
        """w (n,) alone."""
        return np.asarray(self._steps(z)[1].prod(axis=1))

    def _steps(self, z: Array) -> tuple[Array, Array]:
        """How far points are from the border along each axis, in bands, 1 at most, and the factors of w, each (n,
        dim)."""
        u = np.minimum(np.minimum(z - self.grid.origin, self.grid.upper - z) / self.band, 1.0)
        return u, u**3 * (6 * u**2 - 15 * u + 10)


class GridCollider(ColliderBase):
    """A solid given by `exact`, the signed distance (n,) of points (n, dim), smoothed by a spline grid.

    vertices (v, dim) [m] and facets (f, dim), triangles or segments: the surface, whose bounds set the size of the
    grid; resolution: grid cells along the longest side of the solid; on_grid: the same distance (n_0, ..) at the nodes
    origin (dim,) + index spacing of a grid of n (dim,) of them, if it can be computed faster than point by point.
    """

    def __init__(
        self,
        exact: Callable[[Array], Array],
        vertices: Array,
        facets: IntArray,
        resolution: int,
        name: str,
        on_grid: Callable[[Array, IntArray, float], Array] | None = None,
    ) -> None:
        self._on_grid = on_grid or self._point_by_point
        self.name, self.exact, self.vertices, self.facets = name, exact, vertices, facets
        self.lower, self.upper = vertices.min(axis=0), vertices.max(axis=0)
        longest = float((self.upper - self.lower).max())
        self.spacing = longest / resolution
        # The spline rounds off edges and thin walls: there it is negative outside the bounds, within a cell.
        self._outermost = self.lower - self.spacing, self.upper + self.spacing
        self._fine_margin = FINE_MARGIN * longest
        self.fine = self._sample(self._fine_margin, self.spacing)
        self.coarse = self._sample(COARSE_MARGIN * longest, COARSENING * self.spacing)
        self._centre = 0.5 * (self.lower + self.upper)
        self._ball_radius = float(np.linalg.norm(vertices - self._centre, axis=1).max())

    def _sample(self, margin: float, spacing: float) -> _Level:
        cells = np.ceil((self.upper - self.lower + 2 * margin) / spacing).astype(int)
        origin = 0.5 * (self.lower + self.upper) - 0.5 * cells * spacing
        values = self._on_grid(origin, cells + 1, spacing)
        return _Level(SplineGrid(values, origin, spacing), BLEND_BAND * margin)

    def _point_by_point(self, origin: Array, counts: IntArray, spacing: float) -> Array:
        axes = [o + spacing * np.arange(n) for o, n in zip(origin, counts, strict=True)]
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(counts))
        return self.exact(nodes).reshape(counts)

    def sdf(self, z: Array) -> Array:
        value = np.empty(len(z))
        core = self.fine.core(z)
        if core.all():
            return self.fine.grid.value(z)
        value[core] = self.fine.grid.value(z[core])
        around = np.flatnonzero(~core)
        value[around] = self._around_value(z[around])
        return value

    def sdf_derivatives(self, z: Array) -> SdfDerivatives:
        core = self.fine.core(z)
        if core.all():
            return self.fine.grid.derivatives(z)
        n, dim = z.shape
        result = SdfDerivatives(np.empty(n), np.empty((n, dim)), np.empty((n, dim, dim)))
        for part, values in ((core, self.fine.grid.derivatives(z[core])), (~core, self._around(z[~core]))):
            for column, own in zip(result, values, strict=True):
                column[part] = own
        return result

    def closer(self, z: Array, distance: float) -> tuple[IntArray, Array]:
        """See `Collider`. The distance is only evaluated at points where the lower bound from the spline's coefficients
        does not exclude contact."""
        lower, upper = self._outermost
        index = np.flatnonzero(((z > lower - distance) & (z < upper + distance)).all(axis=1))
        # The core of the fine grid reaches farther than the rest of its margin beyond the bounds.
        if distance < (1.0 - BLEND_BAND) * self._fine_margin:
            index = index[self.fine.grid.at_least(z[index]) < distance]
        value = self.sdf(z[index])
        close = value < distance
        return index[close], value[close]

    def closer_to(self, x: Array, pose: RigidPose, distance: float) -> tuple[IntArray, Array, Array]:
        """See `Collider`."""
        if distance >= (1.0 - BLEND_BAND) * self._fine_margin:
            return super().closer_to(x, pose, distance)
        return self.fine.grid.closer_to(x, pose, *self._outermost, distance)

    def sdf_derivatives_at(self, x: Array, pose: RigidPose) -> SdfDerivatives:
        """See `Collider`."""
        found = self.fine.grid.derivatives_within(x, pose, *self.fine.core_bounds)
        return super().sdf_derivatives_at(x, pose) if found is None else found.rotated(pose)

    def _around(self, z: Array) -> SdfDerivatives:
        """Derivatives outside the core of the fine grid: ball, coarse and fine grid, blended."""
        ball = norm_derivatives(z - self._centre)
        result = ball._replace(value=ball.value - self._ball_radius)
        for level in (self.coarse, self.fine):
            part = level.within(z)
            w, inner, outer = level.weight(z[part]), level.grid.derivatives(z[part]), result.take(part)
            apart = SdfDerivatives(*(a - b for a, b in zip(inner, outer, strict=True)))
            mixed = w.gradient[:, :, None] * apart.gradient[:, None, :]
            hessian = w.value[:, None, None] * apart.hessian + apart.value[:, None, None] * w.hessian
            result.value[part] += w.value * apart.value
            result.gradient[part] += w.value[:, None] * apart.gradient + apart.value[:, None] * w.gradient
            result.hessian[part] += hessian + mixed + mixed.transpose(0, 2, 1)
        return result

    def _around_value(self, z: Array) -> Array:
        """The value of `_around` without the cost of its derivatives."""
        value: Array = np.linalg.norm(z - self._centre, axis=1) - self._ball_radius
        for level in (self.coarse, self.fine):
            part = level.within(z)
            w = level.weight_value(z[part])
            value[part] += w * (level.grid.value(z[part]) - value[part])
        return value

    def accuracy(self, rng: np.random.Generator, points: int = 20_000) -> dict[str, float]:
        """Measured error against the exact distance [m]: at the surface and within a quarter of `size`.

        Keys: `surface_max`, `surface_rms` (spline at points of the surface, where the exact value is zero),
        `band_max`, `band_rms`, and `gradient_rms` (how far |grad| is from one at the surface).
        """
        corners = self.vertices[self.facets[rng.integers(len(self.facets), size=points)]]
        barycentric = rng.dirichlet(np.ones(corners.shape[1]), size=points)
        surface = np.einsum("nc,ncd->nd", barycentric, corners)
        at_surface = self.fine.grid.derivatives(surface)
        band = surface + rng.uniform(-0.25, 0.25, surface.shape) * self.size / np.sqrt(self.dim)
        off = self.sdf(band) - self.exact(band)
        stretch = np.linalg.norm(at_surface.gradient, axis=1) - 1.0
        return {
            "surface_max": float(np.abs(at_surface.value).max()),
            "surface_rms": float(np.sqrt(np.mean(at_surface.value**2))),
            "band_max": float(np.abs(off).max()),
            "band_rms": float(np.sqrt(np.mean(off**2))),
            "gradient_rms": float(np.sqrt(np.mean(stretch**2))),
        }
