"""What the parts of a body are turned by: a finger by its bones, the flesh between two bones by half of each.

The rotation at a rest point X is the polar factor of the deformation gradient of the subspace, F = rows^T grad U, taken
as a mean over its surroundings,

    R_X = polar (rows^T G_X),    G - l^2 laplace G = grad U,    no flux through the surface,

within the body, so that a finger does not see the one beside it. For l = 0 that is the rotation of the point itself,
which jumps from bone to flesh; for l = inf that of the body as a whole. In between lies a length that is best, for
every body tried and by a flat optimum, at about 0.4 of the distance of handles. With it the internal response misses,
of the internal equilibria of full space (RMS; one turn for the whole body in brackets), on the motions of the report,
21 % (229 %) on the Hand, 2.4 % (2.4 %) on the Finger, 13.4 % (14.0 %) on the Ball and 2.2 % (2.5 %) on the Jelly.

A *turn* is handle rows (n_rows, dim), at which all these rotations are taken. It is an argument of all that asks for
them, and held within a time step.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from runtime.arrays import Array, scatter_sum
from runtime.body.body import ReducedBody
from runtime.body.rotations import nearest_rotations

# The length l, in distances of handles (V / n_handles)^(1/dim). From 0.3 to 0.6 little changes.
_LENGTH = 0.4


class Turning:
    """The rotations of n parts of a body."""

    def __init__(self, gradients: NDArray[np.floating[Any]], positions: Array) -> None:
        """gradients: G^T (n, dim, n_rows) [1/m]; positions: see `InternalResponse`."""
        # In double precision, so that turning everything turns them alike to round-off.
        self._gradients = np.ascontiguousarray(gradients, dtype=np.float64)
        self._positions, self._mean = positions, positions / positions.sum()
        self._last: tuple[Array, Array] | None = None

    def rotations(self, turn: Array) -> Array:
        """R (n, dim, dim) at a turn (n_rows, dim); those of the last one are kept, whichever thread asked."""
        last = self._last
        if last is None or not np.array_equal(last[0], turn):
            n, dim, n_rows = self._gradients.shape
            # Translations, which turn nothing, would only be rounded: a body may be far from where it began.
            centred = turn - np.outer(self._positions, self._mean @ turn)
            transposed = self._gradients.reshape(n * dim, n_rows) @ centred
            last = turn.copy(), nearest_rotations(transposed.reshape(n, dim, dim).transpose(0, 2, 1))
            self._last = last
        return last[1]


def turning_gradients(body: ReducedBody) -> NDArray[np.float32]:
    """G^T (n_nodes, dim, n_rows) [1/m] at the nodes of a body, in float32."""
    mesh, handles = body.mesh, body.handles
    volumes = mesh.cell_volumes
    length = _LENGTH * (volumes.sum() / (handles.n_points + len(handles.frames))) ** (1.0 / body.dim)
    corners = body.dim + 1
    around = scatter_sum(mesh.cells, np.repeat(volumes / corners, corners), mesh.n_nodes)
    flux = np.einsum("c,caj,cbj->cab", volumes, mesh.cell_gradients, mesh.cell_gradients)
    row, column = np.repeat(mesh.cells, corners, axis=1).ravel(), np.tile(mesh.cells, (1, corners)).ravel()
    laplace = sp.coo_matrix((flux.ravel(), (row, column)), shape=(mesh.n_nodes, mesh.n_nodes))
    factor = splu(
        (sp.diags(around) + length**2 * laplace).tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    gradients = body.nodes_as_points.basis_gradient.transpose(0, 2, 1).reshape(mesh.n_nodes, -1)
    smooth = factor.solve(around[:, None] * gradients)
    return np.asarray(smooth.reshape(mesh.n_nodes, body.dim, body.n_rows), dtype=np.float32)
