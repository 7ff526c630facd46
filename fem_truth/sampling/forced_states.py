"""States that random forces on a few handles bring about, for internal corrections.

A correction that is fitted to states has to know those that its body meets. Contact and springs move the body by
forces: one handle far, or several together. Handles that are moved at random by themselves, or all pulled at once,
hardly ever show such states, because stiff motions take large forces and a move of one handle is a small part of all.

    rows = retract(rest, alpha K^+ f),    K = X^T K_rest X,    X = U - G K_rest U,

with f a random force on a few handles, K the stiffness of the handles with all else in equilibrium, and alpha such that
the node that moves most moves by a given length.
"""

from __future__ import annotations

import numpy as np

from softprint.fem_truth.sampling.rotations import random_rotation
from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.cubature import dof_scale
from softprint.runtime.body.node_gradients import basis_gradient_at_nodes
from softprint.runtime.mechanics.compliance.null_space_compliance import NullSpaceCompliance, rest_stiffness

# How many handles bear a force, and how often; no more than there are.
_HANDLES = (1, 2, 3, 5, 10_000)
_SHARES = (0.3, 0.2, 0.15, 0.15, 0.2)
# The shortest move, as a share of the longest.
_SHORTEST = 0.1
# A state in which det F of the subspace is less than this at a node is moved half as far.
_LEAST_VOLUME = 0.05
# Eigenvalues below this share of the largest belong to rigid motions.
_RIGID = 1e-9


def forced_states(
    body: ReducedBody, count: int, longest: float, turned: bool, rng: np.random.Generator
) -> Array:
    """(count, n_rows, dim): moved from rest by forces, the node that moves most by up to `longest` [m] and no less than
    a tenth of that, or as much less as keeps the subspace from turning inside out at a node; turned: and then every
    way, as under gravity a correction depends on how the body lies."""
    handles = body.handles
    unit = dof_scale(body.mesh, handles)
    tangent = (handles.tangent(body.rest_rows) * unit).reshape(*body.rest_rows.shape, -1)
    moved = np.tensordot(body.basis, tangent, axes=1)  # (n_nodes, dim, n_dofs) of a unit of every coordinate
    compliance, dofs = _handle_compliance(body, moved), _dofs_of_handles(body)
    gradient = basis_gradient_at_nodes(body)
    found = []
    for _ in range(count):
        forced = rng.permutation(len(dofs))[: rng.choice(_HANDLES, p=_SHARES)]
        force = np.zeros(handles.n_dofs)
        for handle in forced:
            force[dofs[handle]] = rng.normal(size=len(dofs[handle]))
        change = compliance @ force
        most = np.linalg.norm(moved @ change, axis=1).max()
        length = longest * rng.uniform(_SHORTEST, 1.0)
        rows = handles.retract(body.rest_rows, unit * change * (length / most))
        while np.linalg.det(rows.T @ gradient).min() < _LEAST_VOLUME:
            length *= 0.5
            rows = handles.retract(body.rest_rows, unit * change * (length / most))
        found.append(rows @ random_rotation(body.dim, rng).T if turned else rows)
    return np.array(found)


def _handle_compliance(body: ReducedBody, moved: Array) -> Array:
    """K^+ (n_dofs, n_dofs), without rigid motions. moved: U (n_nodes, dim, n_dofs)."""
    stiffness, n_dofs = rest_stiffness(body), moved.shape[2]
    forces = (stiffness @ moved.reshape(-1, n_dofs)).reshape(moved.shape)
    settled = (moved - NullSpaceCompliance(body).solve(forces)).reshape(-1, n_dofs)
    values, vectors = np.linalg.eigh(settled.T @ (stiffness @ settled))
    kept = values > _RIGID * values[-1]
    return np.asarray((vectors[:, kept] / values[kept]) @ vectors[:, kept].T)


def _dofs_of_handles(body: ReducedBody) -> list[Array]:
    """The coordinates of every handle: points, then frames."""
    handles, dim = body.handles, body.dim
    every = np.arange(handles.n_dofs)
    points = list(every[: handles.n_points * dim].reshape(-1, dim))
    return points + [every[handles.dofs_of(frame.name)] for frame in handles.frames]
