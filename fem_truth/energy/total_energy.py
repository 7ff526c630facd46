"""Elasticity plus other terms: the objective of Newton's method, with reuse of the elastic Hessian.

Assembling the elastic Hessian costs as much as 30 iterations of CG, and near a contact most of the nonlinearity is in
the contact, not in elasticity. Therefore the matrix is kept until it slows convergence: after a step s the error of the
elastic model,

    e = P (W'(x + s) - W'(x) - H s),

is part of the new residual. The Hessian is assembled again once e exceeds REUSE_RATE of the residual before
the step (the rate at which a frozen Hessian would continue to converge) and half of the residual after it
(so that the remaining residual is not mainly due to contact).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from softprint.fem_truth.energy.potentials import Potential
from softprint.fem_truth.linalg.block_matrix import BlockMatrix
from softprint.fem_truth.linalg.null_space import NullSpace
from softprint.fem_truth.linalg.projected_cg import CgResult, projected_cg
from softprint.runtime.arrays import Array

REUSE_RATE = 0.1
# At most so many shifts of a Hessian that is to be convex; each is at least as large as those before together.
_SHIFTS = 12


class Gradient(NamedTuple):
    """elastic: this rank's shares of W' of elasticity alone (n, dim) [N]; whole: E' with all terms; projected: P times
    `whole`; norm: of `projected`."""

    elastic: Array
    whole: Array
    projected: Array
    norm: float


class Elastic(Protocol):
    """The interface of `FullSpaceElasticity` and of its quadratic model. unit_energy [J]: of a strain of one
    everywhere. Energies and gradients are this rank's shares (`fem_truth.parts.share`); for a whole body, complete."""

    unit_energy: float

    def energy(self, x: Array) -> float: ...
    def energy_gradient(self, x: Array) -> tuple[float, Array]: ...
    def hessian(self, x: Array) -> BlockMatrix: ...


class ElasticTangent:
    """The elastic Hessian, reused between Newton iterations (and between the depths of one contact) while it
    converges fast enough.

    matrix: an initial Hessian from a nearby x; assembled at first use if there is none.
    """

    def __init__(self, elastic: Elastic, matrix: BlockMatrix | None = None) -> None:
        self._elastic, self._matrix = elastic, matrix

    def at(self, x: Array) -> BlockMatrix:
        """A Hessian to use at x: a copy to which terms may be added."""
        if self._matrix is None:
            self._matrix = self._elastic.hessian(x)
        return self._matrix.copy()

    def judge(self, step: Array, change: Array, null_space: NullSpace, before: float, after: float) -> None:
        """Drop the matrix if it slows convergence. change: of W' over the step (n, dim); before, after: residuals
        [N]."""
        if self._matrix is None:
            return
        misjudged = null_space.share.assembled(change - self._matrix.apply(step))
        error = null_space.share.norm(null_space.project(misjudged))
        if error > REUSE_RATE * before and error > 0.5 * after:
            self._matrix = None


class TotalEnergy:
    """W(x) = elastic + terms, minimised over a null space. tangent: of the elastic energy.

    Subclasses define the scales of residuals [N] and decrements [J].
    """

    def __init__(
        self,
        elastic: Elastic,
        terms: Sequence[Potential],
        null_space: NullSpace,
        tangent: ElasticTangent | None = None,
    ) -> None:
        self.elastic, self.terms, self.null_space = elastic, tuple(terms), null_space
        self._tangent = ElasticTangent(elastic) if tangent is None else tangent
        #: Energy differences below this [J] are round-off, because terms of about the unit energy cancel in every
        #: cell.
        self.noise = 1e-15 * elastic.unit_energy

    def evaluate(self, x: Array) -> tuple[float, Gradient]:
        """E [J] and its gradient at x (n, dim)."""
        energy, elastic = self.elastic.energy_gradient(x)
        total = elastic.copy()
        for term in self.terms:
            energy += term.energy(x)
            total += term.gradient(x)
        share = self.null_space.share
        share.assemble(total)
        projected = self.null_space_at(x).project(total)
        return share.total(energy), Gradient(elastic, total, projected, share.norm(projected))

    def null_space_at(self, x: Array, forces: Array | None = None, convex: bool = False) -> NullSpace:
        """The null space at x, where it depends on x. forces: (n, dim) [N] there, which do work where displacements are
        of second order; convex: without the negative curvature of this work."""
        return self.null_space

    def hessian(self, x: Array, convex: bool = False) -> BlockMatrix:
        """convex: without the negative curvature of the terms, which contact with a curved collider has."""
        matrix = self._tangent.at(x)
        for term in self.terms:
            term.add_hessian(x, matrix, convex)
        return matrix

    def direction(
        self, x: Array, gradient: Gradient, tolerance: float, max_iterations: int, convex: bool = False
    ) -> CgResult:
        """Newton's step at x, where the gradient is this; the residual of the linear system is within the tolerance.

        convex: the Hessian is shifted, in proportion to the stiffness of each node, until no negative curvature is
        met: what is left of it is of crushed cells.
        """
        hessian, null_space = self.hessian(x, convex), self.null_space_at(x, gradient.whole, convex)
        share = null_space.share

        def solved() -> CgResult:
            return projected_cg(hessian, gradient.projected, null_space, tolerance, max_iterations)

        found, shift = solved(), 0.0
        stiffness = np.abs(np.trace(hessian.diagonal, axis1=1, axis2=2)) / hessian.dim
        for _ in range(_SHIFTS if convex else 0):
            way = found.direction
            if way is None:
                break
            curvature = share.total(float(np.vdot(way, hessian.apply(way))))
            relative = curvature / share.total(float(stiffness @ (way**2).sum(axis=1)))
            more = max(shift, 2.0 * abs(relative))
            shift += more
            hessian.diagonal += more * stiffness[:, None, None] * np.eye(hessian.dim)
            found = solved()
        return found

    def moved(self, x: Array, step: Array, length: float) -> Array:
        """x + length step."""
        return x + length * step

    def longest(self, x: Array, step: Array) -> float:
        """The largest length of a step: nothing limits it."""
        return np.inf

    def allows(self, x: Array) -> bool:
        """Whether the line search may go to x."""
        return True

    def slope(self, gradient: Gradient, step: Array) -> float:
        """E' . step [J]."""
        return self.null_space.share.dot(gradient.projected, step)

    def stepped(self, x: Array, step: Array, length: float, before: Gradient, after: Gradient) -> bool:
        """Called after every accepted step of this length, to x: decides whether to keep the elastic Hessian.

        Returns True if the energy itself has changed (sharp points press other places, friction has new normal forces).
        """
        self._tangent.judge(
            length * step, after.elastic - before.elastic, self.null_space_at(x), before.norm, after.norm
        )
        changed = [term.accepted(x) for term in self.terms]
        return any(changed)

    def force_scale(self, x: Array, gradient: Gradient) -> float:
        raise NotImplementedError

    def energy_scale(self, x: Array) -> float:
        raise NotImplementedError
