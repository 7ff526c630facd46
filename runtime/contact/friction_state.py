"""What friction remembers within one step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from runtime.arrays import Array, IntArray
from runtime.colliders.pose import Poses
from runtime.contact import LaggedContact


@dataclass(frozen=True, eq=False)
class SlidingNodes:
    """k loads of a condensed contact as friction holds them: their normal forces, normals and anchors, and how they
    move, affine in the rows: position (k, dim) [m] at rows (n_rows, dim), motion (k, dim, n_rows*dim); index: (k,)
    their numbers."""

    lagged: LaggedContact
    rows: Array
    position: Array
    motion: Array
    index: IntArray

    def positions(self, rows: Array) -> Array:
        """y (k, dim) [m] at other rows, the dent carried along as it is."""
        return self.position + self.motion @ (rows - self.rows).ravel()


@dataclass
class FrictionState:
    """As the step of length time_step [s] began: surface, the surface samples (s, dim) [m], poses of the colliders, and
    settled, where the loads of condensed contacts were, see `Potential`. By collider: lagged, what friction holds fixed
    at surface samples, and sliding, at the loads of condensed contacts."""

    surface: Array
    poses: Poses
    time_step: float
    settled: Mapping[str, Callable[[IntArray], Array]]
    lagged: dict[str, LaggedContact] = field(default_factory=dict)
    sliding: dict[str, SlidingNodes] = field(default_factory=dict)
