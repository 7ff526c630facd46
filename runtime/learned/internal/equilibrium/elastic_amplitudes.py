"""The amplitudes of modes at which a body is in elastic equilibrium, as a function of its reduced state.

    a(q) = argmin_a E(q, a),    E(q, a) = sum_c w_c Psi(F_c(q, a)) - g . sum_n m_n u_n(q, a),

with u of `mode_field.py`, F_c = D_c q + sum u (x) G_c of the cubature cells c, and gravity g. By the implicit function
theorem

    E_a = 0,    da/dq = - E_aa^-1 E_aq,
    E_a = V^T f - M^T (q g),    E_aa = B^T w A B,    E_aq = B^T w A B_q + f . d2u/dq da - M (x) g,

with V = du/da, f = sum_c G_c^T w P the elastic forces at the corners, A the tangent of the material, B = dF/da and
B_q = dF/dq. u is linear in a, so that E_aa has no further term. Newton's method with a line search finds a; it starts
from the solution of the state before or from a linear function of the state, where the energy is lower, and iterates
until the result no longer depends on the start. An E_aa that is not positive definite is shifted. E_aa is kept from one
iteration to the next while it makes Newton's method converge fast. Matrices are in single precision, E, E_a and
products with E_aa in double precision.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.elasticity.reduced_elasticity import ReducedElasticity
from softprint.runtime.lazy import lazy
from softprint.runtime.learned.internal.equilibrium.mode_field import ModeField, RowModes

Singles = NDArray[np.float32]
# Converged: the Newton decrement (twice the energy that another iteration would save) is below this share of the
# energy, a relative accuracy of 1e-10, or below what round-off in the stress of a body at rest makes of it.
_ACCURACY, _ROUND_OFF = 1e-20, 1e-27
_ITERATIONS = 60
# A kept factor is computed anew where an iteration lowers the decrement by less than this.
_SLOW = 1e-3
# Of the line search: the share of the predicted decrease, the shortest step, and round-off of the energy.
_DECREASE, _SHORTEST, _ENERGY_ROUND_OFF = 1e-4, 1e-6, 1e-13
# Of solves with E_aa: how far they are refined, in how many steps at most, and when a kept factor is computed anew.
_REFINED, _REFINEMENTS, _SLOWLY_REFINED = 1e-10, 8, 0.1
# Of a strain, for derivatives of the tangent.
_STEP = 1e-3
# The first shift of a matrix that is not positive definite, relative to its diagonal.
_SHIFT = 1e-3


class Strained(NamedTuple):
    """The body at rows and amplitudes. F: (m, dim, dim) of the cells; energy: E [J]; elastic: that of the cells alone;
    forces: f (n, dim) [N]; slope: E_a (K,)."""

    F: Array
    energy: float
    elastic: float
    forces: Array
    slope: Array


class ElasticAmplitudes:
    """a(q) of a body with its cubature. field: at all nodes; start(rows): a first estimate (K,); gravity: (dim,)
    [m/s^2]."""

    def __init__(
        self, body: ReducedBody, field: ModeField, start: Callable[[Array], Array], gravity: Array
    ) -> None:
        corners = body.reduced_elasticity.corners
        nodes = np.unique(corners)
        self.field, self.start, self.gravity = field.some(nodes), start, gravity
        own = replace(body.reduced_elasticity, corners=np.searchsorted(nodes, corners))
        self.elasticity: ReducedElasticity = own
        self.moments = field.moments(body.node_mass) if gravity.any() else None
        self.gradients = _corner_gradients(own.corners, own.hat_gradients, len(nodes))
        self._adjoint, self.gradients_single = self.gradients.T.tocsr(), self.gradients.astype(np.float32)
        self._unit = float(own.weights @ np.broadcast_to(own.material.young, own.weights.shape))
        # A point is immutable: threads that share this only lose a start.
        self._last: AmplitudePoint | None = None

    def at(self, rows: Array) -> AmplitudePoint:
        """The equilibrium at handle rows (n_rows, dim)."""
        last = self._last
        if last is not None and np.array_equal(last.rows, rows):
            return last
        found = self._last = self._solved(rows.copy(), last)
        return found

    def strained(self, modes: RowModes, a: Array) -> Strained:
        """The body at handle rows, with the modes there, and amplitudes (K,)."""
        own, rows = self.elasticity, modes.rows
        F = own.deformation_gradients(rows) + self.corner_strain(modes.displacement(a))
        density, stress = own.material.energy_and_stress(F)
        stress = own.weights[:, None, None] * stress
        forces, elastic = self.corner_forces(stress), float(own.weights @ density)
        pull = self.pull(rows)
        return Strained(F, elastic - float(pull @ a), elastic, forces, modes.forces(forces) - pull)

    def pull(self, rows: Array) -> Array:
        """M^T (q g) (K,) of the weight at handle rows (n_rows, dim)."""
        if self.moments is None:
            return np.zeros(self.field.count)
        return np.asarray(self.moments.T @ (rows @ self.gravity))

    def tolerance(self, strained: Strained) -> float:
        """[J] The Newton decrement below which amplitudes are those of the equilibrium."""
        return _ACCURACY * abs(strained.elastic) + _ROUND_OFF * self._unit

    def corner_strain(self, displacement: Array) -> Array:
        """dF (m, dim, dim) by a displacement (n, dim) of the corners."""
        dim = displacement.shape[1]
        return np.asarray((self.gradients @ displacement.ravel()).reshape(-1, dim, dim))

    def corner_forces(self, stress: Array) -> Array:
        """f (n, dim) [N] at the corners, of a stress w P (m, dim, dim)."""
        return np.asarray((self._adjoint @ stress.ravel()).reshape(-1, stress.shape[1]))

    def factor(self, modes: RowModes, strained: Strained) -> Factor:
        """E_aa, factorised."""
        tangent = self.weighted_tangent(strained.F).astype(np.float32)
        B = self.gradients_single @ modes.by_amplitude
        square, count = tangent.shape[1], B.shape[1]
        stressed = (tangent @ B.reshape(-1, square, count)).reshape(-1, count)
        return Factor(stressed, _factorised((B.T @ stressed).astype(np.float64)))

    def weighted_tangent(self, F: Array) -> Array:
        """w A (m, dim*dim, dim*dim)."""
        own, square = self.elasticity, F.shape[1] ** 2
        return np.asarray(own.weights[:, None, None] * own.material.tangent(F).reshape(-1, square, square))

    def tangent_along(self, F: Array, G: Array) -> Singles:
        """w dA/dF G (m, dim*dim, dim*dim) by central differences, right to a few parts in a million."""
        step = _STEP / np.abs(G).max()
        ahead, behind = self.weighted_tangent(F + step * G), self.weighted_tangent(F - step * G)
        return np.asarray((ahead - behind) / (2.0 * step), dtype=np.float32)

    def _solved(self, rows: Array, last: AmplitudePoint | None) -> AmplitudePoint:
        """From the better of two starts."""
        modes, a, factor = self.field.at(rows), self.start(rows), None
        here = self.strained(modes, a)
        if last is not None:
            moved = last.predicted(rows)
            near = self.strained(modes, moved)
            if near.energy < here.energy or not np.isfinite(here.energy):
                a, here, factor = moved, near, last.known_factor
        before, fresh = np.inf, factor is None
        factor = self.factor(modes, here) if factor is None else factor
        for iteration in range(_ITERATIONS):
            step = -factor.solve(here.slope)
            decrement = -float(here.slope @ step)
            if decrement > _SLOW * before and not fresh:
                factor, fresh = self.factor(modes, here), True
                step = -factor.solve(here.slope)
                decrement = -float(here.slope @ step)
            if decrement <= self.tolerance(here):
                return AmplitudePoint(self, modes, a, here, True, iteration, factor)
            further = self._line_search(modes, a, here, step, decrement)
            if further is None:
                return AmplitudePoint(self, modes, a, here, False, iteration, factor)
            (a, here), before, fresh = further, decrement, False
        return AmplitudePoint(self, modes, a, here, False, _ITERATIONS, factor)

    def _line_search(
        self, modes: RowModes, a: Array, here: Strained, step: Array, decrement: float
    ) -> tuple[Array, Strained] | None:
        """Amplitudes along a step with less energy; None if there are none."""
        length, size = 1.0, abs(here.elastic) + abs(here.energy) + 0.01 * self._unit
        slack = _ENERGY_ROUND_OFF * size
        while length > _SHORTEST:
            ahead = a + length * step
            there = self.strained(modes, ahead)
            if there.energy <= here.energy - _DECREASE * length * decrement + slack:
                return ahead, there
            length *= 0.5
        return None


@dataclass(frozen=True, eq=False)
class Factor:
    """stressed: w A B (m*dim*dim, K) [N m^..]; cholesky: of E_aa."""

    stressed: Singles
    cholesky: tuple[Array, bool]

    def solve(self, slope: NDArray[np.floating[Any]]) -> Array:
        """E_aa^-1 times a slope (K,) or (K, k)."""
        return np.asarray(cho_solve(self.cholesky, slope, check_finite=False))


@dataclass(frozen=True, eq=False)
class AmplitudePoint:
    """The equilibrium at handle rows, with the modes there. a: (K,); strained: the body there; converged: whether the
    iterations ended there, or ran out; known_factor: of E_aa, of the last iteration that computed it."""

    amplitudes: ElasticAmplitudes
    modes: RowModes
    a: Array
    strained: Strained
    converged: bool
    iterations: int
    known_factor: Factor

    @property
    def rows(self) -> Array:
        """(n_rows, dim)"""
        return self.modes.rows

    def predicted(self, rows: Array) -> Array:
        """Amplitudes (K,) at other rows, to first order."""
        own, change = self.amplitudes, rows - self.rows
        moved = own.field.row_along(self.a, change.reshape(-1, 1)).astype(np.float64)
        dF = own.elasticity.deformation_gradients(change) + own.corner_strain(
            moved.reshape(-1, change.shape[1])
        )
        slope = self.modes.forces(own.corner_forces(self._stress_of(dF)))
        slope += own.field.at(change).forces(self.strained.forces)
        return self.a - self.known_factor.solve(slope - own.pull(change))

    @lazy
    def _tangent(self) -> Array:
        """w A (m, dim*dim, dim*dim)."""
        return self.amplitudes.weighted_tangent(self.strained.F)

    @lazy
    def _factor(self) -> Factor:
        found = self.amplitudes.factor(self.modes, self.strained)
        self.__dict__["known_factor"] = found
        return found

    @lazy
    def _computed(self) -> list[tuple[Array | None, Array]]:
        """The last derivative: the same directions are asked for again."""
        return []

    def along(self, directions: Array | None) -> Array:
        """da (K, k) along directions (n_rows*dim, k) of the rows, by default every row and axis."""
        for known, found in self._computed:
            if known is directions:
                return found
        T = np.eye(self.rows.size) if directions is None else directions
        found = -self._factor.solve(self._mixed_slope(T))
        self._computed[:] = [(directions, found)]
        return found

    def curvature(self, along: Array, directions: Array | None) -> Array:
        """d2(b . a)/drows2 (k, k) of a direction b (K,), along directions (n_rows*dim, k), by default every row and
        axis. Zero for the b of the weight, which elastic forces have with the opposite sign.

        With y = E_aa^-1 b fixed, it is minus the second derivative of y . E_a = sum_c w P(F_c) : G_c along the
        equilibrium, where G_c = dF_c/da y is linear in q:  B^T w (dA/dF G) B + 2 sym(B^T w A dG/dq + f_y . d2u/dq da
        da/dq), with B = dF/dq along the equilibrium and the forces f_y of the stress w A G.
        """
        T = np.eye(self.rows.size) if directions is None else directions
        if self._negligible(along) or self._negligible(along - self.amplitudes.pull(self.rows)):
            return np.zeros((T.shape[1], T.shape[1]))
        own, field = self.amplitudes, self.amplitudes.field
        y, da = self._inverse_of(along), self.along(directions)
        G = own.corner_strain(self.modes.displacement(y))
        moved = field.row_along(self.a, T) + self.modes.by_amplitude @ da.astype(np.float32)
        B = own.elasticity.basis_along(T) + own.gradients_single @ moved
        turned = own.gradients_single @ field.row_along(y, T)
        by_stress = np.matmul(own.tangent_along(self.strained.F, G), _by_cell(B, G))
        both = 0.5 * by_stress + np.matmul(self._tangent.astype(np.float32), _by_cell(turned, G))
        half = (B.T @ both.reshape(B.shape)).astype(np.float64)
        half += (field.mixed(own.corner_forces(self._stress_of(G))).T @ T).T @ da
        return -half - half.T

    def pulled_back(self, along: Array) -> Array:
        """d(b . a)/drows (n_rows, dim) of a direction b (K,), by one solve. That of elastic forces without gravity is
        zero, within the tolerance of the equilibrium; with gravity, they and the weight have the same b."""
        if self._negligible(along):
            return np.zeros_like(self.rows)
        for known, found in self._pulled:
            if self._negligible(along - known):
                return found
        own, field = self.amplitudes, self.amplitudes.field
        y = self._inverse_of(along)
        stress = self._stress_by(y)
        found = own.elasticity.gradient_of(stress) + field.row_forces(self.a, own.corner_forces(stress))
        found += field.row_forces(y, self.strained.forces)
        if own.moments is not None:
            found -= np.outer(own.moments @ y, own.gravity)
        self._pulled[:] = [(along, -found)]
        return -found

    @lazy
    def _pulled(self) -> list[tuple[Array, Array]]:
        """The last direction and its result."""
        return []

    def _negligible(self, along: Array) -> bool:
        decrement = float(along @ self.known_factor.solve(along))
        return decrement <= 4.0 * self.amplitudes.tolerance(self.strained)

    def _inverse_of(self, along: Array) -> Array:
        """E_aa^-1 b (K,); the last is kept."""
        for known, found in self._inverses:
            if known is along or np.array_equal(known, along):
                return found
        found = self._times_inverse(along)
        self._inverses[:] = [(along, found)]
        return found

    @lazy
    def _inverses(self) -> list[tuple[Array, Array]]:
        """The last direction and E_aa^-1 times it."""
        return []

    def _times_inverse(self, along: Array) -> Array:
        """E_aa^-1 b (K,), refined with E_aa in double precision."""
        own, factor, missed, size = self.amplitudes, self.known_factor, along, np.linalg.norm(along)
        y = np.zeros_like(along)
        for _ in range(_REFINEMENTS):
            y = y + factor.solve(missed)
            before, missed = missed, along - self.modes.forces(own.corner_forces(self._stress_by(y)))
            if np.linalg.norm(missed) <= _REFINED * size:
                break
            if np.linalg.norm(missed) > _SLOWLY_REFINED * np.linalg.norm(before):
                factor = self._factor
        return y

    def _mixed_slope(self, T: Array) -> Array:
        """E_aq T (K, k)."""
        own = self.amplitudes
        B = own.elasticity.basis_along(T) + own.gradients_single @ own.field.row_along(self.a, T)
        found = (self._factor.stressed.T @ B).astype(np.float64)
        found += own.field.mixed(self.strained.forces).T @ T
        if own.moments is not None:
            dim = len(own.gravity)
            found -= own.moments.T @ np.tensordot(T.reshape(-1, dim, T.shape[1]), own.gravity, axes=(1, 0))
        return found

    def _stress_by(self, y: Array) -> Array:
        """w A B y (m, dim, dim) of a change y (K,) of the amplitudes."""
        return self._stress_of(self.amplitudes.corner_strain(self.modes.displacement(y)))

    def _stress_of(self, dF: Array) -> Array:
        """w A dF (m, dim, dim)."""
        return np.asarray((self._tangent @ dF.reshape(len(dF), -1, 1)).reshape(dF.shape))


def _by_cell(B: Singles, of: Array) -> Singles:
    """(m*dim*dim, k) as (m, dim*dim, k), for the strain (m, dim, dim) of the cells."""
    return B.reshape(len(of), -1, B.shape[1])


def _corner_gradients(corners: IntArray, gradients: Array, n_nodes: int) -> sp.csr_matrix:
    """G (m*dim*dim, n_nodes*dim) with dF = G u, of cells with corners (m, dim+1) and gradients (m, dim+1, dim)."""
    m, n_corners, dim = gradients.shape
    i, j = np.indices((dim, dim))
    shape = m, n_corners, dim, dim
    row = np.broadcast_to(np.arange(m)[:, None, None, None] * dim**2 + i * dim + j, shape)
    column = np.broadcast_to(corners[:, :, None, None] * dim + i, shape)
    values = np.broadcast_to(gradients[:, :, None, :], shape)
    entries = values.ravel(), (row.ravel(), column.ravel())
    return sp.csr_matrix(entries, shape=(m * dim**2, n_nodes * dim))


def _factorised(matrix: Array) -> tuple[Array, bool]:
    """The Cholesky factor of a symmetric matrix, shifted until it is positive definite."""
    symmetric, shift = 0.5 * (matrix + matrix.T), 0.0
    diagonal = np.diag(symmetric)
    floor = np.maximum(np.abs(diagonal), 1e-9 * np.abs(diagonal).max())
    while True:
        try:
            found: tuple[Array, bool] = cho_factor(symmetric + shift * np.diag(floor), check_finite=False)
            return found
        except np.linalg.LinAlgError:
            if not np.isfinite(symmetric).all():
                return np.eye(len(symmetric)), False
            shift = max(_SHIFT, 4.0 * shift)
