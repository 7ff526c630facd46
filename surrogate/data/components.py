"""Principal components of displacement fields, in the norm of the volume (thesis 4.3.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.errors import SoftprintError


@dataclass(frozen=True, eq=False)
class Components:
    """modes: (k, n, dim), orthonormal: sum_i v_i m_ki . m_li = delta_kl; coefficients: (s, k) of the fields; discarded:
    the energy beyond them, sum over fields and nodes of v |r - sum_k c_k m_k|^2, as a share of the whole."""

    modes: Array
    coefficients: Array
    discarded: float


def principal_components(fields: Array, volumes: Array, count: int) -> Components:
    """The `count` components with the most energy of fields (s, n, dim) on nodes with volumes (n,), about zero.

    Raises SoftprintError if the fields have fewer.
    """
    root = np.sqrt(volumes)[:, None]
    flat = (fields * root).reshape(len(fields), -1)
    # Of the smaller of the two matrices with the same eigenvalues: over the fields, or over their values.
    of_fields = len(flat) <= flat.shape[1]
    energy, vectors = np.linalg.eigh(flat @ flat.T if of_fields else flat.T @ flat)
    energy, vectors = energy[::-1], vectors[:, ::-1]
    found = int(np.count_nonzero(energy > 1e-12 * energy[0])) if energy[0] > 0.0 else 0
    if found < count:
        raise SoftprintError(
            f"{count} principal components are asked for, but the {len(fields)} fields have {found}: "
            "ask for fewer, or generate more states or samples"
        )
    first = vectors[:, :count]
    directions = (first / np.sqrt(energy[:count])).T @ flat if of_fields else first.T
    modes = directions.reshape(count, *fields.shape[1:]) / root
    discarded = float(energy[count:].clip(0.0).sum() / energy.sum())
    return Components(modes, flat @ directions.T, discarded)
