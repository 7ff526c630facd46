"""Static condensation: the equilibrium displacement outside the subspace, linear in the reduced state.

The full-space equilibrium at a reduced state q is not U q but U q + u, with u in the null space of U (thesis 5.3.3,
without contact). To first order about rest, with the null-space compliance G of `null_space_compliance.py`, the
stiffness K at rest and the lumped masses m,

    u = L (q - q_rest) + w g,        L = -G K U,    w = G m,

so that U + L are the modes of static condensation (Guyan 1965). L annihilates translations and infinitesimal
rotations, but a finite rotation appears as strain. So at every node X the local rotation R_X of the body
(`corotation.py`) is removed first,

    u_X = R_X [L_X (R_X^T q - q_rest) + w_X R_X^T g],

so that u rotates with the part of the body that X belongs to. Far from X, beyond a joint, the strain in this frame may
still be large, but L_X hardly depends on it. With the rotations fixed at the frame rows, as within a time step, u is
affine in q: `StaticCondensation.corotated` gives that affine function. All of this depends on the body and on gravity
alone; what bent joints lack may be learned and added (`joint_settling.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.handle_sparsity import HandleSparsity
from softprint.runtime.body.handles import centred
from softprint.runtime.mechanics import static_condensation_kernels as kernels
from softprint.runtime.mechanics.compliance.null_space_compliance import NullSpaceCompliance, rest_stiffness
from softprint.runtime.mechanics.corotation import Corotation, corotation_gradients
from softprint.runtime.mechanics.joint_settling import JointSettling

_PREFIX = "condensation."
# In a file.
_ARRAYS = ("modes", "weight", "gravity", "rest_rows", "rotation_gradients", "affine_part")


@dataclass(frozen=True, eq=False)
class StaticCondensation:
    """u of n nodes of a body.

    modes: L (n, dim, n_rows, dim); weight: w (n, dim, dim) [s^2]; both float32, since every evaluation reads all of
    them. gravity: g (dim,) [m/s^2]; rest_rows: q_rest (n_rows, dim); rotation_gradients: (n, dim, n_rows) [1/m], see
    `corotation_gradients`; affine_part: (n_rows,), see `Handles.affine_part`: a translation t changes the rows by
    affine_part (x) t. settling: what is learned of bent joints, None for nothing.
    """

    modes: NDArray[np.floating[Any]]
    weight: NDArray[np.floating[Any]]
    gravity: Array
    rest_rows: Array
    rotation_gradients: NDArray[np.floating[Any]]
    affine_part: Array
    settling: JointSettling | None = None

    def __len__(self) -> int:
        return len(self.modes)

    def corotated(self, frame_rows: Array) -> CorotatedCondensation:
        """u as an affine function of the handle rows, with the rotations of frame rows (n_rows, dim), and what joints
        settle there."""
        rotations, settling = self.corotation.rotations(frame_rows), self.settling
        if settling is None:
            return CorotatedCondensation(self, rotations)
        settled = (rotations @ settling.displacement(frame_rows)[..., None])[..., 0]
        return CorotatedCondensation(self, rotations, settled)

    def centred(self, rows: Array) -> Array:
        """Rows less their mean translation."""
        return centred(rows, self.affine_part)

    def unrotated_jacobian(self) -> Array:
        """du/drows (n, dim, n_rows, dim) with all rotations the identity."""
        identity = np.eye(len(self.gravity))
        rotations = np.broadcast_to(identity, (len(self), *identity.shape))
        return CorotatedCondensation(self, rotations).jacobian()

    def at(self, nodes: IntArray) -> StaticCondensation:
        """The condensation of some of these nodes, by index."""
        return replace(
            self,
            modes=np.ascontiguousarray(self.modes[nodes]),
            weight=np.ascontiguousarray(self.weight[nodes]),
            rotation_gradients=self.rotation_gradients[nodes],
            settling=None if self.settling is None else self.settling.at(nodes),
        )

    def under(self, gravity: Array) -> StaticCondensation:
        """The same body under another gravity (dim,) [m/s^2]."""
        return self if np.array_equal(gravity, self.gravity) else replace(self, gravity=gravity)

    @cached_property
    def centred_rest_rows(self) -> Array:
        """q_rest less its mean translation (n_rows, dim)."""
        return self.centred(self.rest_rows)

    @cached_property
    def mean_weights(self) -> Array:
        """(n_rows,) weights of the mean translation of the rows."""
        return np.asarray(self.affine_part / self.affine_part.sum())

    @cached_property
    def corotation(self) -> Corotation:
        """The rotations of the nodes."""
        return Corotation(self.rotation_gradients, self.affine_part)

    @cached_property
    def sparse_modes(self) -> kernels.SparseModes:
        """The modes without the rows for which they are zero."""
        sets, of = np.unique(self.modes.any(axis=(1, 3)), axis=0, return_inverse=True)
        size, counts = self.modes.shape[1] ** 2, sets.sum(axis=1)
        first = np.concatenate([[0], np.cumsum(size * counts[of.ravel()])]).astype(np.int64)
        values = np.empty(first[-1], self.modes.dtype)
        for number, nonzero in enumerate(sets):
            nodes = np.flatnonzero(of.ravel() == number)
            blocks = self.modes[nodes][:, :, nonzero].transpose(0, 1, 3, 2).reshape(len(nodes), -1)
            values[first[nodes][:, None] + np.arange(blocks.shape[1])] = blocks
        start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        rows = np.nonzero(sets)[1].astype(np.int64)
        return kernels.SparseModes(values, first, of.ravel().astype(np.int64), start, rows)


@dataclass(frozen=True, eq=False)
class CorotatedCondensation:
    """u of n nodes with their rotations R (n, dim, dim) fixed: affine in the handle rows. Made once per step. settled:
    (n, dim) [m] what joints settle, world frame, None for nothing."""

    condensation: StaticCondensation
    rotations: Array
    settled: Array | None = None

    def displacement(self, rows: Array, index: IntArray | None = None) -> Array:
        """u (m, dim) [m] of some of the nodes (all by default) at handle rows (n_rows, dim), world frame."""
        own, some = self.condensation, self._some(index)
        u = kernels.displacement(
            own.sparse_modes,
            own.weight,
            some,
            own.centred(rows),
            own.centred_rest_rows,
            own.gravity,
            self.rotations,
        )
        return u if self.settled is None else u + self.settled[some]

    def jacobian(self, index: IntArray | None = None) -> Array:
        """du_a/drows_rb (m, dim, n_rows, dim) of some of the nodes (all by default), world frame."""
        own = self.condensation
        return kernels.derivative(
            own.sparse_modes, self._some(index), own.mean_weights, own.affine_part, self.rotations
        )

    def pulled_back(self, forces: Array, index: IntArray) -> Array:
        """sum_k f_k . du_k/drows (n_rows, dim) [N] of forces f (m, dim) [N] on some of the nodes, world frame."""
        own = self.condensation
        return kernels.pulled_back(
            own.sparse_modes, index, own.mean_weights, own.affine_part, self.rotations, forces
        )

    def _some(self, index: IntArray | None) -> IntArray:
        return np.arange(len(self.rotations)) if index is None else index


def compute_static_condensation(
    body: ReducedBody, gravity: Sequence[float] | Array | None, response: NullSpaceCompliance
) -> StaticCondensation:
    """The static condensation of all nodes of the body: n_rows*dim + dim solves. gravity: (dim,) [m/s^2]; response: of
    the same body."""
    dim, size = body.dim, body.n_rows * body.dim
    identity = np.eye(dim)
    basis = np.einsum("nr,ab->narb", body.basis, identity).reshape(-1, size)
    forces = -(rest_stiffness(body) @ basis).reshape(body.n_nodes, dim, size)
    weights = body.node_mass[:, None, None] * identity
    modes = HandleSparsity(body).sparsified(response.solve(forces).reshape(body.n_nodes, dim, size))
    return StaticCondensation(
        modes.astype(np.float32).reshape(body.n_nodes, dim, body.n_rows, dim),
        response.solve(weights).astype(np.float32),
        np.zeros(dim) if gravity is None else np.array(gravity, dtype=np.float64),
        body.rest_rows,
        corotation_gradients(body),
        body.handles.affine_part,
    )


def condensation_arrays(response: StaticCondensation) -> dict[str, NDArray[np.floating[Any]]]:
    """Named arrays for a correction file."""
    return {_PREFIX + name: getattr(response, name) for name in _ARRAYS}


def take_condensation(arrays: dict[str, Any]) -> StaticCondensation | None:
    """Removes the arrays of `condensation_arrays` from those of a file, and returns their
    condensation; None where the file has none."""
    if not any(_PREFIX + name in arrays for name in _ARRAYS):
        return None
    own: Mapping[str, Any] = {name: np.asarray(arrays.pop(_PREFIX + name)) for name in _ARRAYS}
    return StaticCondensation(**own)
