"""The corotated frame of a step: mechanics at rest, rotated by the rotations of the body at the start of the step.

It is made once, from the handle rows at which the step starts. In it the positions of nodes are affine in the handle
rows, so that every derivative within the step is exact. Its parts are computed at their first use.
"""

from __future__ import annotations

from dataclasses import dataclass

from softprint.runtime.arrays import Array
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.contact.condensed.condensed_friction import CondensedFriction
from softprint.runtime.contact.contact_force import FrictionForces
from softprint.runtime.contact.solver.contact_points import CorotatedPoints
from softprint.runtime.contact.solver.given_displacement import GivenDisplacement
from softprint.runtime.dynamics.corrected_points import CorrectedPoints
from softprint.runtime.dynamics.terms.elastic import Elastic, ElasticInFrame
from softprint.runtime.dynamics.terms.frame_contact import FrameContact
from softprint.runtime.dynamics.terms.kept_elastic_hessian import HessianReuse
from softprint.runtime.dynamics.terms.surface_contact import SurfaceContactEnergy, SurfaceInFrame
from softprint.runtime.dynamics.terms.weight import Weight
from softprint.runtime.elasticity.displacement_field import CorrectionWeight
from softprint.runtime.lazy import lazy


@dataclass(frozen=True, eq=False)
class BodyTerms:
    """The terms of the energy of a body, besides inertia and springs. condensed, condensed_friction: None without
    condensed contact; frames: None without it or without rigid frames; reuse: None where the elastic Hessian is
    computed in every iteration; correction_weight: of an internal correction, None without one or without gravity."""

    points: CorrectedPoints
    weight: Weight
    elastic: Elastic
    reuse: HessianReuse | None
    surface: SurfaceContactEnergy
    condensed: CondensedContact | None
    condensed_friction: CondensedFriction | None
    frames: FrameContact | None
    correction_weight: CorrectionWeight | None = None

    def in_frame(self, frame_rows: Array, friction: FrictionForces | None = None) -> CorotatedFrame:
        """See `CorotatedFrame`."""
        return CorotatedFrame(self, frame_rows, friction)


@dataclass(frozen=True, eq=False)
class CorotatedFrame:
    """The terms of a body in the frame of handle rows (n_rows, dim). friction: known friction of condensed contact,
    which displaces the contact points, None for none."""

    terms: BodyTerms
    rows: Array
    friction: FrictionForces | None = None

    def under(self, friction: FrictionForces | None) -> CorotatedFrame:
        """The same frame with other known friction."""
        other = CorotatedFrame(self.terms, self.rows, friction)
        shared = ("weight", "elastic", "surface", "_undisplaced")
        other.__dict__.update({name: value for name, value in self.__dict__.items() if name in shared})
        return other

    @lazy
    def weight(self) -> tuple[Array, float]:
        """See `Weight.form`."""
        return self.terms.weight.form(self.rows)

    @lazy
    def elastic(self) -> ElasticInFrame:
        """Elasticity."""
        return self.terms.elastic.in_frame(self.rows)

    @lazy
    def surface(self) -> SurfaceInFrame:
        """The surface samples."""
        return self.terms.surface.in_frame(self.rows)

    @lazy
    def contact_points(self) -> CorotatedPoints | None:
        """The points of condensed contact."""
        condensed, points = self.terms.condensed, self._undisplaced
        if condensed is None or points is None or self.friction is None:
            return points
        return points.displaced(GivenDisplacement(condensed.of_nodes, *self.friction[:2]))

    @lazy
    def _undisplaced(self) -> CorotatedPoints | None:
        """These without known friction."""
        condensed = self.terms.condensed
        return None if condensed is None else condensed.in_frame(self.rows)
