"""Assembles the terms of the energy of a body with its colliders, and chooses the contact model.

With a surface compliance, contact is condensed, except with colliders that have a field correction. With these, and
without a surface compliance, it is penalty contact at the surface samples.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.contact.condensed.condensed_friction import CondensedFriction
from softprint.runtime.contact.friction import CoulombFriction
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.dynamics.corrected_nodes import Corrections
from softprint.runtime.dynamics.corrected_points import CorrectedPoints
from softprint.runtime.dynamics.placed_collider import PlacedCollider
from softprint.runtime.dynamics.step.frame import BodyTerms
from softprint.runtime.dynamics.terms.condensed_elastic import CondensedElasticEnergy
from softprint.runtime.dynamics.terms.elastic import Elastic, ElasticEnergy
from softprint.runtime.dynamics.terms.frame_contact import FrameContact
from softprint.runtime.dynamics.terms.kept_elastic_hessian import HessianReuse
from softprint.runtime.dynamics.terms.surface_contact import SurfaceContactEnergy
from softprint.runtime.dynamics.terms.weight import Weight
from softprint.runtime.elasticity.displacement_field import InternalField
from softprint.runtime.learned.correction import ContactCorrection, FieldCorrection
from softprint.runtime.mechanics.body_mechanics import BodyMechanics

# A correction is assumed to displace surface samples by less than this fraction of the collider's size: samples farther
# from the collider than that need no correction.
_REACH = 0.25


def find_corrections(
    body: ReducedBody,
    colliders: Sequence[PlacedCollider],
    mechanics: BodyMechanics | None,
    contact: PenaltyContact,
    internal: InternalField | None = None,
) -> Corrections:
    """The corrections of a scene, and its condensed contact. internal: of the body."""
    fields: dict[str, FieldCorrection] = {}
    of_contact: dict[str, ContactCorrection] = {}
    for placed in colliders:
        if placed.correction is None:
            continue
        if isinstance(placed.correction, ContactCorrection):
            of_contact[placed.name] = placed.correction
        else:
            fields[placed.name] = placed.correction
    condensed = {placed.name: placed.collider for placed in colliders if placed.name not in fields}
    if mechanics is None or mechanics.compliance is None or not condensed:
        return Corrections(fields, of_contact, None, internal=internal)
    band = max((correction.band for correction in of_contact.values()), default=0.0)
    # Of the body: `check_colliders` has made sure that all are the same.
    learned = next((correction.learned for correction in of_contact.values()), None)
    solver = CondensedContact.of(body, mechanics, condensed, contact, band, learned, internal)
    return Corrections(fields, of_contact, solver, mechanics.compliance, internal)


def build_terms(
    body: ReducedBody,
    colliders: Sequence[PlacedCollider],
    corrections: Corrections,
    mechanics: BodyMechanics | None,
    contact: PenaltyContact,
    friction: CoulombFriction | None,
    gravity: Array,
) -> BodyTerms:
    """The terms of the energy of a body. gravity: (dim,) [m/s^2]."""
    condensation = None if mechanics is None else mechanics.condensation
    shapes = {placed.name: placed.collider for placed in colliders}
    sizes = [shapes[name].size for name in corrections.fields if np.isfinite(shapes[name].size)]
    reach = _REACH * max(sizes, default=np.inf)
    solver = corrections.contact
    penalised = {name: s for name, s in shapes.items() if solver is None or name not in solver.searches}
    points = CorrectedPoints(
        body, list(corrections.fields.items()), reach, corrections.internal, surface=bool(penalised)
    )
    elastic: Elastic = (
        ElasticEnergy(body, points)
        if condensation is None
        else CondensedElasticEnergy(body, points, condensation)
    )
    return BodyTerms(
        points=points,
        weight=Weight(body, gravity, condensation),
        elastic=elastic,
        reuse=HessianReuse.if_expensive(elastic, body.reduced_elasticity),
        surface=SurfaceContactEnergy(body, points, penalised, contact, friction, condensation),
        condensed=solver,
        frames=FrameContact(body, solver.colliders, contact)
        if solver is not None and body.handles.frames
        else None,
        condensed_friction=None if friction is None or solver is None else CondensedFriction(friction),
        correction_weight=None
        if corrections.internal is None or not gravity.any()
        else corrections.internal.weight(body.node_mass, gravity),
    )
