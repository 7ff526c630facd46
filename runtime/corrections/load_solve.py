"""Contact with the body's compliance: the forces with which a collider and a linearly elastic surface are in balance.

At the m loads near the collider, with reduced positions x_j, compliance G (see `compliance.py`), local deformation F_j
and the penalty law of the truth (thesis 5.4), the rest displacement v, the positions y and the forces f satisfy

    y_j = x_j + F_j v_j,    v_i = sum_j G_ij F_j^T f_j,    f_j = p_j g(y_j),    p_j = a_j k max(0, -s(y_j))^2,

s being the signed distance and g its gradient *where the load has gone*. These are the conditions for a minimum of

    E = 1/2 sum_j f_j . F_j v_j + sum_j (a_j k / 3) max(0, -s(y_j))^3.

Newton's method is run on the displacement and on the penetrations e_j = -s(y_j) as unknowns of their own, which keeps
the stiff penalty law out of the linearisation: four to six iterations, wherever it starts. Where that fails (a collider
so deep that the load slides off its tip), E is minimised instead, with a line search. Only loads that bear pressure,
ten to twenty in all, take part in linear systems:

    (I + G D) dv = ...,    D_j = F_j^T (S_j g g^T - p_j H_j) F_j,    S = dp/de,    H = dg/dy.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from runtime.arrays import Array, IntArray
from runtime.colliders.collider import SdfDerivatives

log = logging.getLogger(__name__)

# A state is in balance when no load is farther from it than this share of the deepest penetration: far below what
# matters, but Newton converges quadratically, and the energy is then exact for the line search of dynamics.
_TOLERANCE = 1e-11
_ITERATIONS = 12
# Newton's method is given up when the error has grown so many times.
_GROWTH = 10.0
_DESCENT_ITERATIONS = 100
# Where nothing is known: penetration is a tenth of what it would be if nothing gave way.
_FIRST_GUESS = 0.1


@dataclass(frozen=True, eq=False)
class LoadSolution:
    """left: e (m,) [m], penetration left (negative: a gap); normal: g (m, dim), curvature: H (m, dim, dim) [1/m] at the
    displaced loads; pressure: p (m,) [N]; given: v (m, dim) [m], displacement in rest coordinates; moved: F v (m, dim)
    [m]; energy: E [J]; converged, iterations and residual [m]: how the solve ended."""

    left: Array
    normal: Array
    curvature: Array
    pressure: Array
    given: Array
    moved: Array
    energy: float
    converged: bool
    iterations: int
    residual: float

    @property
    def force(self) -> Array:
        """f (m, dim) [N]."""
        return self.pressure[:, None] * self.normal


@dataclass(frozen=True, eq=False)
class LoadProblem:
    """The m loads near the collider.

    compliance: G (m, dim, m, dim) [m/N]; stiffness: a_j k (m,) [N/m^2]; position: x (m, dim) [m]; F: (m, dim, dim);
    depth: of the deepest load [m]; distance: signed distance with derivatives at positions (n, dim).
    """

    compliance: Array
    stiffness: Array
    position: Array
    F: Array
    depth: float
    distance: Callable[[Array], SdfDerivatives]

    def solve(self, near: tuple[Array, Array] | None = None) -> LoadSolution:
        """The forces in balance; near: penetrations e (m,) and normals (m, dim) of a state nearby, to start from."""
        found = self._newton(near)
        if not found.converged and near is not None:
            found = self._newton(None)
        if not found.converged:
            found = self._descend()
        if not found.converged:
            log.warning(
                "contact loads not in balance after %d iterations: %.1e m are missing",
                found.iterations,
                found.residual,
            )
        return found

    def stiffening(self, solution: LoadSolution, index: IntArray) -> Array:
        """D (k, dim, dim) [N/m] of the loads `index` in rest coordinates."""
        g, F = solution.normal[index], self.F[index]
        S = 2.0 * self.stiffness[index] * np.maximum(solution.left[index], 0.0)
        world = S[:, None, None] * g[:, :, None] * g[:, None, :]
        world -= solution.pressure[index, None, None] * solution.curvature[index]
        return np.asarray(F.transpose(0, 2, 1) @ world @ F)

    def softening(self, index: IntArray, D: Array) -> Array:
        """I + G D (k*dim, k*dim) among the loads `index`."""
        size = D.shape[0] * D.shape[1]
        blocks = self.among(index).reshape(size, -1, D.shape[1]).transpose(1, 0, 2) @ D
        return np.eye(size) + blocks.transpose(1, 0, 2).reshape(size, size)

    def among(self, index: IntArray) -> Array:
        """G (k*dim, k*dim) [m/N] among the loads `index`."""
        size = len(index) * self.F.shape[1]
        return np.asarray(self.compliance[index][:, :, index].reshape(size, size))

    def _newton(self, near: tuple[Array, Array] | None) -> LoadSolution:
        if near is None:
            at = self.distance(self.position)
            near = np.minimum(-at.value, _FIRST_GUESS * self.depth), at.gradient
        e, scale = near[0], self.depth
        given = self._give(self._pressure(e), near[1])
        first = np.inf
        for iteration in range(_ITERATIONS + 1):
            moved = _carry(self.F, given)
            at = self.distance(self.position + moved)
            e = np.where(e > 0.0, e, -at.value)  # loads that bear nothing follow
            pressure = self._pressure(e)
            balanced = self._give(pressure, at.gradient)
            bearing = np.flatnonzero(e > 0.0)
            gap, lag = (e + at.value)[bearing], given - balanced
            residual = max(float(np.abs(gap).max(initial=0.0)), float(np.abs(lag).max(initial=0.0)))
            converged = residual <= _TOLERANCE * scale
            first = residual if iteration == 0 else first
            lost = not np.isfinite(residual) or residual > _GROWTH * max(first, scale)
            if converged or lost or iteration == _ITERATIONS:
                break
            try:
                given, e = self._step(bearing, e, pressure, at, balanced, lag, gap)
            except np.linalg.LinAlgError:  # a load just about to slide off a tip
                break
        return self._solution(e, at, balanced, converged, iteration, residual)

    def _step(
        self,
        bearing: IntArray,
        e: Array,
        pressure: Array,
        at: SdfDerivatives,
        balanced: Array,
        lag: Array,
        gap: Array,
    ) -> tuple[Array, Array]:
        """Linearised in displacement and penetration: the next v and e.

        dv = -lag + G (F^T (S g de + p H F dv)),    de = -gap - g . F dv.
        """
        F, g, H = self.F[bearing], at.gradient[bearing], at.hessian[bearing]
        p, S = pressure[bearing], 2.0 * self.stiffness[bearing] * e[bearing]
        world = S[:, None, None] * g[:, :, None] * g[:, None, :] - p[:, None, None] * H
        Ft = F.transpose(0, 2, 1)
        nu = _carry(Ft, g)
        right = -lag[bearing].ravel() - self.among(bearing) @ (nu * (S * gap)[:, None]).ravel()
        dv = np.linalg.solve(self.softening(bearing, Ft @ world @ F), right).reshape(lag[bearing].shape)
        du = _carry(F, dv)
        de = -gap - np.einsum("mi,mi->m", g, du)
        more = nu * (S * de)[:, None] + _carry(Ft, p[:, None] * _carry(H, du))
        given = balanced + (self.compliance[:, :, bearing].reshape(balanced.size, -1) @ more.ravel()).reshape(
            balanced.shape
        )
        e = e.copy()
        e[bearing] += de
        return given, e

    def _descend(self) -> LoadSolution:
        """Newton's method on E over the forces, with a line search: slower, but it always goes down."""
        load = np.zeros_like(self.position)
        given = np.zeros_like(load)
        at, scale = self.distance(self.position), self.depth
        for iteration in range(_DESCENT_ITERATIONS + 1):
            e = -at.value
            balanced_load = self._rest_load(self._pressure(e), at.gradient)
            balanced = self._apply(balanced_load)
            residual = float(np.abs(balanced - given).max(initial=0.0))
            converged = residual <= _TOLERANCE * scale
            if converged or iteration == _DESCENT_ITERATIONS:
                break
            step, slope = self._direction(e, at, load, given, balanced_load, balanced)
            energy, change = self._energy(load, given, e), self._apply(step)
            length = 1.0
            while True:
                trial = given + length * change
                at = self.distance(self.position + _carry(self.F, trial))
                gained = self._energy(load + length * step, trial, -at.value) - energy
                if gained <= 1e-4 * length * slope + 1e-14 * energy or length < 1e-6:
                    break
                length *= 0.5
            load, given = load + length * step, trial
        return self._solution(e, at, balanced, converged, iteration, residual)

    def _direction(
        self, e: Array, at: SdfDerivatives, load: Array, given: Array, balanced_load: Array, balanced: Array
    ) -> tuple[Array, float]:
        """A change of the loads (m, dim) along which E falls, and how fast; without the curvature of the distance
        where with it E would rise."""
        bearing = np.flatnonzero(e > 0.0)
        F, g = self.F[bearing], at.gradient[bearing]
        Ft = F.transpose(0, 2, 1)
        p = self._pressure(e)[bearing]
        stiff = (2.0 * self.stiffness[bearing] * e[bearing])[:, None, None] * g[:, :, None] * g[:, None, :]
        lag = (balanced - given)[bearing]
        for world in (stiff - p[:, None, None] * at.hessian[bearing], stiff):
            D = Ft @ world @ F
            try:
                dv = np.linalg.solve(self.softening(bearing, D), lag.ravel()).reshape(lag.shape)
            except np.linalg.LinAlgError:  # with curvature only: I + G D is regular for D >= 0
                continue
            step = balanced_load - load
            step[bearing] -= _carry(D, dv)
            slope = float(np.vdot(load - balanced_load, self._apply(step)))
            if slope < 0.0:
                break
        return step, slope

    def _solution(
        self, e: Array, at: SdfDerivatives, given: Array, converged: bool, iterations: int, residual: float
    ) -> LoadSolution:
        pressure = self._pressure(e)
        load = self._rest_load(pressure, at.gradient)
        return LoadSolution(
            left=e,
            normal=at.gradient,
            curvature=at.hessian,
            pressure=pressure,
            given=given,
            moved=_carry(self.F, given),
            energy=self._energy(load, given, e),
            converged=converged,
            iterations=iterations,
            residual=residual,
        )

    def _energy(self, load: Array, given: Array, left: Array) -> float:
        penalty = self.stiffness @ np.maximum(left, 0.0) ** 3 / 3.0
        return 0.5 * float(np.vdot(load, given)) + float(penalty)

    def _pressure(self, left: Array) -> Array:
        """p (m,) [N]."""
        return np.asarray(self.stiffness * np.maximum(left, 0.0) ** 2)

    def _rest_load(self, pressure: Array, normal: Array) -> Array:
        """F^T f (m, dim) [N]."""
        return _carry(self.F.transpose(0, 2, 1), pressure[:, None] * normal)

    def _give(self, pressure: Array, normal: Array) -> Array:
        """v (m, dim) of forces along the normals."""
        return self._apply(self._rest_load(pressure, normal))

    def _apply(self, load: Array) -> Array:
        """G load (m, dim)."""
        return np.asarray((self.compliance.reshape(load.size, -1) @ load.ravel()).reshape(load.shape))


def _carry(matrices: Array, vectors: Array) -> Array:
    """(m, dim) products of matrices (m, dim, dim) with vectors (m, dim)."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])
