"""Reduced integration: a few cells with weights stand for the whole body."""

from __future__ import annotations

from dataclasses import dataclass

from runtime.arrays import Array, IntArray


@dataclass(frozen=True, eq=False)
class Cubature:
    """cells: (m,) cell indices, ascending; weights: (m,) [m^dim], nonnegative: E = sum_i w_i Psi(F_i) (thesis eq. 3.13).

    energy_error, force_error: relative errors against full integration, measured when the body was built.
    """

    cells: IntArray
    weights: Array
    energy_error: float
    force_error: float
