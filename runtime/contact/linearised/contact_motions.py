"""Motions of the active points of a contact: by what each of them changes positions, displacements and forces.

A motion moves a point by dxi while its displacement v is fixed in rest coordinates, and changes its rest force by dphi
while its contact force f is fixed. In the symbols of `linearised_contact.py`, with c = dxi + A G dphi,

    df = -D (I + G_w D)^-1 c,    dv = G (dphi + A^T df),    dy = dxi + A dv = (I + G_w D)^-1 c.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.contact.solver.woodbury import Floats, WoodburyFactor
from softprint.runtime.lazy import lazy
from softprint.runtime.linalg.sparse_directions import times_directions


@dataclass(frozen=True, eq=False)
class ContactMotions:
    """n motions of the k active points of a factorised contact. position: dxi, and force: dphi (k*dim, n)."""

    factor: WoodburyFactor
    position: Floats
    force: Floats

    def along(self, directions: Array | None) -> ContactMotions:
        """In the precision of the factor, along some directions (n, m); None for all motions as they are."""
        position, force = (part.astype(self.factor.dtype, copy=False) for part in (self.position, self.force))
        if directions is not None:
            position, force = times_directions(position, directions), times_directions(force, directions)
        return ContactMotions(self.factor, position, force)

    def second(self, other: ContactMotions) -> Floats:
        """c^T D (I + G_w D)^-1 c' - dphi^T G dphi' (n, n') with other motions of the same points."""
        return np.asarray(self._stretched.T @ other._relaxed - self.displacement.T @ other.force)

    @lazy
    def displacement(self) -> Floats:
        """G dphi (k*dim, n)."""
        return self.factor.rest_displacement(self.force)

    @lazy
    def reaction(self) -> Floats:
        """-df (k*dim, n)."""
        return self.factor.expanded(self._relaxed, len(self.position))

    @lazy
    def displaced(self) -> Floats:
        """dv (k*dim, n)."""
        return self.displacement - self.factor.rest_displacement(self.factor.to_rest(self.reaction))

    @lazy
    def deformed(self) -> Floats:
        """dy (k*dim, n)."""
        return np.asarray(self.position + self.factor.to_world(self.displaced))

    @lazy
    def _stretched(self) -> Floats:
        """W^T c (r, n)."""
        return self.factor.projected(self.position + self.factor.to_world(self.displacement))

    @lazy
    def _relaxed(self) -> Floats:
        """K^-1 W^T c (r, n)."""
        return self.factor.solve(self._stretched)
