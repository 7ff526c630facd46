"""The contact correction by learned loads: u_X = F_X sum_j G_Xj phi_j (see `model.py` and
`surface_compliance.py`).

The network runs on the loads in contact, some tens; what they do to the body is a matrix product. So the
field has the tail that the constraint demands at no extra cost. Dynamics does without it: there the energy of
contact stands for it (`contact_potential.py`).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from runtime.arrays import Array, IntArray
from runtime.body.body import ReducedBody
from runtime.body.material_points import MaterialPoints
from runtime.colliders.collider import Collider
from runtime.colliders.pose import RigidPose
from runtime.contact.condensed.contact_potential import ContactPotential
from runtime.contact.condensed.joint_press import JointPress
from runtime.errors import SoftprintError
from runtime.learned.correction import Potential, require_body
from runtime.learned.force.contact_state import ContactStateProbe, UnmeasuredContact
from runtime.learned.force.evaluation import ForceEvaluation
from runtime.learned.force.model import ForceModel
from runtime.mechanics.body_mechanics import BodyMechanics
from runtime.mechanics.static_condensation import StaticCondensation
from runtime.mechanics.surface_compliance_kernels import turned


class ForceCorrection:
    """Zero unless some load on the body is inside the collider. float32 as trained, or float64. mechanics: of the body,
    as it was trained with. It remembers where contact came from, so that simulators need one each."""

    support: float = np.inf

    def __init__(
        self,
        name: str,
        model: ForceModel,
        body: ReducedBody,
        collider: Collider,
        mechanics: BodyMechanics,
    ) -> None:
        require_body(name, model.dim, model.n_rows, body)
        self.name, self.collider = name, collider.name
        self.model = model.eval()
        self.mechanics = mechanics
        self.internal: StaticCondensation | None = mechanics.internal
        options = model.options
        self.probe = ContactStateProbe(body, collider, mechanics, options.stiffness, options.band)
        self._nodes = cKDTree(body.mesh.points)
        self.potential: Potential | None = ContactPotential(self.probe.loads)

    def bind(self, points: MaterialPoints) -> BoundForceCorrection:
        """See `Correction.bind`. The points must be nodes of the body."""
        distance, nodes = self._nodes.query(points.rest)
        if len(points) and distance.max() > 0.0:
            raise SoftprintError(f"correction {self.name!r}: answers at nodes of the body only")
        return BoundForceCorrection(self, points, np.asarray(nodes, dtype=np.int64))


class BoundForceCorrection:
    """An elastic contact correction at n nodes."""

    def __init__(self, correction: ForceCorrection, points: MaterialPoints, nodes: IntArray) -> None:
        self._model, self._probe = ForceEvaluation(correction.model), correction.probe
        self._points = points
        self._compliance = correction.mechanics.compliance.at(nodes)
        # In the precision of the model, as an evaluation reads all of it.
        gradient = points.basis_gradient.transpose(0, 2, 1).astype(self._model.dtype)
        self._gradient = np.ascontiguousarray(gradient)

    def begin(self) -> None:
        """See `FollowsContact`."""
        self._probe.begin()

    def lead(self, rows: Array, pose: RigidPose) -> None:
        """See `FollowsContact`."""
        self._probe.lead(rows, pose)

    def displacement(self, rows: Array, pose: RigidPose, turn: Array | None = None) -> Array:
        """u (n, dim) [m] in the world frame; zero where no load is inside the collider. turn: of the body, that of the
        rows by default."""
        return self.drawn(self.pressed(None, rows, pose, turn))

    def pressed(
        self, joint: JointPress | None, rows: Array, pose: RigidPose, turn: Array | None = None
    ) -> UnmeasuredContact | None:
        """See `BoundPressed`."""
        return self._probe.pressed(rows, pose, turn, joint)

    def drawn(self, loads: UnmeasuredContact | None) -> Array:
        """See `BoundPressed`."""
        if loads is None:
            return np.zeros(self._points.rest.shape)
        contact = self._probe.measured(loads)
        given = self._compliance.apply(contact.index, self._model.loads(contact))
        return turned(given, self._gradient, loads.rows.astype(given.dtype))
