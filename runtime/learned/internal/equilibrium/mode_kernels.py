"""Compiled kernels for sums over modes. Modes are learned and kept in single precision; sums are in double precision,
from half the memory that matrices in double precision would be read from, which is what limits their speed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array
from softprint.runtime.compiled import summing

Singles = NDArray[np.float32]


@summing(reference=lambda modes, a: modes @ a)
def summed(modes: Singles, a: Array) -> Array:
    """sum_k m_ik a_k (n,) of modes m (n, K) and amplitudes a (K,)."""
    total = np.empty(len(modes))
    for i in range(len(modes)):
        value = 0.0
        for k in range(len(a)):
            value += modes[i, k] * a[k]
        total[i] = value
    return total


@summing(reference=lambda modes, forces: modes.T @ forces)
def along_modes(modes: Singles, forces: Array) -> Array:
    """sum_i m_ik f_i (K,) of modes m (n, K) and forces f (n,)."""
    total = np.zeros(modes.shape[1])
    for i in range(len(modes)):
        for k in range(len(total)):
            total[k] += modes[i, k] * forces[i]
    return total
