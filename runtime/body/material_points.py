"""The data of body points that corrections take as inputs."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from softprint.runtime.arrays import Array, IntArray


@dataclass(frozen=True, eq=False)
class MaterialPoints:
    """Rest geometry and subspace basis at n points of a body.

    rest: (n, dim) [m]; basis: (n, n_rows), so that reduced positions are basis @ rows; basis_gradient:
    (n, n_rows, dim) [1/m], volume-averaged at nodes, so that F_ij = sum_r rows_ri basis_gradient_rj;
    surface_distance: (n,) rest distance to the body's surface [m]; surface_normal: (n, dim) outward unit
    normal of the nearest surface point.
    """

    rest: Array
    basis: Array
    basis_gradient: Array
    surface_distance: Array
    surface_normal: Array

    def __len__(self) -> int:
        return len(self.rest)

    @property
    def dim(self) -> int:
        return int(self.rest.shape[1])

    def followed_by(self, other: MaterialPoints) -> MaterialPoints:
        """These points, and then the others."""
        columns = ((getattr(part, field.name) for part in (self, other)) for field in fields(self))
        return MaterialPoints(*(np.concatenate(list(column)) for column in columns))

    def take(self, index: IntArray | slice) -> MaterialPoints:
        """The points of the given indices, mask or slice."""
        return MaterialPoints(
            self.rest[index],
            self.basis[index],
            self.basis_gradient[index],
            self.surface_distance[index],
            self.surface_normal[index],
        )
