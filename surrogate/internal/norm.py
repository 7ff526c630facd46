"""The norm in which a correction is learned with its derivatives: elastic energy and volume, in equal parts.

    |r|^2 = (r . K r / <r . K r> + r . M r / <r . M r>) / 2,

with K the stiffness at rest, M the volumes of the nodes, and < > the mean over the training states: the mean of |r|^2
is one. The reduced forces of a corrected body are as good as its elastic energy, in which a small displacement can be a
large error; soft motions cost hardly any energy, and have volume.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mechanics.compliance.null_space_compliance import rest_stiffness


class CorrectionNorm:
    """The norm of displacements of a body; fields: r (s, n_nodes, dim) of the training states."""

    def __init__(self, body: ReducedBody, fields: Array) -> None:
        flat = fields.reshape(len(fields), -1)
        stiffness = rest_stiffness(body)
        mass = sp.diags(np.repeat(body.mesh.node_volumes, body.dim))
        by_energy, by_volume = (
            float(np.vdot(flat.T, part @ flat.T)) / len(flat) for part in (stiffness, mass)
        )
        if min(by_energy, by_volume) <= 0.0:
            raise SoftprintError("the states have no internal displacement: there is nothing to learn")
        self._matrix = (0.5 * (stiffness / by_energy + mass / by_volume)).tocsr()

    def squares(self, fields: Array) -> Array:
        """|r|^2 (s,) of fields (s, n_nodes, dim)."""
        flat = fields.reshape(len(fields), -1)
        return np.asarray(np.einsum("sn,ns->s", flat, self._matrix @ flat.T))

    def components(self, fields: Array, count: int) -> tuple[Array, float]:
        """The first principal components (count, n_nodes, dim) of fields (s, n_nodes, dim), orthonormal, and the share
        of |r|^2 beyond them. Raises SoftprintError if the fields have fewer."""
        flat = fields.reshape(len(fields), -1)
        gram = flat @ (self._matrix @ flat.T)
        energy, vectors = eigh(0.5 * (gram + gram.T))
        energy, vectors = energy[::-1], vectors[:, ::-1]
        found = int(np.count_nonzero(energy > 1e-12 * energy[0]))
        if found < count:
            raise SoftprintError(
                f"{count} principal components are asked for, but the {len(fields)} fields have {found}: "
                "ask for fewer, or generate more states"
            )
        modes = (vectors[:, :count] / np.sqrt(energy[:count])).T @ flat
        beyond = float(energy[count:].clip(0.0).sum() / energy.sum())
        return modes.reshape(count, *fields.shape[1:]), beyond

    def dual(self, components: Array) -> Array:
        """(count, n_nodes*dim): the products with a field are its coefficients."""
        return np.asarray((self._matrix @ components.reshape(len(components), -1).T).T)
