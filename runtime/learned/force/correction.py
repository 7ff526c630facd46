"""The contact correction by learned forces: u_X = R_X sum_j (G_Xj phi_j + G~_Xj psi_j) (see `model.py` and
`runtime/mechanics/compliance/`).

The network is evaluated at the points in contact, some tens; the displacement by their forces is a matrix product. So
the far field satisfies the constraint of the null space at no extra cost. Dynamics does not use the correction: there
it uses the energy of condensed contact (`runtime/contact/condensed/`).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.material_points import MaterialPoints
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.contact.condensed.drawn_contact import turned
from softprint.runtime.contact.contact_force import FrictionForces
from softprint.runtime.contact.solver.solved_contact import SolvedContact
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.correction import require_body
from softprint.runtime.learned.force.contact_state import ContactMeasurement, shear_modulus
from softprint.runtime.learned.force.evaluation import ForceEvaluation
from softprint.runtime.learned.force.model import ForceModel
from softprint.runtime.mechanics.body_mechanics import BodyMechanics
from softprint.runtime.mechanics.compliance.surface_compliance import SurfaceCompliance


class ForceCorrection:
    """A `ContactCorrection`: zero unless some contact point of the body is inside the collider. float32 as trained, or
    float64. mechanics: of the body, those used in training."""

    def __init__(
        self,
        name: str,
        model: ForceModel,
        body: ReducedBody,
        collider: Collider,
        mechanics: BodyMechanics,
    ) -> None:
        require_body(name, model.dim, model.n_rows, body)
        self.name, self.collider, self.shape = name, collider.name, collider
        self.model, self.mechanics = model.eval(), mechanics
        self.law, self.band, self.learned = model.options.law, model.options.band, model.options.learned
        self._compliance, self._spread = mechanics.surface_compliance, mechanics.spread_compliance
        self._body = body

    def without_condensation(self) -> ForceCorrection:
        """See `ContactCorrection.without_condensation`."""
        mechanics = self.mechanics._replace(condensation=None)
        return ForceCorrection(self.name, self.model, self._body, self.shape, mechanics)

    def bind(self, points: MaterialPoints, contact: CondensedContact, name: str) -> BoundForceCorrection:
        """See `ContactCorrection.bind`. The points must be nodes of the body."""
        distance, nodes = cKDTree(self._body.mesh.points).query(points.rest)
        if len(points) and distance.max() > 0.0:
            raise SoftprintError(f"correction {self.name!r} is evaluated at nodes of the body only")
        measurement = ContactMeasurement(contact, name, self.shape, self.band, shear_modulus(self._body))
        at = np.asarray(nodes, dtype=np.int64)
        return BoundForceCorrection(
            ForceEvaluation(self.model), measurement, self._compliance.at(at), self._spread.at(at), points
        )


class BoundForceCorrection:
    """A force correction at n nodes; compliance, spread: of these nodes."""

    def __init__(
        self,
        model: ForceEvaluation,
        measurement: ContactMeasurement,
        compliance: SurfaceCompliance,
        spread: SurfaceCompliance,
        points: MaterialPoints,
    ) -> None:
        self._model, self._measurement = model, measurement
        self._compliance, self._spread = compliance, spread
        self._shape = points.rest.shape
        # In the precision of the model, as every evaluation reads all of it.
        gradient = points.basis_gradient.transpose(0, 2, 1).astype(model.dtype)
        self._gradient = np.ascontiguousarray(gradient)

    def confidence(self, solved: SolvedContact) -> float | None:
        """The factor in [0, 1] that reduces the correction outside the range of training; None without contact."""
        state = self._measurement.measure(solved)
        return None if state is None else self._model.confidence(state)

    def displacement(self, solved: SolvedContact, friction: FrictionForces | None = None) -> Array:
        """See `BoundContactCorrection`; zero where no point is inside the collider, but for friction."""
        state = self._measurement.measure(solved)
        if state is None and friction is None:
            return np.zeros(self._shape)
        parts = [] if friction is None else [(friction.nodes, friction.forces)]
        v = np.zeros(self._shape, dtype=self._model.dtype)
        if state is not None:
            nodes, both = state.loaded.to_nodes(state.index, self._model.forces(state))
            on_nodes, around = np.split(both, 2, axis=1)
            parts.append((nodes, on_nodes))
            v += self._spread.apply(nodes, around.astype(v.dtype))
        nodes, forces = map(np.concatenate, zip(*parts, strict=True))
        v += self._compliance.apply(nodes, forces.astype(v.dtype))
        return turned(v, self._gradient, solved.rows)
