"""Friction on points that give way: a friction potential and the compliance of the surface in series.

Friction forces on the body, t along the tangents E of points when normal forces were fixed, displace these points in
rest coordinates by V t, V = G A0^T E, as contact forces do. What friction feels is the slip of the displaced points

    x(q, t) = y(q) + A(q) V t,      A(q) = A0 + s (F(q) - F0),

so that the energy of friction, and of the displacement, is

    E(q) = min_t  D(x(q, t)) + 1/2 t . C t,      C = E^T A0 G A0^T E,

with D the lagged potential of `runtime/contact/friction.py`: convex in t, and not changed where body and collider
rotate together. With g = dD/dx, H = d2D/dx2, J = dx/dq, T = A V, K = T^T H T + C and M = T^T H J + g . dA V

    dE/dq = J^T g,      d2E/dq2 = J^T H J - M^T K^-1 M.

A collider that moves by a twist w displaces anchors and normals, with derivatives p = d2D/dx dw and o = d2D/dw2:

    d2E/dq dw = J^T p - M^T K^-1 T^T p,      d2E/dw2 = o - (T^T p)^T K^-1 T^T p.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from softprint.runtime.arrays import Array
from softprint.runtime.contact.carriers.carriers import pulled_back_along
from softprint.runtime.contact.friction import FrictionTerms
from softprint.runtime.lazy import lazy
from softprint.runtime.linalg.chain_rule import through_jacobian

log = logging.getLogger(__name__)

# Converged when the displacements balance to this fraction of the largest of them.
_TOLERANCE = 1e-9
_ITERATIONS = 50
_SHORTEST = 1e-8
# Of the energy, what may be round-off.
_ROUND_OFF = 1e-12
# Points between nodes do not move independently of each other: C is regularised by this fraction of its mean diagonal,
# some tens of times the round-off of its single precision.
_DAMPED = 1e-5


@dataclass(frozen=True, eq=False)
class TangentCompliance:
    """How k points give way along their tangents, n = k (dim-1) in all. load: A0^T E (k, dim, dim-1), rest forces by
    those along the tangents; moved: V (k*dim, n) [m/N], displacements by them, in rest coordinates; matrix: C (n, n)
    [m/N]."""

    load: Array
    moved: Array
    matrix: Array

    @classmethod
    def of(cls, compliance: Array, carrier: Array, normal: Array) -> TangentCompliance:
        """From the compliance G (k*dim, k*dim) [m/N], carriers A0 (k, dim, dim) and unit normals (k, dim)."""
        k, dim = normal.shape
        n = k * (dim - 1)
        load = carrier.swapaxes(1, 2) @ _tangents(normal)
        moved = np.einsum("njb,jbc->njc", compliance.reshape(k * dim, k, dim), load).reshape(k * dim, n)
        matrix = (load.swapaxes(1, 2) @ moved.reshape(k, dim, n)).reshape(n, n)
        damped = _DAMPED * np.trace(matrix) / max(n, 1) * np.eye(n)
        return cls(load, moved, 0.5 * (matrix + matrix.T) + damped)

    def displacement(self, force: Array) -> Array:
        """V t (k, dim) [m], in rest coordinates, of t (n,) [N]."""
        return np.asarray((self.moved @ force).reshape(self.load.shape[:2]))

    def rest_forces(self, force: Array) -> Array:
        """(k, dim) [N] of t (n,) [N]."""
        k, _, count = self.load.shape
        return np.asarray((self.load @ force.reshape(k, count, 1))[..., 0])


@dataclass(frozen=True, eq=False)
class CompliantFriction:
    """Friction of k points that has settled. terms: of D at the displaced points; compliance: of these; carrier: A (k,
    dim, dim); force: t (n,) [N]; position: x (k, dim) [m]; converged: whether friction and compliance balance."""

    terms: FrictionTerms
    compliance: TangentCompliance
    carrier: Array
    force: Array
    position: Array
    converged: bool

    @property
    def energy(self) -> float:
        """E [J]: what friction takes, and what is stored in the displacement."""
        return self.terms.energy + 0.5 * float(self.force @ self.compliance.matrix @ self.force)

    @property
    def rest_displacement(self) -> Array:
        """V t (k, dim) [m]."""
        return self.compliance.displacement(self.force)

    @property
    def slope(self) -> Array:
        """dE/dt (n,) [m]."""
        return np.asarray(self._along(self.terms.gradient) + self.compliance.matrix @ self.force)

    def newton_step(self) -> Array:
        """The change of t (n,) [N] of one Newton iteration."""
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
        k, dim, _ = self.terms.hessian.shape
        held = self.carrier.swapaxes(1, 2) @ self.terms.hessian @ self.carrier
        moved = self.compliance.moved
        stiff = moved.T @ (held @ moved.reshape(k, dim, -1)).reshape(k * dim, -1)
        return scipy.linalg.cho_factor(stiff + self.compliance.matrix)


def settle(
    friction: Callable[[Array], FrictionTerms],
    position: Array,
    carrier: Array,
    compliance: TangentCompliance,
    start: Array | None = None,
) -> CompliantFriction:
    """The friction of points at y (k, dim) [m], with carriers A (k, dim, dim), that give way. friction: the terms of D
    at positions; start: t (n,) [N] to start from, zero by default. Newton's method with a line search; logs a warning
    where it does not converge."""

    def at(t: Array, converged: bool = False) -> CompliantFriction:
        x = position + (carrier @ compliance.displacement(t)[..., None])[..., 0]
        return CompliantFriction(friction(x), compliance, carrier, t, x, converged)

    found = at(np.zeros(len(compliance.matrix)) if start is None else start)
    for _ in range(_ITERATIONS):
        t, slope = found.force, found.slope
        largest = np.abs(slope - compliance.matrix @ t).max(initial=0.0)
        if np.abs(slope).max(initial=0.0) <= _TOLERANCE * largest:
            return at(t, converged=True)
        step = found.newton_step()
        energy, along, length = found.energy, float(slope @ step), 1.0
        while length > _SHORTEST:
            found = at(t + length * step)
            if found.energy <= energy + 1e-4 * length * along + _ROUND_OFF * abs(energy):
                break
            length *= 0.5
    log.warning("the friction of points that give way did not converge after %d iterations", _ITERATIONS)
    return found


def _tangents(normal: Array) -> Array:
    """E (k, dim, dim-1): orthonormal tangents of unit normals (k, dim)."""
    if normal.shape[1] == 2:
        return np.stack([-normal[:, 1], normal[:, 0]], axis=1)[..., None]
    # Duff et al. 2017: a basis without a branch that is near to singular.
    x, y, z = normal.T
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    first = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=1)
    second = np.stack([b, sign + y * y * a, -y], axis=1)
    return np.stack([first, second], axis=2)
