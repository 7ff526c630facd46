"""Corotation: the rotation of each part of a deformed body, by which mechanics at rest is rotated.

The rotation at a rest point X is the polar factor of the deformation gradient of the subspace, F = rows^T grad U,
averaged over the surroundings of X,

    R_X = polar (rows^T G_X),    G - l^2 laplace G = grad U,    no flux through the surface,

within the body, so that a finger does not affect the finger beside it. For l = 0 this is the rotation of the point
itself, which is discontinuous between bone and flesh; for l = inf that of the body as a whole. The best length is about
0.4 of the distance between handles for every body tried, with a flat optimum. With it, the error of static condensation
against the internal equilibria of full space is 21 % on the Hand (229 % with one rotation for the whole body), 2.4 %
(2.4 %) on the Finger, 13.4 % (14.0 %) on the Ball and 2.2 % (2.5 %) on the Jelly (RMS, motions of the report).

Bodies with fewer than two frames get one rotation: their parts cannot rotate far relative to each other, and local
rotations would cost a fifth of a step.

Within a time step the rotations are fixed: they are taken at the handle rows of its start, the *frame rows*.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import SuperLU, splu

from softprint.runtime.arrays import Array, scatter_sum
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.handles import centred
from softprint.runtime.body.rotations import nearest_rotations
from softprint.runtime.linalg.row_products import deformed

# The length l, in distances of handles (V / n_handles)^(1/dim). From 0.3 to 0.6 little changes.
_LENGTH = 0.4


class Corotation:
    """The rotations of n parts of a body."""

    def __init__(self, gradients: NDArray[np.floating[Any]], affine_part: Array) -> None:
        """gradients: G^T (n, dim, n_rows) [1/m]; affine_part: (n_rows,), see `Handles.affine_part`."""
        self.uniform = bool((gradients == gradients[:1]).all())  # whether all parts have one rotation
        self._gradients = np.ascontiguousarray(gradients[:1] if self.uniform else gradients, dtype=np.float32)
        self._shape = len(gradients), gradients.shape[1], gradients.shape[1]
        self._affine_part = affine_part

    def rotations(self, rows: Array) -> Array:
        """R (n, dim, dim) at handle rows (n_rows, dim)."""
        without_translation = centred(rows, self._affine_part)
        return np.broadcast_to(nearest_rotations(deformed(self._gradients, without_translation)), self._shape)


def corotation_gradients(body: ReducedBody) -> NDArray[np.float32]:
    """G^T (n_nodes, dim, n_rows) [1/m] at the nodes of a body, in float32."""
    return local_gradients(body) if len(body.handles.frames) > 1 else mean_gradients(body)


def local_gradients(body: ReducedBody) -> NDArray[np.float32]:
    """Gradients for one rotation per node."""
    volume, gradients = _grad_U(body)
    return _by_node(body, _smoother(body, volume).solve(volume[:, None] * gradients))


def mean_gradients(body: ReducedBody) -> NDArray[np.float32]:
    """Gradients for one rotation of the whole body (l = inf)."""
    volume, gradients = _grad_U(body)
    return _by_node(body, np.broadcast_to(volume @ gradients / volume.sum(), gradients.shape))


def _grad_U(body: ReducedBody) -> tuple[Array, Array]:
    """The lumped volume of each node (n_nodes,) [m^3], and grad U there (n_nodes, dim*n_rows) [1/m]."""
    mesh, corners = body.mesh, body.dim + 1
    volume = scatter_sum(mesh.cells, np.repeat(mesh.cell_volumes / corners, corners), mesh.n_nodes)
    return volume, body.nodes_as_points.basis_gradient.transpose(0, 2, 1).reshape(mesh.n_nodes, -1)


def _by_node(body: ReducedBody, gradients: Array) -> NDArray[np.float32]:
    return np.asarray(gradients.reshape(body.n_nodes, body.dim, body.n_rows), dtype=np.float32)


def _smoother(body: ReducedBody, volume: Array) -> SuperLU:
    """1 - l^2 laplace, times the lumped volume of each node (n_nodes,) [m^3], factorised."""
    mesh, handles, corners = body.mesh, body.handles, body.dim + 1
    volumes = mesh.cell_volumes
    length = _LENGTH * (volumes.sum() / (handles.n_points + len(handles.frames))) ** (1.0 / body.dim)
    flux = np.einsum("c,caj,cbj->cab", volumes, mesh.cell_gradients, mesh.cell_gradients)
    row, column = np.repeat(mesh.cells, corners, axis=1).ravel(), np.tile(mesh.cells, (1, corners)).ravel()
    laplace = sp.coo_matrix((flux.ravel(), (row, column)), shape=(mesh.n_nodes, mesh.n_nodes))
    return splu(
        (sp.diags(volume) + length**2 * laplace).tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
