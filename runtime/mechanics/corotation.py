"""What the parts of a body are turned by: a finger by its bones, the flesh between two bones by half of each.

The rotation at a rest point X is the polar factor of the deformation gradient of the subspace, F = rows^T grad U, taken
as a mean over its surroundings,

    R_X = polar (rows^T G_X),    G - l^2 laplace G = grad U,    no flux through the surface,

within the body, so that a finger does not see the one beside it. For l = 0 that is the rotation of the point itself,
which jumps from bone to flesh; for l = inf that of the body as a whole. In between lies a length that is best, for
every body tried and by a flat optimum, at about 0.4 of the distance of handles. With it the internal response misses,
of the internal equilibria of full space (RMS; one turn for the whole body in brackets), on the motions of the report,
21 % (229 %) on the Hand, 2.4 % (2.4 %) on the Finger, 13.4 % (14.0 %) on the Ball and 2.2 % (2.5 %) on the Jelly.

What gains so little is not worth a fifth of the time of a step: bodies with no two frames, whose parts cannot turn far
against each other, are turned as one.

A *turn* is handle rows (n_rows, dim), at which all these rotations are taken. It is an argument of all that asks for
them, and held within a time step.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import SuperLU, splu

from runtime.arrays import Array, same, scatter_sum
from runtime.body.body import ReducedBody
from runtime.body.rotations import nearest_rotations
from runtime.linalg.row_products import deformed

# The length l, in distances of handles (V / n_handles)^(1/dim). From 0.3 to 0.6 little changes.
_LENGTH = 0.4


class Corotation:
    """The rotations of n parts of a body."""

    def __init__(self, gradients: NDArray[np.floating[Any]], positions: Array) -> None:
        """gradients: G^T (n, dim, n_rows) [1/m]; positions: see `StaticCondensation`."""
        self.alike = bool((gradients == gradients[:1]).all())  # whether all of them are one rotation
        self._gradients = np.ascontiguousarray(gradients[:1] if self.alike else gradients, dtype=np.float32)
        self._shape = len(gradients), gradients.shape[1], gradients.shape[1]
        self._positions, self._mean = positions, positions / positions.sum()
        self._last: tuple[Array, Array] | None = None

    def rotations(self, turn: Array) -> Array:
        """R (n, dim, dim) at a turn (n_rows, dim); those of the last one are kept, whichever thread asked."""
        last = self._last
        if last is None or not same(last[0], turn):
            # Translations, which turn nothing, would only be rounded: a body may be far from where it began.
            centred = turn - np.outer(self._positions, self._mean @ turn)
            found = nearest_rotations(deformed(self._gradients, centred))
            self._last = last = turn.copy(), np.broadcast_to(found, self._shape)
        return last[1]


def corotation_gradients(body: ReducedBody) -> NDArray[np.float32]:
    """G^T (n_nodes, dim, n_rows) [1/m] at the nodes of a body, in float32."""
    return local_gradients(body) if len(body.handles.frames) > 1 else mean_gradients(body)


def local_gradients(body: ReducedBody) -> NDArray[np.float32]:
    """Of every part its own."""
    around, gradients = _grad_U(body)
    return _by_node(body, _smoother(body, around).solve(around[:, None] * gradients))


def mean_gradients(body: ReducedBody) -> NDArray[np.float32]:
    """l = inf."""
    around, gradients = _grad_U(body)
    return _by_node(body, np.broadcast_to(around @ gradients / around.sum(), gradients.shape))


def _grad_U(body: ReducedBody) -> tuple[Array, Array]:
    """The volume around each node (n_nodes,) [m^3], and grad U there (n_nodes, dim*n_rows) [1/m]."""
    mesh, corners = body.mesh, body.dim + 1
    around = scatter_sum(mesh.cells, np.repeat(mesh.cell_volumes / corners, corners), mesh.n_nodes)
    return around, body.nodes_as_points.basis_gradient.transpose(0, 2, 1).reshape(mesh.n_nodes, -1)


def _by_node(body: ReducedBody, gradients: Array) -> NDArray[np.float32]:
    return np.asarray(gradients.reshape(body.n_nodes, body.dim, body.n_rows), dtype=np.float32)


def _smoother(body: ReducedBody, around: Array) -> SuperLU:
    """1 - l^2 laplace, times the volume around (n_nodes,) [m^3] each node, factorised."""
    mesh, handles, corners = body.mesh, body.handles, body.dim + 1
    volumes = mesh.cell_volumes
    length = _LENGTH * (volumes.sum() / (handles.n_points + len(handles.frames))) ** (1.0 / body.dim)
    flux = np.einsum("c,caj,cbj->cab", volumes, mesh.cell_gradients, mesh.cell_gradients)
    row, column = np.repeat(mesh.cells, corners, axis=1).ravel(), np.tile(mesh.cells, (1, corners)).ravel()
    laplace = sp.coo_matrix((flux.ravel(), (row, column)), shape=(mesh.n_nodes, mesh.n_nodes))
    return splu(
        (sp.diags(around) + length**2 * laplace).tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
