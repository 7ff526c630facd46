"""Friction on points that give way: a friction potential and the compliance of the surface in series.

Contact points lie between contact nodes, which are fewer, so that what gives way is computed there: with the compliance
G = L L^T among the nodes and the shares N of the points in them, nodal forces phi displace the points in rest
coordinates by N G phi = V s, with V = N L and s = L^T phi, and store the energy phi . G phi / 2 = s . s / 2. What
friction feels is the slip of the displaced points

    x(q, s) = y(q) + A(q) V s,

so that the energy of friction, and of the displacement, is

    E(q) = min_s  D(x(q, s)) + 1/2 s . s,

with D the lagged potential of `runtime/contact/friction.py`: convex in s, and not changed where body and collider
rotate together. At the minimum phi = -N^T A^T g are the friction forces of the points, with g = dD/dx, so that they are
tangential though s is not bound to be. With H = d2D/dx2, J = dx/dq, T = A V, K = T^T H T + 1 and
M = T^T H J + g . dA V

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
from softprint.runtime.contact.carriers.carriers import pulled_back_along
from softprint.runtime.contact.friction import FrictionTerms
from softprint.runtime.lazy import lazy
from softprint.runtime.linalg.chain_rule import through_jacobian
from softprint.runtime.linalg.means import blocks_on_nodes, means
from softprint.runtime.mechanics.surface_compliance_kernels import NodalCompliance

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
class FactoredCompliance:
    """How k points give way, by the m contact nodes at their corners, n = m dim. compliance: among the points [m/N];
    factor: L (n, n), lower; moved: V (k*dim, n), displacements of the points in rest coordinates."""

    compliance: NodalCompliance
    dim: int
    factor: Array
    moved: Array

    @classmethod
    def of(cls, compliance: NodalCompliance, dim: int) -> FactoredCompliance:
        """From the compliance among the points [m/N]."""
        G = compliance.among_nodes.astype(np.float64)
        n, k = len(G), len(compliance.corners)
        if not n:
            return cls(compliance, dim, G, G)
        factor = np.linalg.cholesky(0.5 * (G + G.T) + _DAMPED * np.trace(G) / n * np.eye(n))
        moved = means(factor.reshape(n // dim, dim, n), compliance.corners, compliance.shares)
        return cls(compliance, dim, factor, moved.reshape(k * dim, n))

    def displacement(self, s: Array) -> Array:
        """V s (k, dim) [m], in rest coordinates, of s (n,) [J^1/2]."""
        return np.asarray((self.moved @ s).reshape(-1, self.dim))

    def stored(self, forces: Array) -> Array:
        """s = L^T phi (n,) of forces phi (m, dim) [N] on the nodes, in rest coordinates."""
        return np.asarray(self.factor.T @ forces.ravel())

    def held(self, stiffness: Array) -> Array:
        """V^T S V (n, n) of stiffnesses S (k, dim, dim) [N/m] of the points."""
        n_nodes = len(self.factor) // self.dim
        on_nodes = blocks_on_nodes(stiffness, self.compliance.corners, self.compliance.shares, n_nodes)
        return np.asarray(self.factor.T @ (on_nodes @ self.factor))


@dataclass(frozen=True, eq=False)
class CompliantFriction:
    """Friction of k points that has settled. terms: of D at the displaced points; compliance: of these; carrier: A (k,
    dim, dim); stored: s (n,) [J^1/2]; position: x (k, dim) [m]; converged: whether friction and compliance balance."""

    terms: FrictionTerms
    compliance: FactoredCompliance
    carrier: Array
    stored: Array
    position: Array
    converged: bool

    @property
    def energy(self) -> float:
        """E [J]: what friction takes, and what is stored in the displacement."""
        return self.terms.energy + 0.5 * float(self.stored @ self.stored)

    @property
    def rest_displacement(self) -> Array:
        """V s (k, dim) [m]."""
        return self.compliance.displacement(self.stored)

    @property
    def rest_forces(self) -> Array:
        """-A^T g (k, dim) [N]: of friction on the body, in rest coordinates."""
        return -np.asarray((self.carrier.swapaxes(1, 2) @ self.terms.gradient[..., None])[..., 0])

    @property
    def slope(self) -> Array:
        """dE/ds (n,) [J^1/2]."""
        return np.asarray(self._along(self.terms.gradient) + self.stored)

    def newton_step(self) -> Array:
        """The change of s (n,) of one Newton iteration."""
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
        turned = pulled_back_along(carried, self.terms.gradient)
        held = self._along(self.terms.hessian @ jacobian.reshape(k, dim, -1))
        return np.asarray(held + self.compliance.moved.T @ turned)

    def _along(self, vectors: Array) -> Array:
        """T^T of vectors (k, dim), or of several (k, dim, m): (n,), or (n, m)."""
        k, dim, *more = vectors.shape
        at_rest = self.carrier.swapaxes(1, 2) @ vectors.reshape(k, dim, *(more or [1]))
        return np.asarray(self.compliance.moved.T @ at_rest.reshape(k * dim, *more))

    @lazy
    def _factor(self) -> tuple[Array, bool]:
        """The Cholesky factor of K."""
        held = self.carrier.swapaxes(1, 2) @ self.terms.hessian @ self.carrier
        return scipy.linalg.cho_factor(self.compliance.held(held) + np.eye(len(self.stored)))


def settle(
    friction: Callable[[Array], FrictionTerms],
    position: Array,
    carrier: Array,
    compliance: FactoredCompliance,
    start: Array | None = None,
) -> CompliantFriction:
    """The friction of points at y (k, dim) [m], with carriers A (k, dim, dim), that give way. friction: the terms of D
    at positions; start: s (n,) to start from, unless zero has less energy. Newton's method with a line search; logs a
    warning where it does not converge."""

    def at(s: Array) -> CompliantFriction:
        x = position + (carrier @ compliance.displacement(s)[..., None])[..., 0]
        return CompliantFriction(friction(x), compliance, carrier, s, x, converged=False)

    tried = [at(s) for s in (np.zeros(len(compliance.factor)), start) if s is not None]
    found = min(tried, key=lambda one: one.energy)
    for _ in range(_ITERATIONS):
        s, slope = found.stored, found.slope
        largest = np.abs(slope - s).max(initial=0.0)
        if np.abs(slope).max(initial=0.0) <= _TOLERANCE * largest:
            return replace(found, converged=True)
        step = found.newton_step()
        energy, along, length = found.energy, float(slope @ step), 1.0
        while length > _SHORTEST:
            found = at(s + length * step)
            if found.energy <= energy + 1e-4 * length * along + _ROUND_OFF * abs(energy):
                break
            length *= 0.5
    log.warning("the friction of points that give way did not converge after %d iterations", _ITERATIONS)
    return found
