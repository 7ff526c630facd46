"""A body evaluated at one state: corrections, elasticity and contact, each computed once, at its first use.

Friction is not included, so that updating friction does not evaluate any of them again, but contact on the surface as
friction has displaced it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from softprint.runtime.arrays import Array, IntArray, RowHessian
from softprint.runtime.contact.condensed.contact_evaluation import ContactEvaluation
from softprint.runtime.contact.contact_force import FrictionForces
from softprint.runtime.contact.solver.warm_start import WarmStart
from softprint.runtime.dynamics.state import Configuration
from softprint.runtime.dynamics.step.frame import CorotatedFrame
from softprint.runtime.dynamics.terms.elastic import ElasticEvaluation
from softprint.runtime.dynamics.terms.frame_contact import FrameContactEvaluation
from softprint.runtime.dynamics.terms.kept_elastic_hessian import KeptHessian
from softprint.runtime.dynamics.terms.surface_contact import SurfaceContactEvaluation
from softprint.runtime.dynamics.timings import Timings
from softprint.runtime.elasticity.displacement_field import CorrectionField, WeightPoint
from softprint.runtime.lazy import lazy


@dataclass(eq=False)
class BodyEvaluation:
    """The body at a configuration in the frame of a step. warm_start: of the contact solve; kept_hessian: elastic, from
    a nearby state; after a call of `elastic_hessian`, the one that it used."""

    frame: CorotatedFrame
    at: Configuration
    warm_start: WarmStart | None
    kept_hessian: KeptHessian | None
    timings: Timings = field(repr=False)

    def near(self, at: Configuration) -> BodyEvaluation:
        """The body at another configuration, with the warm start from this one."""
        contact: ContactEvaluation | None = self.__dict__.get("contact")
        start = self.warm_start if contact is None else contact.warm_start
        other = BodyEvaluation(self.frame, at, start, self.kept_hessian, self.timings)
        if at.rows is self.at.rows and not self.frame.terms.points.corrected:
            # A change of poses alone changes neither positions nor elasticity.
            other.__dict__ |= {k: self.__dict__[k] for k in ("positions", "elastic") if k in self.__dict__}
        return other

    def under(self, friction: FrictionForces | None) -> BodyEvaluation:
        """The same with other known friction of condensed contact, the solve of which starts from that here."""
        start = None if self.contact is None else self.contact.warm_start
        other = BodyEvaluation(self.frame.under(friction), self.at, start, self.kept_hessian, self.timings)
        known = {k: v for k, v in self.__dict__.items() if k != "contact"}
        other.__dict__.update({**known, **other.__dict__})
        return other

    def displaced(self, friction: FrictionForces | None) -> BodyEvaluation:
        """The same as friction displaces it, under the pressure that was found without."""
        condensed, contact = self.frame.terms.condensed, self.contact
        if condensed is None or contact is None or contact.solved is None or friction is None:
            return self
        other, rows = self.under(friction), self.at.rows
        points = other.frame.contact_points
        assert points is not None  # there is condensed contact
        there = condensed.evaluation(points, rows, contact.solved).every.positions(rows, contact.solved.index)
        solved = replace(contact.solved, position=there)
        other.__dict__["contact"] = condensed.evaluation(points, rows, solved)
        return other

    @lazy
    def field(self) -> CorrectionField | None:
        """Displacements by field corrections with their Jacobians."""
        points = self.frame.terms.points
        return points.linearise(*self.at, self.timings.correction)

    @property
    def correction_converged(self) -> bool:
        """Whether the corrections found what they solve for."""
        return not self.frame.terms.points.without_jacobian or self.field is None or self.field.converged

    @lazy
    def displacement(self) -> Array | None:
        """Displacements by field corrections (n, dim) [m]."""
        points = self.frame.terms.points
        if "field" in self.__dict__ or points.without_jacobian:
            return points.scatter(self.field)
        return points.displacement(*self.at, self.timings.correction)

    @lazy
    def positions(self) -> Array:
        """(s, dim) [m] of the surface samples."""
        displacement = self.displacement
        with self.timings.positions:
            return self.frame.surface.positions(self.at.rows, displacement)

    @lazy
    def elastic(self) -> ElasticEvaluation:
        """Elasticity."""
        displacement = self.displacement
        with self.timings.elastic:
            return self.frame.elastic.evaluate(self.at.rows, displacement)

    @lazy
    def correction_weight(self) -> WeightPoint | None:
        """The work of gravity along an internal correction; None without one or without gravity."""
        weight = self.frame.terms.correction_weight
        if weight is None:
            return None
        with self.timings.correction:
            return weight.at(self.at.rows)

    @property
    def correction_height(self) -> float:
        """Its energy [J]."""
        return 0.0 if self.correction_weight is None else self.correction_weight.energy

    @lazy
    def surface(self) -> SurfaceContactEvaluation:
        """Penalty contact at the surface samples."""
        x, (rows, poses) = self.positions, self.at
        return self.frame.surface.evaluate(x, poses, rows, self.displacement)

    @lazy
    def contact(self) -> ContactEvaluation | None:
        """Condensed contact; None where no collider uses it."""
        condensed, points = self.frame.terms.condensed, self.frame.contact_points
        if condensed is None or points is None:
            return None
        with self.timings.contact:
            return condensed.evaluate(points, *self.at, self.warm_start)

    @lazy
    def frames(self) -> FrameContactEvaluation | None:
        """Contact of rigid frames; None where the body has none, or no condensed contact."""
        frames = self.frame.terms.frames
        return None if frames is None else frames.at(*self.at)

    def elastic_hessian(self, compute: RowHessian, free: IntArray, along: Array | None) -> Array:
        """The elastic Hessian, see `RowHessian`: the kept one while the strain has changed little, otherwise that of
        `compute`; free: (k,) the coordinates that the directions `along` change."""
        reuse = self.frame.terms.reuse
        # With a field correction B changes from state to state.
        if reuse is None or self.field is not None:
            return compute(along)
        self.kept_hessian = reuse.hessian(self.at.rows, free, along, compute, self.kept_hessian)
        return self.kept_hessian.hessian
