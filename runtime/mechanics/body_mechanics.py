"""Linear mechanics of a body at rest, which the reduced model adds to its subspace without any learning."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mechanics.compliance.null_space_compliance import NullSpaceCompliance
from softprint.runtime.mechanics.compliance.spread_compliance import compute_spread_compliance
from softprint.runtime.mechanics.compliance.surface_compliance import (
    SurfaceCompliance,
    compute_surface_compliance,
)
from softprint.runtime.mechanics.static_condensation import StaticCondensation, compute_static_condensation


class BodyMechanics(NamedTuple):
    """compliance: response to forces on the surface, None for penalty contact at the surface samples; condensation:
    response to the reduced state and gravity, None where the reduced positions are U q alone; spread: response to
    forces that are spread in the body under its contact nodes, which learned corrections use, None with no
    compliance; body_hash: `content_hash` of their body, empty where it is not known."""

    compliance: SurfaceCompliance | None
    condensation: StaticCondensation | None
    spread: SurfaceCompliance | None = None
    body_hash: str = ""

    @property
    def surface_compliance(self) -> SurfaceCompliance:
        """The compliance. Raises SoftprintError where there is none."""
        if self.compliance is None:
            raise SoftprintError(
                "these mechanics have no surface compliance: make them with `compute_mechanics`"
            )
        return self.compliance

    @property
    def spread_compliance(self) -> SurfaceCompliance:
        """The spread compliance. Raises SoftprintError where there is none."""
        if self.spread is None:
            raise SoftprintError(
                "these mechanics have no spread compliance: make them with `compute_mechanics`"
            )
        return self.spread

    def check_body(self, body: ReducedBody) -> None:
        """Raises SoftprintError for another body than theirs."""
        if self.body_hash and self.body_hash != body.content_hash:
            raise SoftprintError(
                f"these are the mechanics of another body (hash {self.body_hash[:12]}) than {body.name!r} "
                f"({body.content_hash[:12]}): compute them for this one"
            )

    def under(self, gravity: Array) -> BodyMechanics:
        """The same body under another gravity (dim,) [m/s^2]."""
        condensation = self.condensation
        return self if condensation is None else self._replace(condensation=condensation.under(gravity))


def compute_mechanics(
    body: ReducedBody,
    contact_nodes: int,
    condensation: bool,
    gravity: Sequence[float] | Array | None = None,
    progress: Callable[[int], None] | None = None,
) -> BodyMechanics:
    """The mechanics of a body. contact_nodes: the largest number of contact nodes; condensation: whether to compute
    static condensation; gravity: (dim,) [m/s^2]; progress: called with the number of columns done, of `n_columns` in
    all."""
    response = NullSpaceCompliance(body)
    surface = compute_surface_compliance(body, response, contact_nodes, progress)
    return BodyMechanics(
        surface,
        compute_static_condensation(body, gravity, response) if condensation else None,
        compute_spread_compliance(body, response, surface, progress),
        body.content_hash,
    )
