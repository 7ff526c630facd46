"""How the body settles where the subspace cannot follow: its internal equilibrium, linear in the reduced state.

At a reduced state q the truth is not U q but U q + u, with u the free equilibrium in the null space of U (thesis
5.3.3, without contact). To first order about rest, with the null-space response G of `null_space_compliance.py`, the
stiffness K at rest and the lumped masses m,

    u = L (q - q_rest) + w g,        L = -G K U,    w = G m,

so that U + L are the modes of static condensation (Guyan 1965). L annihilates translations and infinitesimal
rotations, but calls a finite rotation strain. So at every node X a rotation R_X is taken out first, that of the body
around it (`corotation.py`),

    u_X = R_X [L_X (R_X^T q - q_rest) + w_X R_X^T g],

so that u turns with the body, and with the part of it that X belongs to. What happens far from X, beyond a joint, may
still be a large strain as seen from there, but L_X hardly feels it. The *turn*, the handle rows at which the rotations
are taken, is an argument everywhere: with it frozen, as within a time step, u is affine in q. All of this belongs to
the body and to gravity alone; nothing is learned.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array, IntArray
from runtime.body.body import ReducedBody
from runtime.body.handle_sparsity import HandleSparsity
from runtime.mechanics import static_condensation_kernels
from runtime.mechanics.corotation import Corotation, corotation_gradients
from runtime.mechanics.null_space_compliance import NullSpaceCompliance, rest_stiffness

_PREFIX = "internal."


@dataclass(frozen=True, eq=False)
class StaticCondensation:
    """u of n nodes of a body.

    modes: L (n, dim, n_rows, dim); weight: w (n, dim, dim) [s^2]; both float32, for every evaluation reads all of
    them. gravity: g (dim,) [m/s^2]; rest_rows: q_rest (n_rows, dim); turning: (n, dim, n_rows) [1/m], see
    `corotation_gradients`; positions: (n_rows,) 1 for rows that are positions, 0 for those of the rotations of
    frames, so that a translation t moves rows by positions (x) t.
    """

    modes: NDArray[np.floating[Any]]
    weight: NDArray[np.floating[Any]]
    gravity: Array
    rest_rows: Array
    turning: NDArray[np.floating[Any]]
    positions: Array

    def __len__(self) -> int:
        return len(self.modes)

    def turns(self, turn: Array) -> Array:
        """R (n, dim, dim) of the nodes at a turn (n_rows, dim)."""
        return self._turning.rotations(turn)

    @property
    def turns_as_one(self) -> bool:
        """Whether all nodes turn by one rotation."""
        return self._turning.alike

    def displacement(self, rows: Array, turn: Array, index: IntArray | None = None) -> Array:
        """u (m, dim) [m] of some of the nodes (all by default), world frame."""
        index = np.arange(len(self)) if index is None else index
        return static_condensation_kernels.displacement(
            self._felt,
            self.weight,
            index,
            self.centred(rows),
            self.at_rest,
            self.gravity,
            self.turns(turn),
        )

    def centred(self, rows: Array) -> Array:
        """Rows less their mean translation, which strains nothing and would only be rounded: a body may be far from
        where it began."""
        return np.asarray(rows - self.positions[:, None] * (self._mean @ rows))

    @cached_property
    def at_rest(self) -> Array:
        """The rows at rest, centred."""
        return self.centred(self.rest_rows)

    def derivative(self, turn: Array, index: IntArray | None = None) -> Array:
        """du_a/drows_rb (m, dim, n_rows, dim) of some of the nodes (all by default), the turn held; world frame."""
        index = np.arange(len(self)) if index is None else index
        return static_condensation_kernels.derivative(
            self._felt, index, self._mean, self.positions, self.turns(turn)
        )

    def pulled_back(self, forces: Array, turn: Array, index: IntArray) -> Array:
        """sum_k f_k . du_k/drows (n_rows, dim) [N] of forces f (m, dim) on some of the nodes, world frame."""
        return static_condensation_kernels.pulled_back(
            self._felt, index, self._mean, self.positions, self.turns(turn), forces
        )

    def unturned(self) -> Array:
        """The same (n, dim, n_rows, dim) of all nodes, none of them turned."""
        index, still = np.arange(len(self)), np.eye(len(self.gravity))
        turns = np.broadcast_to(still, (len(self), *still.shape))
        return static_condensation_kernels.derivative(self._felt, index, self._mean, self.positions, turns)

    def at(self, nodes: IntArray) -> StaticCondensation:
        """The response of some of the nodes, by their numbers here. For the same nodes it is the same response, which
        remembers how they turned last, whoever asked."""
        name = np.asarray(nodes, dtype=np.int64).tobytes()
        part = self._parts.get(name)
        if part is None:
            self._parts[name] = part = self._part(nodes)
        return part

    def _part(self, nodes: IntArray) -> StaticCondensation:
        modes, weight = np.ascontiguousarray(self.modes[nodes]), np.ascontiguousarray(self.weight[nodes])
        return replace(self, modes=modes, weight=weight, turning=self.turning[nodes])

    def under(self, gravity: Array) -> StaticCondensation:
        """The same body under another gravity (dim,) [m/s^2]."""
        return replace(self, gravity=gravity)

    @cached_property
    def _parts(self) -> WeakValueDictionary[bytes, StaticCondensation]:
        """Those that someone holds."""
        return WeakValueDictionary()

    @cached_property
    def _felt(self) -> static_condensation_kernels.FeltModes:
        """The modes that are not zero."""
        sets, of = np.unique(self.modes.any(axis=(1, 3)), axis=0, return_inverse=True)
        size, counts = self.modes.shape[1] ** 2, sets.sum(axis=1)
        first = np.concatenate([[0], np.cumsum(size * counts[of.ravel()])]).astype(np.int64)
        values = np.empty(first[-1], self.modes.dtype)
        for number, felt in enumerate(sets):
            nodes = np.flatnonzero(of.ravel() == number)
            blocks = self.modes[nodes][:, :, felt].transpose(0, 1, 3, 2).reshape(len(nodes), -1)
            values[first[nodes][:, None] + np.arange(blocks.shape[1])] = blocks
        start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        felt = np.nonzero(sets)[1].astype(np.int64)
        return static_condensation_kernels.FeltModes(values, first, of.ravel().astype(np.int64), start, felt)

    @cached_property
    def _mean(self) -> Array:
        """(n_rows,) the mean of rows that are positions."""
        return np.asarray(self.positions / self.positions.sum())

    @cached_property
    def _turning(self) -> Corotation:
        return Corotation(self.turning, self.positions)


def compute_static_condensation(
    body: ReducedBody, gravity: Sequence[float] | Array | None, response: NullSpaceCompliance
) -> StaticCondensation:
    """Of all nodes of the body: n_rows*dim + dim solves. gravity: (dim,) [m/s^2]; response: of the same body."""
    dim, size = body.dim, body.n_rows * body.dim
    identity = np.eye(dim)
    spread = np.einsum("nr,ab->narb", body.basis, identity).reshape(-1, size)
    forces = -(rest_stiffness(body) @ spread).reshape(body.n_nodes, dim, size)
    weights = body.node_mass[:, None, None] * identity
    modes = HandleSparsity(body).kept(response.solve(forces).reshape(body.n_nodes, dim, size))
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
    return {_PREFIX + field.name: getattr(response, field.name) for field in fields(response)}


def take_condensation(arrays: dict[str, Any]) -> StaticCondensation | None:
    """Takes the arrays (or torch tensors) of `condensation_arrays` out of those of a file; None where it has none."""
    names = [field.name for field in fields(StaticCondensation)]
    if not any(_PREFIX + name in arrays for name in names):
        return None
    own: Mapping[str, Any] = {name: np.asarray(arrays.pop(_PREFIX + name)) for name in names}
    return StaticCondensation(**own)
