"""Contact with the body's compliance: the forces with which a collider and a linearly elastic surface are in balance.

At the m loads near the collider, with reduced positions x_j, compliance G (see `compliance.py`, carried along to the
world) and the penalty law of the truth (thesis 5.4), displacements u, positions y and forces f satisfy

    y_j = x_j + u_j,    u = G f,    f_j = p_j g(y_j),    p_j = a_j k max(0, -s(y_j))^2,

s being the signed distance and g its gradient *where the load has gone*. These are the conditions for a minimum of

    E(f) = 1/2 f . G f + sum_j (a_j k / 3) max(0, -s(x_j + (G f)_j))^3.

Newton's method is run on the displacement and on the penetrations e_j = -s(y_j) as unknowns of their own, which keeps
the stiff penalty law out of the linearisation: two to six iterations, as a rule wherever it starts. Where that fails (a
collider so deep that a load slides off its tip, or walls so thin that it could go to either side), E is minimised
instead, with a line search. That starts from the state nearby too: E may have several minima, and only the one next to
the last is a motion. Only loads that bear pressure, ten to a hundred in all, take part in linear systems:

    (I + G D) du = ...,    D_j = S_j g g^T - p_j H_j,    S = dp/de,    H = dg/dy.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from runtime.arrays import Array, BoolArray, IntArray
from runtime.colliders.collider import SdfDerivatives
from runtime.corrections import load_kernels

log = logging.getLogger(__name__)

# A state is in balance when no load is farther from it than this share of the deepest penetration. E is then right to
# the square of it.
_TOLERANCE = 1e-6
_ITERATIONS = 12
# From a state nearby it takes two or three. What has taken so many more goes astray.
_NEAR_ITERATIONS = 7
# Newton's method is given up when the error has grown so many times.
_GROWTH = 10.0
_DESCENT_ITERATIONS = 100
# An energy so many times as high is more than round-off above another.
_HIGHER = 1.0 + 1e-6
# Where nothing is known: penetration is a tenth of what it would be if nothing gave way.
_FIRST_GUESS = 0.1


@dataclass(frozen=True, eq=False)
class LoadSolution:
    """left: e (m,) [m], penetration left (negative: a gap); normal: g (m, dim), curvature: H (m, dim, dim) [1/m] at the
    displaced loads; pressure: p (m,) [N]; moved: u (m, dim) [m]; energy: E [J]; converged, iterations and residual [m]:
    how the solve ended."""

    left: Array
    normal: Array
    curvature: Array
    pressure: Array
    moved: Array
    energy: float
    converged: bool
    iterations: int
    residual: float

    @cached_property
    def bearing(self) -> IntArray:
        """(k,) which of the m bear pressure."""
        return np.flatnonzero(self.pressure > 0.0)

    @cached_property
    def force(self) -> Array:
        """f (m, dim) [N]."""
        return self.pressure[:, None] * self.normal

    def joined_by(self, old: BoolArray) -> tuple[Array, Array]:
        """Penetrations (n,) and normals (n, dim) to start from where the m loads have become n, of which these are the
        old ones; the others bear nothing yet."""
        left, normal = np.full(len(old), -np.inf), np.zeros((len(old), self.normal.shape[1]))
        left[old], normal[old] = self.left, self.normal
        return left, normal


@dataclass(frozen=True, eq=False)
class LoadProblem:
    """The m loads near the collider, in the world.

    compliance: G (m*dim, m*dim) [m/N]; stiffness: a_j k (m,) [N/m^2]; position: x (m, dim) [m]; depth: of the deepest
    load [m]; distance: signed distance with derivatives at positions (n, dim).
    """

    compliance: Array
    stiffness: Array
    position: Array
    depth: float
    distance: Callable[[Array], SdfDerivatives]

    def solve(self, near: tuple[Array, Array] | None = None) -> LoadSolution:
        """The forces in balance; near: penetrations e (m,) and normals (m, dim) of a state nearby, to start from."""
        found = self._newton(near)
        if not found.converged or (near is not None and found.energy > _HIGHER * self._bound(near)):
            found = self._descend(near)
        if not found.converged:
            log.warning(
                "contact loads not in balance after %d iterations: %.1e m are missing",
                found.iterations,
                found.residual,
            )
        return found

    def _bound(self, near: tuple[Array, Array]) -> float:
        """E of the forces to start from: the minimum next to them is lower. Newton's method may go to another."""
        force = self._pressure(near[0])[:, None] * near[1]
        moved = self._apply(force)
        return self._energy(force, moved, -self.distance(self.position + moved).value)

    def stiffening(self, solution: LoadSolution, bearing: IntArray) -> Array:
        """D (k, dim, dim) [N/m] of the loads that bear pressure."""
        return load_kernels.stiffening(
            bearing, self.stiffness, solution.left, solution.pressure, solution.normal, solution.curvature
        )

    def among(self, index: IntArray) -> Array:
        """G (k*dim, k*dim) [m/N] among the loads `index`."""
        return load_kernels.among(self.compliance, index, self.position.shape[1])

    def _newton(self, near: tuple[Array, Array] | None) -> LoadSolution:
        x, scale = self.position, self.depth
        at_most = _ITERATIONS if near is None else _NEAR_ITERATIONS
        if near is None:
            at = self.distance(x)
            near = np.minimum(-at.value, _FIRST_GUESS * scale), at.gradient
        e = near[0]
        moved = self._apply(self._pressure(e)[:, None] * near[1])
        first = np.inf
        for iteration in range(at_most + 1):
            at = self.distance(x + moved)
            e, pressure, lag, residual = load_kernels.balance(
                self.compliance, self.stiffness, e, moved, at.value, at.gradient
            )
            converged = residual <= _TOLERANCE * scale
            first = residual if iteration == 0 else first
            lost = not np.isfinite(residual) or residual > _GROWTH * max(first, scale)
            if converged or lost or iteration == at_most:
                break
            try:
                moved, e = load_kernels.step(self.compliance, self.stiffness, e, pressure, moved, lag, *at)
            except np.linalg.LinAlgError:  # a load just about to slide off a tip
                break
        force = pressure[:, None] * at.gradient
        return self._solution(e, at, force, lag, converged, iteration, residual)

    def _descend(self, near: tuple[Array, Array] | None = None) -> LoadSolution:
        """Newton's method on E over the forces, with a line search: slower, but it always goes down. From no forces at
        all where no state is near."""
        force = np.zeros_like(self.position) if near is None else self._pressure(near[0])[:, None] * near[1]
        moved = self._apply(force)
        at = self.distance(self.position + moved)
        for iteration in range(_DESCENT_ITERATIONS + 1):
            e = -at.value
            balanced = self._pressure(e)[:, None] * at.gradient
            lag = moved - self._apply(balanced)
            residual = float(np.abs(lag).max(initial=0.0))
            converged = residual <= _TOLERANCE * self.depth
            if converged or iteration == _DESCENT_ITERATIONS:
                break
            step, slope = self._direction(e, at, force, balanced, lag)
            energy, change = self._energy(force, moved, e), self._apply(step)
            length = 1.0
            while True:
                trial = moved + length * change
                at = self.distance(self.position + trial)
                gained = self._energy(force + length * step, trial, -at.value) - energy
                if gained <= 1e-4 * length * slope + 1e-14 * energy or length < 1e-6:
                    break
                length *= 0.5
            force, moved = force + length * step, trial
        return self._solution(e, at, balanced, lag, converged, iteration, residual)

    def _direction(
        self, e: Array, at: SdfDerivatives, force: Array, balanced: Array, lag: Array
    ) -> tuple[Array, float]:
        """A change of the forces (m, dim) along which E falls, and how fast; without the curvature of the distance
        where with it E would rise."""
        bearing = np.flatnonzero(e > 0.0)
        among, right = self.among(bearing), -lag[bearing].ravel()
        for curvature in (at.hessian, np.zeros_like(at.hessian)):
            D = load_kernels.stiffening(bearing, self.stiffness, e, self._pressure(e), at.gradient, curvature)
            try:
                du = np.linalg.solve(load_kernels.softening(among, D), right).reshape(-1, lag.shape[1], 1)
            except np.linalg.LinAlgError:  # with curvature only: I + G D is regular for D >= 0
                continue
            step = balanced - force
            step[bearing] -= (D @ du)[..., 0]
            slope = float(np.vdot(force - balanced, self._apply(step)))
            if slope < 0.0:
                break
        return step, slope

    def _solution(
        self,
        e: Array,
        at: SdfDerivatives,
        force: Array,
        lag: Array,
        converged: bool,
        iterations: int,
        residual: float,
    ) -> LoadSolution:
        """With E at the forces themselves: where they lead is by -lag from where the distance is known."""
        moved = self._apply(force)
        left = -at.value + (at.gradient * lag).sum(axis=1)
        return LoadSolution(
            left=e,
            normal=at.gradient,
            curvature=at.hessian,
            pressure=self._pressure(e),
            moved=moved,
            energy=self._energy(force, moved, left),
            converged=converged,
            iterations=iterations,
            residual=residual,
        )

    def _energy(self, force: Array, moved: Array, left: Array) -> float:
        penalty = self.stiffness @ np.maximum(left, 0.0) ** 3 / 3.0
        return 0.5 * float(np.vdot(force, moved)) + float(penalty)

    def _pressure(self, left: Array) -> Array:
        """p (m,) [N]."""
        return np.asarray(self.stiffness * np.maximum(left, 0.0) ** 2)

    def _apply(self, force: Array) -> Array:
        """G f (m, dim)."""
        return np.asarray((self.compliance @ force.ravel()).reshape(force.shape))
