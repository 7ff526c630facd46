"""Linear mechanics of a body at rest, all that corrections of ours know before anything is learned."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from runtime.arrays import Array
from runtime.body.body import ReducedBody
from runtime.mechanics.null_space_compliance import NullSpaceCompliance
from runtime.mechanics.static_condensation import StaticCondensation, compute_static_condensation
from runtime.mechanics.surface_compliance import SurfaceCompliance, compute_surface_compliance


class BodyMechanics(NamedTuple):
    """compliance: to forces on the surface; internal: to the reduced state and gravity, None where the body is taken
    for U q."""

    compliance: SurfaceCompliance
    internal: StaticCondensation | None


def compute_mechanics(
    body: ReducedBody,
    loads: int,
    internal: bool,
    gravity: Sequence[float] | Array | None = None,
    progress: Callable[[int], None] | None = None,
) -> BodyMechanics:
    """For at most so many loads. gravity: (dim,) [m/s^2]; progress: see `compute_surface_compliance`."""
    response = NullSpaceCompliance(body)
    return BodyMechanics(
        compute_surface_compliance(body, response, loads, progress),
        compute_static_condensation(body, gravity, response) if internal else None,
    )
