"""The rotations R of the deformation at points, as smooth functions of the deformation gradient F.

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

    def pulled_back(self, moments: Array, scale: Array | None = None, slope: Array | None = None) -> Array:
        """d(M : s R)/dF (m, dim, dim) of moments M (m, dim, dim), with scales s (m,), and the slopes of log s by F (m,
        dim, dim); 1 and none by default."""
        s = np.ones(len(moments)) if scale is None else scale
        theta = np.zeros(moments.shape) if slope is None else slope
        return pulled_back(self.value, self.inverse, s, theta, moments)

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
