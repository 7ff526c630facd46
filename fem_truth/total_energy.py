"""Elasticity plus other terms: what Newton's method minimises, with the reuse of the elastic Hessian.

Assembling the elastic Hessian costs as much as 30 iterations of CG, and near a contact most of what Newton's
method has to sort out is the contact, not the elasticity. So the matrix is kept until it is to blame: after a
step s the error of the elastic model,

    e = P (W'(x + s) - W'(x) - H s),

is part of the new residual. The Hessian is assembled anew once e exceeds REUSE_RATE of the residual before
the step (the rate at which a frozen Hessian would go on converging) and half of the residual after it
(contact is not what is left to do).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from fem_truth.block_matrix import BlockMatrix
from fem_truth.null_space import NullSpace
from fem_truth.potentials import Potential
from runtime.arrays import Array

REUSE_RATE = 0.1


class Gradient(NamedTuple):
    """elastic: this rank's shares of W' of elasticity alone (n, dim) [N]; projected: P of the whole gradient; norm: of
    that."""

    elastic: Array
    projected: Array
    norm: float


class Elastic(Protocol):
    """What `FullSpaceElasticity` offers and its quadratic model imitates. unit_energy [J]: of a strain of one
    everywhere. Energies and gradients are this rank's shares (`fem_truth.parts.share`); of a whole body, complete."""

    unit_energy: float

    def energy(self, x: Array) -> float: ...
    def energy_gradient(self, x: Array) -> tuple[float, Array]: ...
    def hessian(self, x: Array) -> BlockMatrix: ...


class ElasticTangent:
    """The elastic Hessian, kept between Newton iterations (and between the depths of one contact) while it
    serves.

    matrix: a Hessian to begin with, of a nearby x; assembled at first use if there is none.
    """

    def __init__(self, elastic: Elastic, matrix: BlockMatrix | None = None) -> None:
        self._elastic, self._matrix = elastic, matrix

    def at(self, x: Array) -> BlockMatrix:
        """A Hessian to use at x, as a copy that may be added to."""
        if self._matrix is None:
            self._matrix = self._elastic.hessian(x)
        return self._matrix.copy()

    def judge(self, step: Array, change: Array, null_space: NullSpace, before: float, after: float) -> None:
        """Drop the matrix if it is to blame. change: of W' over the step (n, dim); before, after: residuals
        [N]."""
        if self._matrix is None:
            return
        misjudged = null_space.share.assembled(change - self._matrix.apply(step))
        error = null_space.share.norm(null_space.project(misjudged))
        if error > REUSE_RATE * before and error > 0.5 * after:
            self._matrix = None


class TotalEnergy:
    """W(x) = elastic + terms, minimised over a null space. tangent: that of the elastic energy.

    Subclasses say what residuals [N] and decrements [J] are measured against.
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
        #: Differences of energy below this [J] are round-off: terms of about the unit energy cancel in every
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
        projected = self.null_space.project(total)
        return share.total(energy), Gradient(elastic, projected, share.norm(projected))

    def hessian(self, x: Array, convex: bool = False) -> BlockMatrix:
        """convex: without the negative curvature of the terms, that of contact with a curved collider."""
        matrix = self._tangent.at(x)
        for term in self.terms:
            term.add_hessian(x, matrix, convex)
        return matrix

    def stepped(self, x: Array, step: Array, before: Gradient, after: Gradient) -> bool:
        """Told of every step that is taken, to x: decides whether the elastic Hessian still serves.

        True if the energy itself is another one from now on (friction took up new normal forces).
        """
        self._tangent.judge(step, after.elastic - before.elastic, self.null_space, before.norm, after.norm)
        return False

    def force_scale(self, x: Array, gradient: Gradient) -> float:
        raise NotImplementedError

    def energy_scale(self, x: Array) -> float:
        raise NotImplementedError
