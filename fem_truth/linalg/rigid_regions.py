"""Regions of nodes that move rigidly: where they go, and their displacements of first and second order.

A region at x_i = c + r_i, c the mean, moves by its twist (s, w): x_i' = c + s + exp([w]) r_i. With an orthonormal basis
T of what twists do to its nodes, and forces g_i on these,

    T a          displacements of first order, of the coordinates a of a twist
    T^T g        their forces
    T^T H T + K  their Hessian;  K = g_i . (E_k E_l + E_l E_k) r_i / 2 for rotations, because displacements of second
                 order do work

(`runtime.rigid.twist`). A region whose nodes are on a line, or a single one, has fewer modes than a twist has numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from softprint.fem_truth.linalg.small_blocks import positive_part
from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.body.rotations import nearest_rotations, rotated_by
from softprint.runtime.rigid.twist import generators, own_curvature, point_motion

# Rotations whose moment of inertia is below this share of the largest do not move the nodes of a region.
_NO_ARM = 1e-12


class RigidTangent(NamedTuple):
    """Motions of first order of all regions at one place. nodes: (k,); modes: T (k*dim, m), orthonormal; stiffness: K
    (m, m) [N/m]."""

    nodes: IntArray
    modes: sp.csr_matrix
    stiffness: Array

    def coordinates(self, v: Array) -> Array:
        """T^T v (m,), of a node vector v (n, dim or more)."""
        dim = self.modes.shape[0] // max(len(self.nodes), 1)
        return np.asarray(self.modes.T @ v[self.nodes, :dim].ravel())

    def displacement(self, coordinates: Array) -> Array:
        """T a (k, dim), of coordinates a (m,)."""
        return np.asarray(self.modes @ coordinates).reshape(len(self.nodes), -1)


class RigidRegions:
    """rest: (n_nodes, dim) positions [m]; regions: the nodes of each, distinct."""

    def __init__(self, rest: Array, regions: Sequence[IntArray]) -> None:
        self.nodes = np.concatenate([*regions, np.empty(0, dtype=np.int64)]).astype(np.int64)
        counts = np.array([len(nodes) for nodes in regions], dtype=np.int64)
        self._starts = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64)
        self._counts, self._of = counts, np.repeat(np.arange(len(counts)), counts)
        self._arms_at_rest = self._arms(rest)[1] if len(counts) else np.empty((0, rest.shape[1]))

    def __len__(self) -> int:
        return len(self._counts)

    def place(self, x: Array) -> Array:
        """x (n_nodes, dim) [m] with each region where it is nearest to it, rotated and moved from rest."""
        if not len(self):
            return x
        centres, arms = self._arms(x)
        turned = nearest_rotations(self._sums(arms[:, :, None] * self._arms_at_rest[:, None, :]))
        return self._placed(x, centres, turned, self._arms_at_rest)

    def moved(self, x: Array, step: Array) -> Array:
        """x + step (n_nodes, dim), with regions that turn as far as a step, rigid to first order, says."""
        reached = x + step
        if not len(self):
            return reached
        _, arms = self._arms(x)
        scaling, _ = self._rotations(arms)
        E = generators(x.shape[1])
        torques = self._sums(np.einsum("kij,nj,ni->nk", E, arms, step[self.nodes]))
        spins = np.einsum("fkm,flm,fl->fk", scaling, scaling, torques)
        turned = rotated_by(np.tile(np.eye(x.shape[1]), (len(self), 1, 1)), spins)
        centres = self._sums(reached[self.nodes]) / self._counts[:, None]
        return self._placed(reached, centres, turned, arms)

    def tangent(self, x: Array, forces: Array | None = None, convex: bool = False) -> RigidTangent:
        """At x, where each region is rigid. forces: g (n_nodes, dim) [N], by default none; convex: without the negative
        curvature of K."""
        dim, count = x.shape[1], len(self)
        _, arms = self._arms(x)
        scaling, present = self._rotations(arms)
        along = (
            np.broadcast_to(np.eye(dim), (len(arms), dim, dim))
            / np.sqrt(self._counts[self._of])[:, None, None]
        )
        about = point_motion(arms)[:, :, dim:] @ scaling[self._of]
        size = dim + scaling.shape[2]
        entries = np.concatenate([along, about], axis=2)
        columns = np.broadcast_to((self._of * size)[:, None, None] + np.arange(size), entries.shape)
        starts = np.arange(len(arms) * dim + 1) * size
        modes = sp.csr_matrix(
            (entries.ravel(), columns.ravel(), starts), shape=(len(arms) * dim, count * size)
        )
        stiffness = np.zeros((count, size, count, size))
        if forces is not None:
            for f in range(count):
                own = slice(self._starts[f], self._starts[f] + self._counts[f])
                curved = own_curvature(arms[own], forces[self.nodes[own]])[dim:, dim:]
                curved = scaling[f].T @ curved @ scaling[f]
                stiffness[f, dim:, f, dim:] = positive_part(curved[None])[0] if convex else curved
        kept = np.concatenate([np.ones((count, dim), dtype=bool), present], axis=1).ravel()
        K = stiffness.reshape(count * size, count * size)
        return RigidTangent(self.nodes, modes[:, kept], K[np.ix_(kept, kept)])

    def _arms(self, x: Array) -> tuple[Array, Array]:
        """Means (regions, dim) and positions from them (k, dim)."""
        centres = self._sums(x[self.nodes]) / self._counts[:, None]
        return centres, x[self.nodes] - centres[self._of]

    def _sums(self, values: Array) -> Array:
        """Over each region, of values (k, ...) at its nodes."""
        return np.asarray(np.add.reduceat(values, self._starts, axis=0))

    def _placed(self, x: Array, centres: Array, turned: Array, arms: Array) -> Array:
        x = x.copy()
        x[self.nodes] = centres[self._of] + np.einsum("nij,nj->ni", turned[self._of], arms)
        return x

    def _rotations(self, arms: Array) -> tuple[Array, BoolArray]:
        """S (regions, spin, spin): rotations E S of unit length about the principal axes; and which of them exist."""
        moving = point_motion(arms)[:, :, arms.shape[1] :]
        inertia, axes = np.linalg.eigh(self._sums(moving.swapaxes(1, 2) @ moving))
        present = inertia > _NO_ARM * np.maximum(inertia[:, -1:], np.finfo(float).tiny)
        scale = np.where(present, 1.0 / np.sqrt(np.where(present, inertia, 1.0)), 0.0)
        return axes * scale[:, None, :], present
