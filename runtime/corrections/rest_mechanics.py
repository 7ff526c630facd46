"""Linear mechanics of a body at rest, all that corrections of ours know before anything is learned."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from runtime.arrays import Array
from runtime.body.body import ReducedBody
from runtime.corrections.compliance import Compliance, compute_compliance
from runtime.corrections.internal_response import InternalResponse, compute_internal_response
from runtime.corrections.rest_response import RestResponse


class RestMechanics(NamedTuple):
    """compliance: to forces on the surface; internal: to the reduced state and gravity, None where the body is taken
    for U q."""

    compliance: Compliance
    internal: InternalResponse | None


def compute_rest_mechanics(
    body: ReducedBody,
    loads: int,
    internal: bool,
    gravity: Sequence[float] | Array | None = None,
    progress: Callable[[int], None] | None = None,
) -> RestMechanics:
    """For at most so many loads. gravity: (dim,) [m/s^2]; progress: see `compute_compliance`."""
    response = RestResponse(body)
    return RestMechanics(
        compute_compliance(body, response, loads, progress),
        compute_internal_response(body, gravity, response) if internal else None,
    )
