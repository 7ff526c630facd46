"""A displacement of the nodes of a body outside its subspace, as a function of its reduced state.

*Internal* corrections are such displacements: of a body without contact (thesis 4.3.1), which belong to the body alone.
Elasticity and contact see the displaced nodes, and its forces on the handles are pulled back through its Jacobian.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray


@dataclass(frozen=True, eq=False)
class CorrectionField:
    """A correction where it is active, linearised in the reduced state.

    index: (m,) which of the bound points; displacement: (m, dim) u [m], world frame;
    jacobian: (m, dim, n_rows, dim) du_a / d rows_rb with the collider fixed.
    """

    index: IntArray
    displacement: Array
    jacobian: Array

    @property
    def converged(self) -> bool:
        """Whether what the field solves for, such as amplitudes in elastic equilibrium, was found."""
        return True

    def pulled_back(self, forces: Array) -> Array:
        """sum_i f_i . du_i/drows (n_rows, dim) of forces (m, dim) at its points."""
        m, dim, n_rows, _ = self.jacobian.shape
        return np.asarray((forces.ravel() @ self.jacobian.reshape(m * dim, -1)).reshape(n_rows, dim))

    def along(self, directions: Array | None) -> NDArray[np.floating[Any]]:
        """The Jacobian (m*dim, k) along directions (n_rows*dim, k) of the rows, by default every row and axis."""
        m, dim = self.displacement.shape
        jacobian = self.jacobian.reshape(m * dim, -1)
        return jacobian if directions is None else jacobian @ directions

    def curvature(self, forces: Array, directions: Array | None) -> Array | None:
        """sum_i f_i . d2u_i/drows2 (k, k) of forces (m, dim) at its points, between directions (n_rows*dim, k) of the
        rows, by default every row and axis; None where it is left out of the Hessian, as thesis 4.2.3 and 5.4 do."""
        return None

    @classmethod
    def empty(cls, dim: int, n_rows: int) -> CorrectionField:
        """A field without active points: the collider does not touch the body."""
        return cls(np.empty(0, dtype=np.int64), np.empty((0, dim)), np.empty((0, dim, n_rows, dim)))


class BoundInternal(Protocol):
    """An internal correction at n fixed nodes."""

    def displacement(self, rows: Array) -> Array:
        """u (n, dim) [m] in the world frame at handle rows (n_rows, dim)."""
        ...

    def linearise(self, rows: Array) -> CorrectionField:
        """u and du/drows of all n nodes."""
        ...

    def at(self, index: IntArray) -> BoundInternal:
        """The correction at some of these nodes (m,)."""
        ...


class WeightPoint(Protocol):
    """The work of gravity along an internal correction at one state."""

    @property
    def energy(self) -> float:
        """[J]"""
        ...

    @property
    def gradient(self) -> Array:
        """By the handle rows (n_rows, dim) [N]."""
        ...

    def hessian(self, along: Array | None = None) -> Array:
        """By the handle rows, see `RowHessian`."""
        ...


class CorrectionWeight(Protocol):
    """The work of gravity along an internal correction."""

    def at(self, rows: Array) -> WeightPoint:
        """At handle rows (n_rows, dim)."""
        ...


class InternalField(Protocol):
    """An internal correction of a body. on_condensation: whether it adds to the body's static condensation, or to the
    subspace alone; gravity: (dim,) [m/s^2] under which it was learned, empty without."""

    on_condensation: bool
    gravity: tuple[float, ...]

    def bind(self, nodes: IntArray | None = None) -> BoundInternal:
        """The correction at some nodes (n,) of the body, all by default, prepared once."""
        ...

    def weight(self, mass: Array, gravity: Array) -> CorrectionWeight:
        """The work of gravity (dim,) [m/s^2] along it; mass: of every node of the body (n_nodes,) [kg]."""
        ...
