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
    energy, vectors = np.linalg.eigh(flat @ flat.T)
    energy, vectors = energy[::-1], vectors[:, ::-1]
    found = int(np.count_nonzero(energy > 1e-12 * energy[0])) if energy[0] > 0.0 else 0
    if found < count:
        raise SoftprintError(
            f"{count} principal components are asked for, but the {len(fields)} states have {found}: "
            "ask for fewer, or generate more states"
        )
    scale = np.sqrt(energy[:count])
    modes = ((vectors[:, :count] / scale).T @ flat).reshape(count, *fields.shape[1:]) / root
    return Components(modes, vectors[:, :count] * scale, float(energy[count:].clip(0.0).sum() / energy.sum()))
