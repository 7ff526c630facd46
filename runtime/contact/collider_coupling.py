"""Coupling between the body and freely moving colliders: the blocks of the joint Hessian beside the body's own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from softprint.runtime.arrays import Array
from softprint.runtime.rigid.twist import (
    point_motion,
    relative_curvature,
    rotation_derivatives,
    touched_body_derivatives,
)

# Centres of mass (dim,) [m] of the colliders that move freely, by name, in the world.
Centres = Mapping[str, Array]


class Coupling(NamedTuple):
    """Derivatives of the energy by the twist (s, w) of one named collider about its centre of mass
    (`runtime/rigid/twist.py`).

    gradient: (n_twist,); blocks: computes the mixed second derivatives by rows and twist (n_rows*dim, n_twist) and the
    second derivatives by the twist (n_twist, n_twist). It is called only where a Hessian is needed.
    """

    name: str
    gradient: Array
    blocks: Callable[[], tuple[Array, Array]]


class Link(NamedTuple):
    """Coupling of two named free colliders through the body: the mixed derivatives of the energy by their twists
    (n_twist, n_twist)."""

    first: str
    second: str
    block: Callable[[], Array]


def point_coupling(name: str, arms: Array, gradient: Array, hessian: Array, motion: Array) -> Coupling:
    """The coupling by m points in contact. arms: (m, dim) from the centre; gradient (m, dim) and hessian (m, dim, dim)
    of the energy at the points; motion: (m, dim, n_rows*dim) derivatives of the points by the rows."""
    slope, pushed, own = touched_body_derivatives(arms, gradient, hessian)
    m, dim, columns = motion.shape

    def blocks() -> tuple[Array, Array]:
        return motion.reshape(m * dim, columns).T @ pushed.reshape(m * dim, -1), own

    return Coupling(name, slope, blocks)


def twist_gradient(arms: Array, gradient: Array) -> Array:
    """(n_twist,) of an energy with gradient (k, dim) by nodes at arms (k, dim) from the centre of the collider: moving
    the collider is moving the nodes the other way."""
    return -np.einsum("ka,kat->t", gradient, point_motion(arms))


def node_coupling(
    name: str, arms: Array, gradient: Array, hessian: Array | sp.csr_matrix, jacobian: Array | None = None
) -> Coupling:
    """The coupling by contact that couples k nodes with each other. arms: (k, dim) from the centre; gradient (k, dim)
    and hessian (k*dim, k*dim) by the nodes; jacobian: (k*dim, n_rows*dim) of the nodes by the rows, None where the rows
    are these nodes. The forces on the nodes turn with the collider."""
    motion = point_motion(arms)
    motion = motion.reshape(arms.size, motion.shape[2])

    def blocks() -> tuple[Array, Array]:
        against = hessian @ motion
        pushed = rotation_derivatives(gradient).reshape(motion.shape) - against
        own = motion.T @ against + relative_curvature(arms, gradient)
        return pushed if jacobian is None else jacobian.T @ pushed, own

    return Coupling(name, twist_gradient(arms, gradient), blocks)
