"""Block-Jacobi preconditioned conjugate gradients in the null space of the reduced basis (thesis 5.3.3,
[AB03]).

Minimises  1/2 d^T H d + g^T d  over d = P d. Stops early, as in Steihaug's truncated Newton method, if H has
negative curvature: the iterate so far is still a descent direction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from softprint.fem_truth.linalg.block_kernels import Real
from softprint.fem_truth.linalg.block_matrix import BlockMatrix
from softprint.fem_truth.linalg.null_space import NullSpace
from softprint.fem_truth.linalg.rigid_system import RigidSystem
from softprint.runtime.arrays import Array

# The tolerance that conjugate gradients reach reliably in single precision, even if the condition number of the matrix
# costs six digits. Newton's method around them runs in double precision.
_SINGLE_TOLERANCE = 1e-4


@dataclass(frozen=True, eq=False)
class CgResult:
    """step: d (n, dim) [m]; slope: g^T d [J], negative; iterations; negative_curvature: whether it was encountered,
    with `direction` (n, dim) the corresponding p (None otherwise); residual: |P (H d + g)| / |g| reached."""

    step: Array
    slope: float
    iterations: int
    negative_curvature: bool
    direction: Array | None
    residual: float


class NullSpaceSystem:
    """P H P and its preconditioner P D^-1 P, D the block diagonal of H, in one precision.

    Every sum over all nodes is computed by one of these methods.
    """

    def __init__(self, hessian: BlockMatrix, null_space: NullSpace, real: Real) -> None:
        self._share, self._null_space = null_space.share, null_space
        kernels, self._runs = null_space.for_kernels(hessian.dim, real)
        self.kernels = kernels
        self._pattern, self._upper = hessian.upper.pattern, hessian.upper.of_type(kernels.real)
        self._diagonal: Array = hessian.diagonal.astype(kernels.real)
        # A recorded motion has dozens of springs, each on a few nodes: sparse, and all in one product.
        weights = [w for w, _ in hessian.low_rank]
        self._springs = sp.csr_matrix(np.array(weights, dtype=kernels.real)) if weights else None
        self._stiffness = np.array([[k] for _, k in hessian.low_rank], dtype=kernels.real)
        self._facets = [term.of_type(kernels.real) for term in hessian.facets]
        self._eliminated = None if hessian.eliminated is None else hessian.eliminated.of_type(kernels.real)
        self._dim = hessian.dim
        self._inverse = kernels.inverses(self._share.assembled(hessian.diagonal_blocks()))
        rigid = null_space.rigid
        self._rigid = None if rigid is None else RigidSystem(rigid, hessian, kernels.real)

    def product(self, p: Array, y: Array) -> float:
        """y = H p; returns the curvature p . H p."""
        starts, columns = self._pattern.row_starts, self._pattern.columns
        curvature = self.kernels.product(starts, columns, self._diagonal, self._upper, p, y)
        if self._springs is not None:
            share = self._springs @ p
            force = self._stiffness * self._share.total(share)
            y += self._springs.T @ force
            curvature += float((share * force).sum())
        for facets in self._facets:
            force = facets.product(p)
            y[facets.nodes, : self._dim] += force
            curvature += float(np.vdot(p[facets.nodes, : self._dim], force))
        if self._eliminated is not None:
            eliminated = self._eliminated.coordinates(p)
            y[self._eliminated.nodes, : self._dim] -= self._eliminated.product(eliminated)
            curvature -= float(eliminated @ eliminated)
        if self._rigid is not None:
            curvature += self._rigid.add_stiffness(p, y)
        self._share.assemble(y)
        return self._share.total(curvature)

    def descend(self, alpha: float, y: Array, r: Array, z: Array) -> tuple[float, float]:
        """r -= alpha P y and z = P D^-1 r; returns |r|^2 and r . z."""
        if self._rigid is not None:
            return self._descend_with_twists(self._rigid, alpha, y, r, z)
        square = self._descend_nodes(self._coordinates(y), alpha, y, r, z)
        rho = self._deflate_nodes(self._coordinates(z), r, z)
        square, rho = self._share.total(np.array([square, rho]))
        return float(square), float(rho)

    def _descend_with_twists(
        self, rigid: RigidSystem, alpha: float, y: Array, r: Array, z: Array
    ) -> tuple[float, float]:
        """The rows of regions by their twists, which the kernels take for fixed nodes, with r = 0."""
        own, force = rigid.coordinates(r), rigid.coordinates(y)
        rigid.spread(np.zeros_like(own), r)
        c = self._coupled(self._coordinates(y), force)
        square = self._descend_nodes(c, alpha, y, r, z)
        own = own - alpha * (force - self._by_twists(c))
        solved = rigid.preconditioned(own)
        c = self._coupled(self._coordinates(z), solved)
        rho = self._deflate_nodes(c, r, z)
        solved = solved - self._by_twists(c)
        rigid.spread(own, r)
        rigid.spread(solved, z)
        return square + float(own @ own), rho + float(own @ solved)

    def _coupled(self, c: Array, by_twists: Array) -> Array:
        rank, coupled = self._null_space.rank, c.copy()
        coupled[:rank, : self._dim] = self._null_space.coupled(c[:rank, : self._dim], by_twists)
        return coupled

    def _by_twists(self, c: Array) -> Array:
        return self._null_space.by_twists_of(c[: self._null_space.rank, : self._dim]).astype(self.kernels.real)

    def _descend_nodes(self, c: Array, alpha: float, y: Array, r: Array, z: Array) -> float:
        squares = [
            self.kernels.descend(Q, c, moving, self._inverse[i], alpha, y[i], r[i], z[i])
            for i, Q, moving in self._runs
        ]
        return squares[0]  # the first run holds the owned nodes, and each counts by its owner

    def _deflate_nodes(self, c: Array, r: Array, z: Array) -> float:
        rhos = [self.kernels.deflate(Q, c, r[i], z[i]) for i, Q, _ in self._runs]
        return rhos[0]

    def _coordinates(self, v: Array) -> Array:
        """Q^T v, padded to tiles."""
        own = self._runs[0]
        return self._share.total(self.kernels.coordinates(own.Q, v[own.rows]))


def projected_cg(
    hessian: BlockMatrix, gradient: Array, null_space: NullSpace, tolerance: float, max_iterations: int
) -> CgResult:
    """Solve P H P d = -g to |residual| <= tolerance |g|. gradient: g = P g (n, dim).

    Uses single precision where it suffices; negative curvature counts only if double precision confirms it.
    """
    if tolerance >= _SINGLE_TOLERANCE:
        result = _conjugate_gradients(hessian, gradient, null_space, tolerance, max_iterations, np.float32)
        if not result.negative_curvature:
            return result
    return _conjugate_gradients(hessian, gradient, null_space, tolerance, max_iterations, np.float64)


def _conjugate_gradients(
    hessian: BlockMatrix,
    gradient: Array,
    null_space: NullSpace,
    tolerance: float,
    max_iterations: int,
    real: Real,
) -> CgResult:
    system = NullSpaceSystem(hessian, null_space, real)
    kernels, share = system.kernels, null_space.share
    scale = share.norm(gradient) or 1.0

    def result(step: Array, iterations: int, direction: Array | None, norm: float) -> CgResult:
        # Projected again, to remove the round-off that has drifted out of the null space.
        step = share.agreed(null_space.project(scale * step[:, : hessian.dim].astype(float)))
        if direction is not None:
            direction = direction[:, : hessian.dim].astype(float)
        slope = share.dot(gradient, step)
        return CgResult(step, slope, iterations, direction is not None, direction, norm)

    residual = kernels.vector(-gradient / scale)
    step, y, z = np.zeros_like(residual), np.zeros_like(residual), np.zeros_like(residual)
    _, rho = system.descend(0.0, y, residual, z)
    p, norm = z.copy(), 1.0
    for iteration in range(1, max_iterations + 1):
        curvature = system.product(p, y)
        if curvature <= 0.0:
            return result(z if iteration == 1 else step, iteration, p, norm)
        alpha, previous = rho / curvature, rho
        square, rho = system.descend(alpha, y, residual, z)
        norm = float(np.sqrt(square))
        kernels.advance(alpha, rho / previous, z, step, p)
        if norm <= tolerance:
            break
    return result(step, iteration, None, norm)
