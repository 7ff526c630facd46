"""Friction on points that give way: a friction potential and the compliance of the surface in series.

Contact points lie between contact nodes, which are fewer, so that what gives way is computed there: with the compliance
G among the nodes and the shares N of the points in them, nodal forces phi displace the nodes by u = G phi in rest
coordinates, which stores the energy u . G^-1 u / 2, and the points by N u. What friction feels is the slip of the
displaced points

    x(q, u) = y(q) + A(q) N u,

so that the energy of friction, and of the displacement, is

    E(q) = min_u  D(x(q, u)) + 1/2 u . G^-1 u,

with D the lagged potential of `runtime/contact/friction.py`: convex in u, and not changed where body and collider
rotate together. At the minimum phi = -N^T A^T g are the friction forces of the points, with g = dD/dx, so that they are
tangential though u is not bound to be. With H = d2D/dx2, J = dx/dq, T = A N, K = T^T H T + G^-1, of which the first has
blocks between nodes of one facet alone, and M = T^T H J + N^T (g . dA)

    dE/dq = J^T g,      d2E/dq2 = J^T H J - M^T K^-1 M.

A collider that moves by a twist w displaces anchors and normals, with derivatives p = d2D/dx dw and o = d2D/dw2:

    d2E/dq dw = J^T p - M^T K^-1 T^T p,      d2E/dw2 = o - (T^T p)^T K^-1 T^T p.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from softprint.runtime.arrays import Array
from softprint.runtime.contact.carriers.point_rotations import pulled_back_along
from softprint.runtime.contact.friction import FrictionTerms
from softprint.runtime.contact.solver.contact_solve_kernels import to_world
from softprint.runtime.lazy import lazy
from softprint.runtime.linalg.chain_rule import through_jacobian
from softprint.runtime.linalg.means import blocks_on_nodes, means, shared
from softprint.runtime.mechanics.compliance.surface_compliance_kernels import NodalCompliance

log = logging.getLogger(__name__)

# Converged when the displacements balance to this fraction of the largest of them.
_TOLERANCE = 1e-9
_ITERATIONS = 50
_SHORTEST = 1e-8
# Of the energy, what may be round-off.
_ROUND_OFF = 1e-12
# The compliance is regularised by this fraction of its mean diagonal, some tens of times the round-off of its single
# precision.
_DAMPED = 1e-5


@dataclass(frozen=True, eq=False)
class CompliantPoints:
    """How k points give way, by the m contact nodes at their corners, n = m dim. compliance: among the points [m/N];
    among_nodes: G (n, n) [m/N], regularised, and stiffness: its inverse (n, n) [N/m]."""

    compliance: NodalCompliance
    dim: int
    among_nodes: Array
    stiffness: Array

    @classmethod
    def of(cls, compliance: NodalCompliance, dim: int) -> CompliantPoints:
        """From the compliance among the points [m/N]."""
        G = compliance.among_nodes.astype(np.float64)
        n = len(G)
        if not n:
            return cls(compliance, dim, G, G)
        G = 0.5 * (G + G.T) + _DAMPED * np.trace(G) / n * np.eye(n)
        inverse = scipy.linalg.cho_solve(scipy.linalg.cho_factor(G), np.eye(n))
        return cls(compliance, dim, G, 0.5 * (inverse + inverse.T))

    def displacement(self, u: Array) -> Array:
        """N u (k, dim) [m], in rest coordinates, of displacements u (n,) [m] of the nodes."""
        return means(u.reshape(-1, self.dim), self.compliance.corners, self.compliance.shares)

    def displaced_by(self, forces: Array) -> Array:
        """G phi (n,) [m] of forces phi (m, dim) [N] on the nodes, in rest coordinates."""
        return np.asarray(self.among_nodes @ forces.ravel())

    def on_nodes(self, forces: Array) -> Array:
        """N^T f (n, j) of j columns of forces f (k, dim, j) on the points."""
        k, dim, j = forces.shape
        n_nodes = len(self.stiffness) // dim
        found = shared(forces.reshape(k, dim * j), self.compliance.corners, self.compliance.shares, n_nodes)
        return found.reshape(n_nodes * dim, j)

    def held(self, stiffness: Array) -> Array:
        """N^T S N (n, n) of stiffnesses S (k, dim, dim) [N/m] of the points."""
        n_nodes = len(self.stiffness) // self.dim
        return blocks_on_nodes(stiffness, self.compliance.corners, self.compliance.shares, n_nodes)


@dataclass(frozen=True, eq=False)
class CompliantFriction:
    """Friction of k points that has settled. terms: of D at the displaced points; points: how these give way; carrier:
    A (k, dim, dim); displacement: u (n,) [m]; position: x (k, dim) [m]; converged: whether friction and compliance
    balance."""

    terms: FrictionTerms
    points: CompliantPoints
    carrier: Array
    displacement: Array
    position: Array
    converged: bool

    @property
    def energy(self) -> float:
        """E [J]: what friction takes, and what is stored in the displacement."""
        return self.terms.energy + 0.5 * float(self.displacement @ self._restoring)

    @property
    def rest_displacement(self) -> Array:
        """N u (k, dim) [m]."""
        return self.points.displacement(self.displacement)

    @property
    def rest_forces(self) -> Array:
        """-A^T g (k, dim) [N]: of friction on the body, in rest coordinates."""
        return -np.asarray((self.carrier.swapaxes(1, 2) @ self.terms.gradient[..., None])[..., 0])

    @lazy
    def slope(self) -> Array:
        """dE/du (n,) [N]."""
        return np.asarray(self._dragging + self._restoring)

    @property
    def residual(self) -> float:
        """The largest of the slope, relative to the friction forces."""
        largest = np.abs(self._dragging).max(initial=0.0)
        return float(np.abs(self.slope).max(initial=0.0) / largest) if largest > 0.0 else 0.0

    def newton_step(self) -> Array:
        """The change of u (n,) of one Newton iteration."""
        return -np.asarray(scipy.linalg.cho_solve(self._factor, self.slope))

    def through(self, jacobian: Array, carried: Array) -> tuple[Array, Array]:
        """dE/drows (n_rows, dim) [N] and d2E/drows2 (n_rows*dim, n_rows*dim) [N/m]. jacobian: J (k*dim, n_rows*dim);
        carried: dA (k, dim, dim, n_rows*dim), by which the carriers change with the rows."""
        gradient, hessian = through_jacobian(jacobian, self.terms.gradient, self.terms.hessian)
        mixed = self._mixed(jacobian, carried)
        return gradient, hessian - mixed.T @ scipy.linalg.cho_solve(self._factor, mixed)

    def by_twist(self, mixed: Array, own: Array, jacobian: Array, carried: Array) -> tuple[Array, Array]:
        """The derivatives of E by the rows and a twist (n_rows*dim, m) and by the twist (m, m), from those of D by
        points and twist (k, dim, m) and by the twist (m, m)."""
        pushed = self._along(mixed)
        given = scipy.linalg.cho_solve(self._factor, pushed)
        by_rows = jacobian.T @ mixed.reshape(len(jacobian), -1)
        return by_rows - self._mixed(jacobian, carried).T @ given, own - pushed.T @ given

    def _mixed(self, jacobian: Array, carried: Array) -> Array:
        """M (n, n_rows*dim)."""
        k, dim, _ = self.terms.hessian.shape
        turned = pulled_back_along(carried, self.terms.gradient).reshape(k, dim, -1)
        held = self._along(self.terms.hessian @ jacobian.reshape(k, dim, -1))
        return held + self.points.on_nodes(turned)

    def _along(self, vectors: Array) -> Array:
        """T^T of vectors (k, dim, j): (n, j)."""
        return self.points.on_nodes(self.carrier.swapaxes(1, 2) @ vectors)

    @lazy
    def _dragging(self) -> Array:
        """T^T g (n,) [N]: what friction drags the nodes with, reversed."""
        return self._along(self.terms.gradient[..., None])[:, 0]

    @lazy
    def _restoring(self) -> Array:
        """G^-1 u (n,) [N]."""
        return np.asarray(self.points.stiffness @ self.displacement)

    @lazy
    def _factor(self) -> tuple[Array, bool]:
        """The Cholesky factor of K."""
        held = self.carrier.swapaxes(1, 2) @ self.terms.hessian @ self.carrier
        return scipy.linalg.cho_factor(self.points.held(held) + self.points.stiffness)


def settle(
    friction: Callable[[Array], FrictionTerms],
    position: Array,
    carrier: Array,
    points: CompliantPoints,
    start: Array | None = None,
) -> CompliantFriction:
    """The friction of points at y (k, dim) [m], with carriers A (k, dim, dim), that give way. friction: the terms of D
    at positions; start: u (n,) to start from, unless zero has less energy. Newton's method with a line search; logs a
    warning where it does not converge."""

    def at(u: Array) -> CompliantFriction:
        x = position + to_world(carrier, points.displacement(u))
        return CompliantFriction(friction(x), points, carrier, u, x, converged=False)

    tried = [at(u) for u in (np.zeros(len(points.stiffness)), start) if u is not None]
    found = min(tried, key=lambda one: one.energy)
    for _ in range(_ITERATIONS):
        if found.residual <= _TOLERANCE:
            return replace(found, converged=True)
        u, step = found.displacement, found.newton_step()
        energy, along, length = found.energy, float(found.slope @ step), 1.0
        while length > _SHORTEST:
            found = at(u + length * step)
            if found.energy <= energy + 1e-4 * length * along + _ROUND_OFF * abs(energy):
                break
            length *= 0.5
    log.warning("the friction of points that give way did not converge after %d iterations", _ITERATIONS)
    return found
