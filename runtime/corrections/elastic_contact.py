"""The contact correction by learned loads: u_X = F_X sum_j G_Xj phi_j (see `load_model.py` and
`compliance.py`).

The network runs on the loads in contact, some tens; what they do to the body is one matrix product. So the
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
from runtime.corrections.compliance import Compliance
from runtime.corrections.contact_loads import ContactLoads, LoadProbe
from runtime.corrections.contact_potential import ContactPotential
from runtime.corrections.correction import CorrectionField, Potential
from runtime.corrections.internal_response import InternalResponse
from runtime.corrections.load_model import LoadModel
from runtime.corrections.reach import Reach
from runtime.errors import SoftprintError


class ElasticContact:
    """Zero unless some surface sample of the reduced body penetrates. float32 as trained, or float64."""

    support: float = np.inf
    internal: InternalResponse | None = None

    def __init__(
        self, name: str, model: LoadModel, body: ReducedBody, collider: Collider, compliance: Compliance
    ) -> None:
        if (model.dim, model.n_rows) != (body.dim, body.n_rows):
            raise SoftprintError(
                f"correction {name!r} is for a {model.dim}D body with {model.n_rows} handle rows, but body "
                f"{body.name!r} is {body.dim}D with {body.n_rows}: train it for this body"
            )
        self.name, self.collider = name, collider.name
        self.model = model.eval()
        self.compliance = compliance
        self.probe = LoadProbe(body, collider, compliance, model.options.stiffness, model.options.band)
        self._nodes = cKDTree(body.mesh.points)
        loads = body.node_points(compliance.nodes)
        self.potential: Potential | None = ContactPotential(self.probe, loads.basis, loads.basis_gradient)

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
        self._basis, self._points = points.basis, points
        like = self._model.local_mean
        self._gradient = torch.from_numpy(points.basis_gradient).to(like)
        n, dim = points.rest.shape
        operator = correction.compliance.operator
        if not np.array_equal(nodes, np.arange(operator.shape[2])):
            # Load by load in memory: an evaluation reads whole loads.
            operator = np.ascontiguousarray(operator[:, :, nodes])
        self._operator = torch.from_numpy(operator).reshape(len(operator), dim, n, dim)
        self._everywhere = np.arange(n)

    def displacement(self, rows: Array, pose: RigidPose) -> Array:
        """u (n, dim) [m] in the world frame."""
        displacement = np.zeros(self._points.rest.shape)
        contact = self._probe.measure(rows, pose)
        if contact is None:
            return displacement
        with torch.no_grad():
            phi = self._model.loads(contact)
        index = self._within_reach(rows, pose)
        given = self._given(contact, index, phi[..., None])[..., 0]
        F = self._deformation(rows, index)
        displacement[index] = torch.einsum("nij,nj->ni", F, given).double().numpy()
        return displacement

    def linearise(self, rows: Array, pose: RigidPose) -> CorrectionField:
        """u and du/drows of the points within reach; none where the reduced body does not touch."""
        contact = self._probe.measure(rows, pose)
        dim, n_rows = self._points.dim, self._basis.shape[1]
        if contact is None:
            return CorrectionField.empty(dim, n_rows)
        phi, slope = self._model.linearise(contact)
        index = self._within_reach(rows, pose)
        given = self._given(contact, index, torch.cat([phi[..., None], slope], dim=2))
        carried = self._deformation(rows, index) @ given
        jacobian = carried[..., 1:].reshape(len(index), dim, n_rows, dim)
        # What moves with F at the point itself: dF_aj = dU_rj, the row's own component a.
        turned = torch.einsum("nrj,nj->nr", self._gradient_at(index), given[..., 0])
        jacobian.diagonal(dim1=1, dim2=3).add_(turned[..., None])
        return CorrectionField(index, carried[..., 0].double().numpy(), jacobian.double().numpy())

    def _given(self, contact: ContactLoads, index: IntArray, phi: Tensor) -> Tensor:
        """sum_j G_Xj phi_j (n, dim, k) at points `index`, for k sets of loads phi (m, dim, k)."""
        m, dim, k = phi.shape
        if k == 1 and len(index) == len(self._everywhere) and phi.dtype == self._operator.dtype:
            # Load by load from where it lies: to gather the rows of all loads first would cost twice as much.
            total = phi.new_zeros(len(index) * dim)
            for load, force in zip(contact.index.tolist(), phi[..., 0]):
                total.addmv_(self._operator[load].reshape(dim, -1).T, force)
            return total.reshape(len(index), dim, 1)
        rows = self._operator[torch.from_numpy(contact.index)]
        if len(index) < len(self._everywhere):
            rows = rows[:, :, torch.from_numpy(index)]
        rows = rows.to(phi).reshape(m * dim, -1)
        return (rows.T @ phi.reshape(m * dim, k)).reshape(len(index), dim, k)

    def _gradient_at(self, index: IntArray) -> Tensor:
        return (
            self._gradient if len(index) == len(self._gradient) else self._gradient[torch.from_numpy(index)]
        )

    def _deformation(self, rows: Array, index: IntArray) -> Tensor:
        """F (n, dim, dim) in the world frame."""
        return torch.matmul(torch.from_numpy(rows).to(self._gradient).T, self._gradient_at(index))

    def _within_reach(self, rows: Array, pose: RigidPose) -> IntArray:
        index = self._reach.select(self._basis @ self._probe.collider_rows(rows, pose), self._probe.collider)
        return self._everywhere if index is None else index
