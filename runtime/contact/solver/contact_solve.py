"""The contact solve: equilibrium contact forces between a collider and a linearly elastic surface.

At the m contact points near the collider, with reduced positions x_j, carriers A_j (`runtime/contact/carriers/`),
compliance G (see `surface_compliance.py`) and the penalty law of the truth (thesis 5.4), displacements u, deformed
positions y and forces f satisfy

    y_j = x_j + u_j,    u_j = A_j sum_i G_ji A_i^T f_i,    f_j = p_j g(y_j),    p_j = a_j k max(0, -s(y_j))^2,

with s the signed distance and g its gradient *at the deformed position*. In rest coordinates, v = A^-1 u and
phi = A^T f, the compliance is constant: v = G phi. These are the conditions for a minimum of

    E(phi) = 1/2 phi . G phi + sum_j (a_j k / 3) max(0, -s(x_j + A_j (G phi)_j))^3.

Newton's method treats the displacements and the penetrations e_j = -s(y_j) as separate unknowns, which keeps the stiff
penalty law out of the linearisation: it takes two to six iterations, usually from any start. Where it fails (a collider
so deep that a point slides off its tip, or walls so thin that it could go to either side), E is minimised instead, with
a line search, along directions of negative curvature where it is not convex (`negative_curvature.py`). This, too,
starts from the warm start: E may have several minima, and only the one nearest to the last contact is a continuous
motion. Only the active set, ten to a hundred points in all, enters the linear systems:

    (I + G A^T D A) dv = ...,    D_j = S_j g g^T - p_j H_j,    S = dp/de,    H = dg/dy,

and of the principal directions of D only the significant ones (`contact_solve_kernels.py`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.colliders.collider import SdfDerivatives
from softprint.runtime.contact.solver import contact_point_kernels
from softprint.runtime.contact.solver import contact_solve_kernels as kernels
from softprint.runtime.contact.solver.negative_curvature import modified_newton_change
from softprint.runtime.lazy import lazy
from softprint.runtime.mechanics.compliance.surface_compliance_kernels import NodalCompliance

log = logging.getLogger(__name__)

Floats = NDArray[np.floating[Any]]
# The starting point of a solve: penetrations e (m,) [m] and normals (m, dim).
StartingPoint = tuple[Array, Array]

# Converged when the residual of every point is below this fraction of the deepest penetration. E is then right to the
# square of it.
_TOLERANCE = 1e-5
# Of that, what Newton's method goes on to, if it can, where the forces themselves matter to first order.
_TIGHTER = 0.01
_ITERATIONS = 12
# A warm start needs two or three iterations. After so many Newton's method is unlikely to converge.
_NEAR_ITERATIONS = 10
# Newton's method stops when the residual has grown by this factor, or, after so many iterations, when it is no longer
# the smallest so far.
_GROWTH, _SETTLED = 10.0, 4
_DESCENT_ITERATIONS = 50
# The line search: the least gain, as a share of what the slope promises, the shortest step, and the longest where the
# energy is not convex, which has no natural length.
_ENOUGH, _SHORTEST, _LONGEST = 1e-4, 1e-6, 16.0
# An energy higher by this factor is higher by more than round-off.
_HIGHER = 1.0 + 1e-6
# Without a warm start: the first guess of the penetration, as a fraction of that of an undeformed body.
_FIRST_GUESS = 0.1


@dataclass(frozen=True, eq=False)
class ContactSolution:
    """The result of a contact solve at m points. penetration: e (m,) [m] (negative: a gap); normal: g (m, dim) and
    curvature: H (m, dim, dim) [1/m] at the deformed positions; pressure: p (m,) [N]; rest_displacement: v (m, dim) [m],
    in rest coordinates, and displacement: u = A v (m, dim) [m]; energy: E [J]; converged, iterations and residual [m]:
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

    compliance: G at rest; A (m, dim, dim); stiffness: a_j k (m,) [N/m^2]; position: x (m, dim) [m] in the world; depth:
    estimate of the contact displacement [m]; distance: computes the signed distance with derivatives at positions (m,
    dim); tight: whether something depends on the forces to first order, as the network of a learned energy does.
    """

    compliance: NodalCompliance
    carriers: Array
    stiffness: Array
    position: Array
    depth: float
    distance: Callable[[Array], SdfDerivatives]
    tight: bool = False

    def solve(self, start: StartingPoint | None = None) -> ContactSolution:
        """The equilibrium contact forces; start: the warm start. Logs a warning where they do not converge."""
        found = self.follow(start)
        return self.descend(start) if found is None else found

    def follow(self, start: StartingPoint | None, most: float = np.inf) -> ContactSolution | None:
        """The equilibrium by Newton's method alone; None where it does not converge, or to one farther off than the
        next to the warm start, or where that has more energy than `most` [J]."""
        found, began = self._newton(start)
        farther = start is not None and found.energy > _HIGHER * began
        return found if found.converged and not farther and began <= most else None

    def lowest(self, *starts: StartingPoint) -> StartingPoint:
        """Of starting points that with the least E."""
        return min(starts, key=self._energy_from)

    def _energy_from(self, start: StartingPoint) -> float:
        phi = self._forces(*start)
        v = self._apply(phi)
        return self._energy(phi, v, -self._distance(v).value)

    def _newton(self, near: StartingPoint | None) -> tuple[ContactSolution, float]:
        """The solution by Newton's method, and E at its starting point. A solution with a higher E is not the minimum
        next to the starting point."""
        G, A, k, scale = self.compliance, self.carriers, self.stiffness, self.depth
        enough = _TOLERANCE * scale * (_TIGHTER if self.tight else 1.0)
        at_most = _ITERATIONS if near is None else _NEAR_ITERATIONS
        if near is None:
            at = self.distance(self.position)
            near = np.minimum(-at.value, _FIRST_GUESS * scale), at.gradient
        e, phi = near[0], self._forces(*near)
        v = self._apply(phi)
        first = began = best = np.inf
        for iteration in range(at_most + 1):
            at = self._distance(v)
            e, pressure, lag, residual = kernels.balance(G, A, k, e, v, at.value, at.gradient)
            if iteration == 0:
                first, began = residual, self._energy(phi, v, -at.value)
            lost = not np.isfinite(residual) or residual > _GROWTH * max(first, scale)
            lost |= iteration >= _SETTLED and residual >= best
            best = min(best, residual)
            if residual <= enough or lost or iteration == at_most:
                break
            right, point, directions, K, projected = kernels.newton_system(G, A, k, e, pressure, lag, *at)
            try:
                y = _solved(K, projected)
            except np.linalg.LinAlgError:  # a point is about to slide off a tip
                break
            v, e = kernels.newton_step(G, A, e, v, at.value, at.gradient, right, point, directions, y)
        phi = kernels.pulled_back(A, pressure, at.gradient)
        converged = residual <= _TOLERANCE * scale
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
            residual = float(np.abs(kernels.to_world(self.carriers, lag)).max(initial=0.0))
            converged = residual <= _TOLERANCE * self.depth
            if converged or iteration == _DESCENT_ITERATIONS:
                break
            phi, v, at = self._descended(e, at, phi, v, balanced, lag)
        if not converged:
            log.warning(
                "the contact solve did not converge after %d iterations: residual %.1e m", iteration, residual
            )
        found = self._solution(e, at, balanced, lag, converged, iteration, residual)
        # Newton's method gets closer, so that the result depends less on the way there.
        closer = replace(self, tight=True).follow((found.penetration, found.normal)) if converged else None
        return found if closer is None else replace(closer, iterations=iteration + closer.iterations)

    def _descended(
        self, e: Array, at: SdfDerivatives, phi: Array, v: Array, balanced: Array, lag: Array
    ) -> tuple[Array, Array, SdfDerivatives]:
        """Forces, displacements and distance after a step by which E decreases."""
        change, along, slope, convex = self._direction(e, at, phi, balanced, lag)
        energy = self._energy(phi, v, e)

        def gain(length: float) -> tuple[float, SdfDerivatives]:
            trial = v + length * along
            reached = self._distance(trial)
            return self._energy(phi + length * change, trial, -reached.value) - energy, reached

        length, at = _line_search(gain, slope, 1e-14 * energy, 1.0 if convex else _LONGEST)
        return phi + length * change, v + length * along, at

    def _direction(
        self, e: Array, at: SdfDerivatives, phi: Array, balanced: Array, lag: Array
    ) -> tuple[Array, Array, float, bool]:
        """A descent direction of E: a change of the forces (m, dim), the displacements that it causes, the slope of E
        along it, and whether it is Newton's. Where that would not descend it is modified
        (`negative_curvature.py`)."""
        pressure = self._pressure(e)
        try:
            G, A, k = self.compliance, self.carriers, self.stiffness
            system = kernels.linear_system(G, A, k, e, pressure, at.gradient, at.hessian, -lag)
            point, directions, K, projected = system
            reaction = kernels.expanded(point, directions, _solved(K, projected), len(lag))
            change = balanced - phi - reaction
            # The displacements of exactly this change, whatever its precision.
            along = -lag - self._apply(reaction)
            slope = float(((phi - balanced) * along).sum())
            if slope < 0.0:
                return change, along, slope, True
        except np.linalg.LinAlgError:  # a point is about to slide off a tip
            pass
        g, H, steepness = at.gradient, at.hessian, 2.0 * self.stiffness * np.maximum(e, 0.0)
        D = steepness[:, None, None] * g[:, :, None] * g[:, None, :]
        D -= pressure[:, None, None] * 0.5 * (H + H.transpose(0, 2, 1))
        change = modified_newton_change(self._apply, self.carriers, D, phi - balanced)
        along = self._apply(change)
        return change, along, float(((phi - balanced) * along).sum()), False

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
        penetration = -at.value + (at.gradient * kernels.to_world(self.carriers, lag)).sum(axis=1)
        return ContactSolution(
            penetration=e,
            normal=at.gradient,
            curvature=at.hessian,
            pressure=self._pressure(e),
            rest_displacement=v,
            displacement=kernels.to_world(self.carriers, v),
            energy=self._energy(phi, v, penetration),
            converged=converged,
            iterations=iterations,
            residual=residual,
        )

    def _distance(self, v: Array) -> SdfDerivatives:
        """The signed distance at the deformed positions."""
        return self.distance(self.position + kernels.to_world(self.carriers, v))

    def _energy(self, phi: Array, v: Array, penetration: Array) -> float:
        return kernels.energy(self.stiffness, phi, v, penetration)

    def _pressure(self, penetration: Array) -> Array:
        """p (m,) [N]."""
        return np.asarray(self.stiffness * np.square(np.maximum(penetration, 0.0)))

    def _forces(self, penetration: Array, normal: Array) -> Array:
        """phi = A^T p g (m, dim)."""
        return kernels.pulled_back(self.carriers, self._pressure(penetration), normal)

    def _apply(self, phi: Array) -> Array:
        """G phi (m, dim)."""
        return kernels.product(self.compliance, phi)


def _solved(K: Floats, right: Floats) -> Floats:
    """K^-1 right (r,). Raises numpy.linalg.LinAlgError for a singular matrix."""
    if not len(K):
        return right
    solve = lapack.sgesv if K.dtype == np.float32 else lapack.dgesv
    # K is symmetric, and LAPACK's order the other one: so nothing is copied.
    _, _, y, singular = solve(K.T, right, overwrite_a=True)
    if singular:
        raise np.linalg.LinAlgError("the linear system of a contact is singular")
    return np.asarray(y)


def _line_search(
    gain: Callable[[float], tuple[float, SdfDerivatives]], slope: float, rounding: float, longest: float
) -> tuple[float, SdfDerivatives]:
    """A length of a step by which the energy decreases enough (Armijo), and the distance there: 1, or as far as it goes
    on decreasing with doubled lengths, or as much shorter as is needed. gain: the change of the energy at a length."""
    length, (gained, at) = 1.0, gain(1.0)
    while length < longest and gained <= _ENOUGH * length * slope:
        farther = gain(2.0 * length)
        if farther[0] >= gained:
            break
        length, (gained, at) = 2.0 * length, farther
    while gained > _ENOUGH * length * slope + rounding and length > _SHORTEST:
        length *= 0.5
        gained, at = gain(length)
    return length, at
