"""The contact correction by learned loads: u_X = F_X sum_j G_Xj phi_j (see `load_model.py` and
`compliance.py`).

The network runs on the loads in contact, some tens; what they do to the body is a matrix product. So the
field has the tail that the constraint demands at no extra cost, and its whole Jacobian costs about as much as
the field.
"""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from runtime.arrays import Array, IntArray
from runtime.body.body import ReducedBody
from runtime.body.material_points import MaterialPoints
from runtime.colliders.collider import Collider
from runtime.colliders.pose import RigidPose
from runtime.corrections.contact_loads import ContactLoads, ContactLoadsProbe
from runtime.corrections.contact_potential import ContactPotential
from runtime.corrections.correction import CorrectionField, Potential
from runtime.corrections.internal_response import InternalResponse
from runtime.corrections.load_model import LoadModel
from runtime.corrections.reach import Reach
from runtime.corrections.rest_mechanics import RestMechanics
from runtime.errors import SoftprintError


class ElasticContact:
    """Zero unless some load on the body is inside the collider. float32 as trained, or float64. mechanics: of the body,
    as it was trained with."""

    support: float = np.inf

    def __init__(
        self,
        name: str,
        model: LoadModel,
        body: ReducedBody,
        collider: Collider,
        mechanics: RestMechanics,
    ) -> None:
        if (model.dim, model.n_rows) != (body.dim, body.n_rows):
            raise SoftprintError(
                f"correction {name!r} is for a {model.dim}D body with {model.n_rows} handle rows, but body "
                f"{body.name!r} is {body.dim}D with {body.n_rows}: train it for this body"
            )
        self.name, self.collider = name, collider.name
        self.model = model.eval()
        self.mechanics = mechanics
        self.internal: InternalResponse | None = mechanics.internal
        options = model.options
        self.probe = ContactLoadsProbe(body, collider, mechanics, options.stiffness, options.band)
        self._nodes = cKDTree(body.mesh.points)
        self.potential: Potential | None = ContactPotential(self.probe.loads)

    def bind(self, points: MaterialPoints, reach: float | Array = np.inf) -> BoundElasticContact:
        """See `Correction.bind`. The points must be nodes of the body."""
        distance, nodes = self._nodes.query(points.rest)
        if len(points) and distance.max() > 0.0:
            raise SoftprintError(f"correction {self.name!r}: answers at nodes of the body only")
        return BoundElasticContact(self, points, np.asarray(nodes, dtype=np.int64), reach)


class BoundElasticContact:
    """An elastic contact correction at n nodes."""

    def __init__(
        self, correction: ElasticContact, points: MaterialPoints, nodes: IntArray, reach: float | Array
    ) -> None:
        self._model, self._probe = correction.model, correction.probe
        self._reach = Reach(points, reach)
        self._points = points
        self._compliance = correction.mechanics.compliance.at(nodes)

    def displacement(self, rows: Array, pose: RigidPose, turn: Array | None = None) -> Array:
        """u (n, dim) [m] in the world frame. turn: of the body, that of the rows by default."""
        displacement = np.zeros(self._points.rest.shape)
        contact = self._probe.measure(rows, pose, turn)
        if contact is None:
            return displacement
        with torch.no_grad():
            phi = self._model.loads(contact)
        given = self._given(contact, phi[..., None])
        within = self._within_reach(rows, pose)
        displacement[within] = (self._deformation(rows, within) @ given[within])[..., 0]
        return displacement

    def linearise(self, rows: Array, pose: RigidPose, turn: Array | None = None) -> CorrectionField:
        """u and du/drows, the turn held, of the points within reach; none where no load is inside the collider."""
        contact = self._probe.measure(rows, pose, turn)
        dim, n_rows = self._points.dim, rows.shape[0]
        if contact is None:
            return CorrectionField.empty(dim, n_rows)
        phi, slope = self._model.linearise(contact)
        within = self._within_reach(rows, pose)
        index = np.arange(len(self._points))[within]
        given = self._given(contact, torch.cat([phi[..., None], slope], dim=2))[within]
        carried = self._deformation(rows, within) @ given
        jacobian = carried[..., 1:].reshape(len(index), dim, n_rows, dim)
        # What moves with F at the point itself: dF_aj = dU_rj, the row's own component a.
        turned = (self._points.basis_gradient[within] @ given[..., :1])[..., 0]
        for axis in range(dim):
            jacobian[:, axis, :, axis] += turned
        return CorrectionField(index, carried[..., 0], jacobian)

    def _given(self, contact: ContactLoads, phi: Tensor) -> Array:
        """sum_j G_Xj phi_j (n, dim, k) for k sets of loads phi (m, dim, k)."""
        return self._compliance.apply(contact.index, phi.numpy()).astype(np.float64)

    def _deformation(self, rows: Array, index: IntArray | slice) -> Array:
        """F (n, dim, dim) in the world frame."""
        return np.asarray(rows.T @ self._points.basis_gradient[index])

    def _within_reach(self, rows: Array, pose: RigidPose) -> IntArray | slice:
        """Of the points; all of them as a slice, so that nothing large is copied."""
        if not self._reach.limited:
            return slice(None)
        z = self._points.basis @ self._probe.collider_rows(rows, pose)
        return self._reach.select(z, self._probe.collider)
