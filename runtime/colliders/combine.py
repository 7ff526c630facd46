"""Placed and combined colliders: smooth union and difference of signed distances.

The smooth minimum of a and b with blend width k is

    m(a, b) = min(a, b) - (k/6) max(0, 1 - |a - b|/k)^3,

which is C2, equals min(a, b) where the two differ by k or more, and lies at most k/6 below it. Combined distances are
exact where one part is nearer than all others by k. Elsewhere they are a bound: the gradient is a convex combination of
unit vectors, shorter than one where the parts' normals disagree.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.colliders import cone_kernels
from softprint.runtime.colliders.collider import Collider, ColliderBase, SdfDerivatives
from softprint.runtime.colliders.kinds.cone import Cone, side_by_side
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.colliders.surface_points import surface_points
from softprint.runtime.compiled import compiled
from softprint.runtime.errors import SoftprintError

# Points along the longest side of a difference among which something of its surface has to be.
_POINTS_ALONG = 32


def smooth_minimum(a: SdfDerivatives, b: SdfDerivatives, blend: float) -> SdfDerivatives:
    """m(a, b) and its derivatives with respect to the points, from those of a and b."""
    return SdfDerivatives(*_smooth_minimum(*a, *b, blend))


def _by_chain_rule(
    a: Array, a_1: Array, a_2: Array, b: Array, b_1: Array, b_2: Array, blend: float
) -> tuple[Array, Array, Array]:
    """m = min(a, b) - blend/6 (1 - t)^3 with t = min(|a - b| / blend, 1), its first and second derivatives."""
    t, apart = np.minimum(np.abs(a - b) / blend, 1.0), a_1 - b_1
    of_a = 0.5 + 0.5 * np.sign(a - b) * ((1 - t) ** 2 - 1)
    gradient = np.einsum("p,pi->pi", of_a, a_1) + np.einsum("p,pi->pi", 1 - of_a, b_1)
    hessian = np.einsum("p,pij->pij", of_a, a_2) + np.einsum("p,pij->pij", 1 - of_a, b_2)
    return (
        np.minimum(a, b) - blend / 6 * (1 - t) ** 3,
        gradient,
        hessian - np.einsum("p,pi,pj->pij", (1 - t) / blend, apart, apart),
    )


@compiled(reference=_by_chain_rule)
def _smooth_minimum(
    a: Array, a_1: Array, a_2: Array, b: Array, b_1: Array, b_2: Array, blend: float
) -> tuple[Array, Array, Array]:
    n, dim = a_1.shape
    value, gradient, hessian = np.empty(n), np.empty((n, dim)), np.empty((n, dim, dim))
    for p in range(n):
        difference = a[p] - b[p]
        t = min(abs(difference) / blend, 1.0)
        value[p] = min(a[p], b[p]) - blend / 6.0 * (1.0 - t) ** 3
        first = 0.5 * np.sign(difference) * ((1.0 - t) ** 2 - 1.0)  # dm/da = 1/2 + first, dm/db = 1/2 - first
        second = -(1.0 - t) / blend
        of_a, of_b = 0.5 + first, 0.5 - first
        for i in range(dim):
            gradient[p, i] = of_a * a_1[p, i] + of_b * b_1[p, i]
            for j in range(dim):
                apart = (a_1[p, i] - b_1[p, i]) * (a_1[p, j] - b_1[p, j])
                hessian[p, i, j] = of_a * a_2[p, i, j] + of_b * b_2[p, i, j] + second * apart
    return value, gradient, hessian


def smooth_minimum_value(a: Array, b: Array, blend: float) -> Array:
    """m(a, b) alone."""
    value: Array = np.minimum(a, b) - blend / 6.0 * np.maximum(0.0, 1.0 - np.abs(a - b) / blend) ** 3
    return value


def _negative(d: SdfDerivatives) -> SdfDerivatives:
    return SdfDerivatives(-d.value, -d.gradient, -d.hessian)


def _same_dim(name: str, parts: Sequence[Collider]) -> None:
    if not parts:
        raise SoftprintError(f"collider '{name}' has no parts; give at least one")
    if len({part.dim for part in parts}) != 1:
        listed = ", ".join(f"'{part.name}' is {part.dim}D" for part in parts)
        raise SoftprintError(f"collider '{name}' mixes dimensions: {listed}")


def _positive_blend(name: str, blend: float) -> float:
    if not (np.isfinite(blend) and blend > 0):
        raise SoftprintError(
            f"the blend of collider '{name}' must be a positive number of metres, not {blend}"
        )
    return float(blend)


class Placed(ColliderBase):
    """A collider moved by a rigid pose within its owner's coordinates."""

    def __init__(self, part: Collider, pose: RigidPose) -> None:
        if part.dim != pose.dim:
            raise SoftprintError(f"collider '{part.name}' is {part.dim}D but is placed by a {pose.dim}D pose")
        self.name, self.part, self.pose = part.name, part, pose
        if np.isfinite(part.lower).all() and np.isfinite(part.upper).all():
            centre = pose.apply(0.5 * (part.lower + part.upper)[None])[0]
            half = np.abs(pose.rotation) @ (0.5 * (part.upper - part.lower))
            self.lower, self.upper = centre - half, centre + half
        else:
            self.upper = np.full(part.dim, np.inf)
            self.lower = -self.upper

    def sdf(self, z: Array) -> Array:
        return self.part.sdf(self.pose.apply_inverse(z))

    def sdf_derivatives(self, z: Array) -> SdfDerivatives:
        d = self.part.sdf_derivatives(self.pose.apply_inverse(z))
        return SdfDerivatives(d.value, self.pose.rotate(d.gradient), self.pose.rotate_matrices(d.hessian))


class SmoothUnion(ColliderBase):
    """Everything in any of the parts, with fillets of width `blend` [m] where parts meet."""

    def __init__(self, parts: Sequence[Collider], blend: float, name: str = "union") -> None:
        _same_dim(name, parts)
        self.name, self.parts, self.blend = name, tuple(parts), _positive_blend(name, blend)
        swell = self.blend / 6.0 * (len(parts) - 1)  # each smooth minimum adds at most blend / 6
        self.lower = np.min([part.lower for part in parts], axis=0) - swell
        self.upper = np.max([part.upper for part in parts], axis=0) + swell

        # Most unions consist of cones and capsules, for which there is a compiled kernel.
        cones = [part for part in parts if isinstance(part, Cone)]
        self._cones = side_by_side(cones) if len(cones) == len(parts) else None

    def sdf(self, z: Array) -> Array:
        if self._cones is not None:
            return cone_kernels.values(np.ascontiguousarray(z), self._cones, self.blend)
        value = self.parts[0].sdf(z)
        for part in self.parts[1:]:
            value = smooth_minimum_value(value, part.sdf(z), self.blend)
        return value

    def sdf_derivatives(self, z: Array) -> SdfDerivatives:
        if self._cones is not None:
            found = cone_kernels.derivatives(np.ascontiguousarray(z), self._cones, self.blend)
            return SdfDerivatives(*found)
        total = self.parts[0].sdf_derivatives(z)
        for part in self.parts[1:]:
            total = smooth_minimum(total, part.sdf_derivatives(z), self.blend)
        return total


class SmoothDifference(ColliderBase):
    """`base` without any of the parts; the edges of each cut are rounded over `blend` [m]. Raises SoftprintError where
    the parts leave nothing of a base with bounds."""

    def __init__(
        self, base: Collider, parts: Sequence[Collider], blend: float, name: str = "difference"
    ) -> None:
        _same_dim(name, [base, *parts])
        self.name, self.base, self.parts = name, base, tuple(parts)
        self.blend = _positive_blend(name, blend)
        self.lower, self.upper = base.lower, base.upper
        extent = float((self.upper - self.lower).max())
        if np.isfinite(extent) and not len(surface_points(self, extent / _POINTS_ALONG)):
            raise SoftprintError(f"collider {name!r}: its parts cut all of its base away")

    def sdf(self, z: Array) -> Array:
        outside = -self.base.sdf(z)
        for part in self.parts:
            outside = smooth_minimum_value(outside, part.sdf(z), self.blend)
        return -outside

    def sdf_derivatives(self, z: Array) -> SdfDerivatives:
        outside = _negative(self.base.sdf_derivatives(z))
        for part in self.parts:
            outside = smooth_minimum(outside, part.sdf_derivatives(z), self.blend)
        return _negative(outside)
