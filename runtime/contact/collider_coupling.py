"""Coupling between the body and freely moving colliders: the blocks of the joint Hessian beside the body's own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

from softprint.runtime.arrays import Array
from softprint.runtime.rigid.twist import touched_body_derivatives

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
