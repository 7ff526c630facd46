"""The contact solve: equilibrium contact forces between a collider and a linearly elastic surface.

At the m contact points near the collider, with reduced positions x_j, deformation gradients F_j, compliance G (see
`surface_compliance.py`) and the penalty law of the truth (thesis 5.4), displacements u, deformed positions y and forces
f satisfy

    y_j = x_j + u_j,    u_j = F_j sum_i G_ji F_i^T f_i,    f_j = p_j g(y_j),    p_j = a_j k max(0, -s(y_j))^2,

with s the signed distance and g its gradient *at the deformed position*. In rest coordinates, v = F^-1 u and
phi = F^T f, the compliance is constant: v = G phi. These are the conditions for a minimum of

    E(phi) = 1/2 phi . G phi + sum_j (a_j k / 3) max(0, -s(x_j + F_j (G phi)_j))^3.

Newton's method treats the displacements and the penetrations e_j = -s(y_j) as separate unknowns, which keeps the stiff
penalty law out of the linearisation: it takes two to six iterations, usually from any start. Where it fails (a collider
so deep that a point slides off its tip, or walls so thin that it could go to either side), E is minimised instead, with
a line search. This, too, starts from the warm start: E may have several minima, and only the one nearest to the last
contact is a continuous motion. Only the active set, ten to a hundred points in all, enters the linear systems:

    (I + G F^T D F) dv = ...,    D_j = S_j g g^T - p_j H_j,    S = dp/de,    H = dg/dy,

and of the principal directions of D only the significant ones (`contact_solve_kernels.py`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.colliders.collider import SdfDerivatives
from softprint.runtime.contact.solver import contact_point_kernels
from softprint.runtime.contact.solver import contact_solve_kernels as kernels
from softprint.runtime.lazy import lazy

log = logging.getLogger(__name__)

# The starting point of a solve: penetrations e (m,) [m] and normals (m, dim).
StartingPoint = tuple[Array, Array]

# Converged when the residual of every point is below this fraction of the deepest penetration. E is then right to the
# square of it.
_TOLERANCE = 1e-5
_ITERATIONS = 12
# A warm start needs two or three iterations. After so many Newton's method is unlikely to converge.
_NEAR_ITERATIONS = 7
# Newton's method stops when the residual has grown by this factor.
_GROWTH = 10.0
_DESCENT_ITERATIONS = 100
# An energy higher by this factor is higher by more than round-off.
_HIGHER = 1.0 + 1e-6
# Without a warm start: the first guess of the penetration, as a fraction of that of an undeformed body.
_FIRST_GUESS = 0.1


@dataclass(frozen=True, eq=False)
class ContactSolution:
    """The result of a contact solve at m points. penetration: e (m,) [m] (negative: a gap); normal: g (m, dim) and
    curvature: H (m, dim, dim) [1/m] at the deformed positions; pressure: p (m,) [N]; rest_displacement: v (m, dim) [m],
    in rest coordinates, and displacement: u = F v (m, dim) [m]; energy: E [J]; converged, iterations and residual [m]:
    how the solve ended."""

    penetration: Array
    normal: Array
    curvature: Array
    pressure: Array
    rest_displacement: Array
    displacement: Array
    energy: float
    converged: bool
    iterations: int
    residual: float

    @lazy
    def active(self) -> IntArray:
        """(k,) the active set: which of the m points carry pressure."""
        return np.flatnonzero(self.pressure > 0.0)

    @lazy
    def force(self) -> Array:
        """f (m, dim) [N]."""
        return self.pressure[:, None] * self.normal

    @lazy
    def largest_displacement(self) -> float:
        """The largest displacement of an active point [m]."""
        return contact_point_kernels.largest_norm(self.displacement, self.active)

    def extended(self, old: BoolArray) -> StartingPoint:
        """A starting point for n points, of which `old` (n,) are the m points of this solution; the others start
        without pressure."""
        penetration, normal = np.full(len(old), -np.inf), np.zeros((len(old), self.normal.shape[1]))
        penetration[old], normal[old] = self.penetration, self.normal
        return penetration, normal


@dataclass(frozen=True, eq=False)
class ContactProblem:
    """The contact problem of the m contact points near the colliders.

    compliance: G (m*dim, m*dim) [m/N] at rest, in any precision; F (m, dim, dim); stiffness: a_j k (m,) [N/m^2];
    position: x (m, dim) [m] in the world; depth: estimate of the contact displacement [m]; distance: computes the
    signed distance with derivatives at positions (m, dim).
    """

    compliance: NDArray[np.floating[Any]]
    F: Array
    stiffness: Array
    position: Array
    depth: float
    distance: Callable[[Array], SdfDerivatives]

    def solve(self, start: StartingPoint | None = None) -> ContactSolution:
        """The equilibrium contact forces; start: the warm start. Logs a warning where they do not converge."""
        found = self.follow(start)
        return self.descend(start) if found is None else found

    def follow(self, start: StartingPoint | None) -> ContactSolution | None:
        """The equilibrium by Newton's method alone; None where it does not converge, or to one farther off than the
        next to the warm start."""
        found, began = self._newton(start)
        farther = start is not None and found.energy > _HIGHER * began
        return found if found.converged and not farther else None

    def _newton(self, near: StartingPoint | None) -> tuple[ContactSolution, float]:
        """The solution by Newton's method, and E at its starting point. A solution with a higher E is not the minimum
        next to the starting point."""
        G, F, k, scale = self.compliance, self.F, self.stiffness, self.depth
        at_most = _ITERATIONS if near is None else _NEAR_ITERATIONS
        if near is None:
            at = self.distance(self.position)
            near = np.minimum(-at.value, _FIRST_GUESS * scale), at.gradient
        e, phi = near[0], self._forces(*near)
        v = self._apply(phi)
        first = began = np.inf
        for iteration in range(at_most + 1):
            at = self._distance(v)
            e, pressure, lag, residual = kernels.balance(G, F, k, e, v, at.value, at.gradient)
            converged = residual <= _TOLERANCE * scale
            if iteration == 0:
                first, began = residual, self._energy(phi, v, -at.value)
            lost = not np.isfinite(residual) or residual > _GROWTH * max(first, scale)
            if converged or lost or iteration == at_most:
                break
            try:
                v, e = kernels.newton_step(G, F, k, e, pressure, v, lag, *at)
            except np.linalg.LinAlgError:  # a point is about to slide off a tip
                break
        phi = kernels.pulled_back(F, pressure, at.gradient)
        return self._solution(e, at, phi, lag, converged, iteration, residual), began

    def descend(self, near: StartingPoint | None) -> ContactSolution:
        """Newton's method on E over the forces, with a line search: slower, but E always decreases. It starts from zero
        forces where there is no warm start. Logs a warning where it does not converge."""
        phi = np.zeros_like(self.position) if near is None else self._forces(*near)
        v = self._apply(phi)
        at = self._distance(v)
        for iteration in range(_DESCENT_ITERATIONS + 1):
            e = -at.value
            balanced = self._forces(e, at.gradient)
            lag = v - self._apply(balanced)
            residual = float(np.abs(kernels.to_world(self.F, lag)).max(initial=0.0))
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
        if not converged:
            log.warning(
                "the contact solve did not converge after %d iterations: residual %.1e m", iteration, residual
            )
        return self._solution(e, at, balanced, lag, converged, iteration, residual)

    def _direction(
        self, e: Array, at: SdfDerivatives, phi: Array, balanced: Array, lag: Array
    ) -> tuple[Array, Array, float]:
        """A descent direction of E: a change of the forces (m, dim), the displacements that it causes, and the slope of
        E along it. The curvature of the distance is left out where with it the direction would not descend."""
        pressure = self._pressure(e)
        for curvature in (at.hessian, np.zeros_like(at.hessian)):
            try:
                found = kernels.descent_direction(
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
        """The solution with E evaluated at the forces phi: their displacements differ by -lag from those at which the
        distance was evaluated."""
        v = self._apply(phi)
        penetration = -at.value + (at.gradient * kernels.to_world(self.F, lag)).sum(axis=1)
        return ContactSolution(
            penetration=e,
            normal=at.gradient,
            curvature=at.hessian,
            pressure=self._pressure(e),
            rest_displacement=v,
            displacement=kernels.to_world(self.F, v),
            energy=self._energy(phi, v, penetration),
            converged=converged,
            iterations=iterations,
            residual=residual,
        )

    def _distance(self, v: Array) -> SdfDerivatives:
        """The signed distance at the deformed positions."""
        return self.distance(self.position + kernels.to_world(self.F, v))

    def _energy(self, phi: Array, v: Array, penetration: Array) -> float:
        return kernels.energy(self.stiffness, phi, v, penetration)

    def _pressure(self, penetration: Array) -> Array:
        """p (m,) [N]."""
        return np.asarray(self.stiffness * np.square(np.maximum(penetration, 0.0)))

    def _forces(self, penetration: Array, normal: Array) -> Array:
        """phi = F^T p g (m, dim)."""
        return kernels.pulled_back(self.F, self._pressure(penetration), normal)

    def _apply(self, phi: Array) -> Array:
        """G phi (m, dim)."""
        return kernels.product(self.compliance, phi)
