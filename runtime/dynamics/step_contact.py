"""What friction remembers within one step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from runtime.arrays import Array, IntArray
from runtime.contact import LaggedContact
from runtime.dynamics.corrected_points import Poses


@dataclass(frozen=True, eq=False)
class SlidingLoads:
    """k loads of a condensed contact as friction holds them: their normal forces, normals and anchors, and how they
    move, affine in the rows: position (k, dim) [m] at rows (n_rows, dim), motion (k, dim, n_rows*dim)."""

    lagged: LaggedContact
    rows: Array
    position: Array
    motion: Array

    def positions(self, rows: Array) -> Array:
        """y (k, dim) [m] at other rows, the dent carried along as it is."""
        return self.position + self.motion @ (rows - self.rows).ravel()


@dataclass
class StepContact:
    """surface: (s, dim) [m] the surface samples, rows: (n_rows, dim) the handle rows and poses those of the colliders,
    all as the step of length time_step [s] began. By collider: lagged, what friction holds fixed at surface samples,
    and sliding, at the loads of condensed contact; settled, where these loads were when the step began."""

    surface: Array
    rows: Array
    poses: Poses
    time_step: float
    lagged: dict[str, LaggedContact] = field(default_factory=dict)
    sliding: dict[str, SlidingLoads] = field(default_factory=dict)
    settled: dict[str, Callable[[IntArray], Array]] = field(default_factory=dict)
