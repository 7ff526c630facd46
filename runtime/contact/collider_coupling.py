"""What body and freely moving colliders feel of each other: blocks of the joint Hessian beside the body's own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

from runtime.arrays import Array
from runtime.rigid.twist import felt_by_the_other

# Centres of mass (dim,) [m] of the colliders that move freely, by name, in the world.
Centres = Mapping[str, Array]


class Coupling(NamedTuple):
    """Of one collider, by name, with a twist (s, w) about its centre of mass (`runtime/rigid/twist.py`).

    gradient (n_twist,) of the energy by the twist; blocks: the mixed derivatives by rows and twist (n_rows*dim,
    n_twist) and the second ones by the twist (n_twist, n_twist), which only an iteration that goes on asks for.
    """

    name: str
    gradient: Array
    blocks: Callable[[], tuple[Array, Array]]


class Link(NamedTuple):
    """What two free colliders, by name, feel of each other through the body: the mixed derivatives of the energy by
    their twists (n_twist, n_twist)."""

    first: str
    second: str
    block: Callable[[], Array]


def point_coupling(name: str, arms: Array, gradient: Array, hessian: Array, motion: Array) -> Coupling:
    """Of touching points: arms (m, dim) from the centre, gradient (m, dim) and Hessian (m, dim, dim) at the points,
    and how these move with the rows, motion (m, dim, n_rows*dim)."""
    slope, pushed, own = felt_by_the_other(arms, gradient, hessian)
    m, dim, columns = motion.shape

    def blocks() -> tuple[Array, Array]:
        return motion.reshape(m * dim, columns).T @ pushed.reshape(m * dim, -1), own

    return Coupling(name, slope, blocks)
