"""What condensed contact displaces at nodes of a body, by linear mechanics: with colliders that have no correction.

    u_X = R_X sum_j G_Xj f_j

with the forces f_j in rest coordinates on the contact nodes, friction included, the compliance G, and the rotations R
of the deformation of the subspace.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.material_points import MaterialPoints
from softprint.runtime.body.rotations import nearest_rotations
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.contact.contact_force import FrictionForces
from softprint.runtime.contact.solver.contact_solve_kernels import to_world
from softprint.runtime.contact.solver.solved_contact import SolvedContact
from softprint.runtime.linalg.row_products import deformed
from softprint.runtime.mechanics.compliance.surface_compliance import SurfaceCompliance


class DrawnContact:
    """A `BoundContactCorrection` without anything learned. points: the nodes (n,) of the body; names: of the colliders,
    as `contact` knows them."""

    def __init__(
        self,
        points: MaterialPoints,
        nodes: IntArray,
        compliance: SurfaceCompliance,
        contact: CondensedContact,
        names: Sequence[str],
    ) -> None:
        self._compliance, self._contact, self._names = compliance.at(nodes), contact, tuple(names)
        self._shape = points.rest.shape
        # In single precision, that of the compliance, as every evaluation reads all of it.
        gradient = points.basis_gradient.transpose(0, 2, 1).astype(np.float32)
        self._gradient = np.ascontiguousarray(gradient)

    def displacement(self, solved: SolvedContact, friction: FrictionForces | None = None) -> Array:
        """See `BoundContactCorrection`."""
        mine = np.zeros(len(solved.active), dtype=np.bool_)
        for name in self._names:
            mine |= solved.owned_by(name)
        parts = [self._contact.node_forces(solved, mine)] if mine.any() else []
        if friction is not None:
            parts.append(friction)
        if not parts:
            return np.zeros(self._shape)
        nodes, forces = map(np.concatenate, zip(*parts, strict=True))
        v = self._compliance.apply(nodes, forces.astype(np.float32))
        return turned(v, self._gradient, solved.rows)


def turned(v: NDArray[Any], gradients: NDArray[Any], rows: Array) -> Array:
    """R v (n, dim) of displacements v (n, dim) in rest coordinates, with the rotations R of the deformation of the
    subspace at handle rows (n_rows, dim). gradients: (n, dim, n_rows) of its basis."""
    return to_world(nearest_rotations(deformed(gradients, rows)), v)
