"""Carriers A of points: u = A v is the displacement in the deformed body that v = G phi is in the body at rest.

A = R, the rotation of the body there, a smooth function of its deformation gradient F. Carried by F in place of its
rotation, the compliance F G F^T grows with the square of a stretch. In full space it hardly does: of a slab pushed into
the small Jelly, at the states of full space, the force was 48 % off so, and is 14 % off; elasticity linearised at each
state is 6 % off (`python -m reproduction.linear_response`).

R is the rotation nearest to F = R S, S = R^T F symmetric (polar decomposition). Of a motion dR = R W(omega) with the
skew matrix W = sum_k omega_k E_k, and T_k = R E_k,

    omega = K^-1 (T_k : dF)_k,    K_kl = E_k : E_l S,

so that dR/dF = T^T K^-1 T. The second derivative, of M : R with M held, follows from the terms of second order in
skew(exp(-W) R^T F) = 0,

    d2(M : R) = L^T N L + L^T P + P^T L,    L = K^-1 T,
    P_k = R E_k Pi,    N_kl = sym(E_k E_l) : (Pi S + R^T M),    Pi = sum_k p_k E_k,    p = K^-1 (T_k : M)_k.

K has the sums of two singular values of F as eigenvalues. Where the body is flattened to a line, or turned inside out,
they may vanish, and R jumps; derivatives are bounded there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.rotations import nearest_rotations
from softprint.runtime.contact.carriers.rotation_kernels import GENERATORS, SQUARES, pulled_back, stretches
from softprint.runtime.lazy import lazy

# The least eigenvalue of K that derivatives are taken with; 2 at rest.
_FLATTEST = 0.1


@dataclass(frozen=True, eq=False)
class PointRotations:
    """R at m points with deformation gradients F (m, dim, dim)."""

    F: Array

    @lazy
    def value(self) -> Array:
        """R (m, dim, dim)."""
        return nearest_rotations(self.F)

    @lazy
    def slope(self) -> Array:
        """dR_ab/dF_cd (m, dim, dim, dim, dim)."""
        return (np.swapaxes(self._turned, 1, 2) @ self._spun).reshape(len(self.F), *2 * self.F.shape[1:])

    def pulled_back(self, moments: Array) -> Array:
        """d(M : R)/dF (m, dim, dim) of moments M (m, dim, dim)."""
        return pulled_back(self.value, self.inverse, moments)

    def curvature(self, moments: Array) -> Array:
        """The second derivative of M : R by F (m, dim, dim, dim, dim); moments: M (m, dim, dim)."""
        E, T, L = self._generators, self._turned, self._spun
        m, (n, dim) = len(moments), E.shape[:2]
        p = L @ moments.reshape(m, -1, 1)  # (m, n, 1)
        Pi = (p * E.reshape(n, -1)).sum(axis=1).reshape(m, dim, dim)
        P = (T.reshape(m, n, dim, dim) @ Pi[:, None]).reshape(m, n, -1)
        inner = Pi @ self._stretch + np.swapaxes(self.value, 1, 2) @ moments
        N = (inner.reshape(m, -1) @ SQUARES[dim].T).reshape(m, n, n)
        half = np.swapaxes(L, 1, 2) @ (0.5 * N @ L + P)
        return (half + np.swapaxes(half, 1, 2)).reshape(m, *2 * self.F.shape[1:])

    def by_rows(self, basis_gradient: Array) -> Array:
        """dR/drows (m, dim, dim, n_rows*dim); basis_gradient: (m, n_rows, dim), which gives dF."""
        m, n_rows, dim = basis_gradient.shape
        found = self.slope.reshape(m, dim**3, dim) @ basis_gradient.swapaxes(1, 2)  # (m, abc, r)
        return found.reshape(m, dim, dim, dim, n_rows).swapaxes(3, 4).reshape(m, dim, dim, -1)

    def bending(self, moments: Array, basis_gradient: Array) -> Array:
        """d2(sum_j M_j : R_j)/drows2 (n_rows*dim, n_rows*dim) of moments M (m, dim, dim); basis_gradient: see
        `by_rows`."""
        m, n_rows, dim = basis_gradient.shape
        by_F = self.curvature(moments).transpose(0, 2, 1, 3, 4).reshape(m, dim, dim**3)
        half = np.matmul(basis_gradient, by_F).reshape(m, n_rows * dim * dim, dim)
        left = half.transpose(1, 0, 2).reshape(n_rows * dim * dim, m * dim)
        whole = left @ basis_gradient.transpose(0, 2, 1).reshape(m * dim, n_rows)
        found = whole.reshape(n_rows, dim, dim, n_rows).transpose(0, 1, 3, 2)
        return found.reshape(n_rows * dim, n_rows * dim)

    @property
    def _generators(self) -> Array:
        """E (n, dim, dim)."""
        return GENERATORS[self.F.shape[1]]

    @property
    def inverse(self) -> Array:
        """K^-1 (m, n, n)."""
        return self._stretches[1]

    @property
    def _stretch(self) -> Array:
        """S (m, dim, dim)."""
        return self._stretches[0]

    @lazy
    def _stretches(self) -> tuple[Array, Array]:
        return stretches(self.value, self.F, _FLATTEST)

    @lazy
    def _turned(self) -> Array:
        """T (m, n, dim*dim)."""
        found = self.value[:, None] @ self._generators
        return found.reshape(*found.shape[:2], -1)

    @lazy
    def _spun(self) -> Array:
        """L (m, n, dim*dim): omega by dF."""
        return np.asarray(self.inverse @ self._turned)


def carried_along(turned: Array, v: Array) -> Array:
    """dA v (m*dim, n) of dA (m, dim, dim, n) and displacements v (m, dim)."""
    m, dim, _, n = turned.shape
    return np.asarray((v[:, None, None] @ turned).reshape(m * dim, n))


def pulled_back_along(turned: Array, f: Array) -> Array:
    """dA^T f (m*dim, n) of dA (m, dim, dim, n) and forces f (m, dim)."""
    m, dim, _, n = turned.shape
    found = f[:, None] @ turned.reshape(m, dim, dim * n)
    return np.asarray(found.reshape(m * dim, n))
