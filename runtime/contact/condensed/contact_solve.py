"""Contact with the body's compliance: the forces with which a collider and a linearly elastic surface are in balance.

At the m loads near the collider, with reduced positions x_j, deformation F_j, compliance G (see
`surface_compliance.py`) and the penalty law of the truth (thesis 5.4), displacements u, positions y and forces f
satisfy

    y_j = x_j + u_j,    u_j = F_j sum_i G_ji F_i^T f_i,    f_j = p_j g(y_j),    p_j = a_j k max(0, -s(y_j))^2,

s being the signed distance and g its gradient *where the load has gone*. In rest coordinates, v = F^-1 u and phi = F^T
f, the compliance needs not be carried along: v = G phi. These are the conditions for a minimum of

    E(phi) = 1/2 phi . G phi + sum_j (a_j k / 3) max(0, -s(x_j + F_j (G phi)_j))^3.

Newton's method is run on the displacement and on the penetrations e_j = -s(y_j) as unknowns of their own, which keeps
the stiff penalty law out of the linearisation: two to six iterations, as a rule wherever it starts. Where that fails (a
collider so deep that a load slides off its tip, or walls so thin that it could go to either side), E is minimised
instead, with a line search. That starts from the state nearby too: E may have several minima, and only the one next to
the last is a motion. Only loads that bear pressure, ten to a hundred in all, take part in linear systems:

    (I + G F^T D F) dv = ...,    D_j = S_j g g^T - p_j H_j,    S = dp/de,    H = dg/dy,

and of the directions of D only those that matter (`contact_solve_kernels.py`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array, BoolArray, IntArray
from runtime.colliders.collider import SdfDerivatives
from runtime.contact.condensed import contact_node_kernels, contact_solve_kernels

log = logging.getLogger(__name__)

# A state is in balance when no load is farther from it than this share of the deepest penetration. E is then right to
# the square of it.
_TOLERANCE = 1e-5
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
class ContactSolution:
    """left: e (m,) [m], penetration left (negative: a gap); normal: g (m, dim), curvature: H (m, dim, dim) [1/m] at the
    displaced loads; pressure: p (m,) [N]; given: v (m, dim) [m], in rest coordinates, and moved: u = F v (m, dim) [m];
    energy: E [J]; converged, iterations and residual [m]: how the solve ended."""

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

    @cached_property
    def bearing(self) -> IntArray:
        """(k,) which of the m bear pressure."""
        return np.flatnonzero(self.pressure > 0.0)

    @cached_property
    def force(self) -> Array:
        """f (m, dim) [N]."""
        return self.pressure[:, None] * self.normal

    @cached_property
    def farthest(self) -> float:
        """How far loads that bear pressure are moved at most [m]."""
        return contact_node_kernels.farthest(self.moved, self.bearing)

    def joined_by(self, old: BoolArray) -> tuple[Array, Array]:
        """Penetrations (n,) and normals (n, dim) to start from where the m loads have become n, of which these are the
        old ones; the others bear nothing yet."""
        left, normal = np.full(len(old), -np.inf), np.zeros((len(old), self.normal.shape[1]))
        left[old], normal[old] = self.left, self.normal
        return left, normal


@dataclass(frozen=True, eq=False)
class ContactProblem:
    """The m loads near the collider.

    compliance: G (m*dim, m*dim) [m/N] at rest, in any precision; F (m, dim, dim); stiffness: a_j k (m,) [N/m^2];
    position: x (m, dim) [m] in the world; depth: about how far loads are displaced [m]; distance: signed distance with
    derivatives at positions (n, dim).
    """

    compliance: NDArray[np.floating[Any]]
    F: Array
    stiffness: Array
    position: Array
    depth: float
    distance: Callable[[Array], SdfDerivatives]

    def solve(self, near: tuple[Array, Array] | None = None) -> ContactSolution:
        """The forces in balance; near: penetrations e (m,) and normals (m, dim) of a state nearby, to start from."""
        found, began = self._newton(near)
        if not found.converged or (near is not None and found.energy > _HIGHER * began):
            found = self._descend(near)
        if not found.converged:
            log.warning(
                "contact loads not in balance after %d iterations: %.1e m are missing",
                found.iterations,
                found.residual,
            )
        return found

    def _newton(self, near: tuple[Array, Array] | None) -> tuple[ContactSolution, float]:
        """And E where it began: the minimum next to there is lower, but Newton's method may go to another."""
        G, F, k, scale = self.compliance, self.F, self.stiffness, self.depth
        at_most = _ITERATIONS if near is None else _NEAR_ITERATIONS
        if near is None:
            at = self.distance(self.position)
            near = np.minimum(-at.value, _FIRST_GUESS * scale), at.gradient
        e, phi = near[0], self._loads(*near)
        v = self._apply(phi)
        first = began = np.inf
        for iteration in range(at_most + 1):
            at = self._distance(v)
            e, pressure, lag, residual = contact_solve_kernels.balance(G, F, k, e, v, at.value, at.gradient)
            converged = residual <= _TOLERANCE * scale
            if iteration == 0:
                first, began = residual, self._energy(phi, v, -at.value)
            lost = not np.isfinite(residual) or residual > _GROWTH * max(first, scale)
            if converged or lost or iteration == at_most:
                break
            try:
                v, e = contact_solve_kernels.step(G, F, k, e, pressure, v, lag, *at)
            except np.linalg.LinAlgError:  # a load just about to slide off a tip
                break
        phi = contact_solve_kernels.pulled_back(F, pressure, at.gradient)
        return self._solution(e, at, phi, lag, converged, iteration, residual), began

    def _descend(self, near: tuple[Array, Array] | None = None) -> ContactSolution:
        """Newton's method on E over the loads, with a line search: slower, but it always goes down. From no loads at
        all where no state is near."""
        phi = np.zeros_like(self.position) if near is None else self._loads(*near)
        v = self._apply(phi)
        at = self._distance(v)
        for iteration in range(_DESCENT_ITERATIONS + 1):
            e = -at.value
            balanced = self._loads(e, at.gradient)
            lag = v - self._apply(balanced)
            residual = float(np.abs(contact_solve_kernels.moved_by(self.F, lag)).max(initial=0.0))
            converged = residual <= _TOLERANCE * self.depth
            if converged or iteration == _DESCENT_ITERATIONS:
                break
            change, along, slope = self._direction(e, at, phi, balanced, lag)
            energy = self._energy(phi, v, e)
            length = 1.0
            while True:
                trial = v + length * along
                at = self._distance(trial)
                gained = self._energy(phi + length * change, trial, -at.value) - energy
                if gained <= 1e-4 * length * slope + 1e-14 * energy or length < 1e-6:
                    break
                length *= 0.5
            phi, v = phi + length * change, trial
        return self._solution(e, at, balanced, lag, converged, iteration, residual)

    def _direction(
        self, e: Array, at: SdfDerivatives, phi: Array, balanced: Array, lag: Array
    ) -> tuple[Array, Array, float]:
        """A change of the loads (m, dim) along which E falls, what it moves, and how fast E falls; without the
        curvature of the distance where with it E would rise."""
        pressure = self._pressure(e)
        for curvature in (at.hessian, np.zeros_like(at.hessian)):
            try:
                found = contact_solve_kernels.descent(
                    self.compliance,
                    self.F,
                    self.stiffness,
                    e,
                    pressure,
                    phi,
                    balanced,
                    lag,
                    at.gradient,
                    curvature,
                )
            except np.linalg.LinAlgError:  # with curvature only: I + G D is regular for D >= 0
                continue
            if found[2] < 0.0:
                break
        return found

    def _solution(
        self,
        e: Array,
        at: SdfDerivatives,
        phi: Array,
        lag: Array,
        converged: bool,
        iterations: int,
        residual: float,
    ) -> ContactSolution:
        """With E at the loads themselves: where they lead is by -lag from where the distance is known."""
        v = self._apply(phi)
        left = -at.value + (at.gradient * contact_solve_kernels.moved_by(self.F, lag)).sum(axis=1)
        return ContactSolution(
            left=e,
            normal=at.gradient,
            curvature=at.hessian,
            pressure=self._pressure(e),
            given=v,
            moved=contact_solve_kernels.moved_by(self.F, v),
            energy=self._energy(phi, v, left),
            converged=converged,
            iterations=iterations,
            residual=residual,
        )

    def _distance(self, v: Array) -> SdfDerivatives:
        """At the displaced loads."""
        return self.distance(self.position + contact_solve_kernels.moved_by(self.F, v))

    def _energy(self, phi: Array, v: Array, left: Array) -> float:
        return contact_solve_kernels.energy(self.stiffness, phi, v, left)

    def _pressure(self, left: Array) -> Array:
        """p (m,) [N]."""
        return np.asarray(self.stiffness * np.square(np.maximum(left, 0.0)))

    def _loads(self, left: Array, normal: Array) -> Array:
        """phi = F^T p g (m, dim)."""
        return contact_solve_kernels.pulled_back(self.F, self._pressure(left), normal)

    def _apply(self, phi: Array) -> Array:
        """G phi (m, dim)."""
        return contact_solve_kernels.product(self.compliance, phi)
