"""The contact-centric correction of thesis chapter 5 at run time: a trained `ContactCentricModel` on a body and a
collider."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.material_points import MaterialPoints
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.elasticity.displacement_field import CorrectionField
from softprint.runtime.learned.contact_patch import ContactProbe, Patch
from softprint.runtime.learned.correction import require_body
from softprint.runtime.learned.point_states import PointStates, PointTensors
from softprint.runtime.learned.reach import Reach
from softprint.runtime.learned.thesis5.model import ContactCentricModel


class ContactCentricCorrection:
    """u(X) = R r(z, T^-1 q) (thesis eq. 5.2). Zero unless some surface sample of the reduced body penetrates.

    The model may be float32, as trained, or float64 (`model.double()`), for finite differences.
    """

    support: float = np.inf

    def __init__(self, name: str, model: ContactCentricModel, body: ReducedBody, collider: Collider) -> None:
        require_body(name, model.dim, model.n_rows, body)
        self.name, self.collider = name, collider.name
        self.model = model.eval()
        self.probe = ContactProbe(body, collider)

    def bind(self, points: MaterialPoints, reach: float | Array = np.inf) -> BoundContactCentric:
        """See `FieldCorrection.bind`."""
        return BoundContactCentric(self, points, reach)


@dataclass(frozen=True, eq=False)
class _Contact:
    """The data of one evaluation: the patch, and the states of the active points."""

    patch: Patch
    index: IntArray
    state: PointStates
    rotation: Tensor


class BoundContactCentric:
    """A contact-centric correction at n material points."""

    def __init__(
        self, correction: ContactCentricCorrection, points: MaterialPoints, reach: float | Array
    ) -> None:
        self._model, self._probe = correction.model, correction.probe
        self._basis, self._reach = points.basis, Reach(points, reach)
        self._points = PointTensors.of(points, self._model.output_scale)

    def displacement(self, rows: Array, pose: RigidPose) -> Array:
        """u (n, dim) [m] in the world frame."""
        displacement = np.zeros((len(self._basis), self._model.dim))
        contact = self._contact(rows, pose)
        if contact is not None:
            shared, depth = self._of_patch(contact.patch)
            with torch.no_grad():
                r = self._model(contact.state, shared, depth)
            displacement[contact.index] = pose.rotate(r.double().numpy())
        return displacement

    def linearise(self, rows: Array, pose: RigidPose) -> CorrectionField:
        """u and du/drows of the points within reach; an empty field where the reduced body does not touch."""
        contact = self._contact(rows, pose)
        if contact is None:
            return CorrectionField.empty(self._model.dim, self._model.n_rows)
        shared, depth = self._of_patch(contact.patch)
        slope = contact.patch.shared_slope.to(shared)
        u, jacobian = self._model.linearise(contact.state, shared, slope, depth, contact.rotation)
        return CorrectionField(contact.index, u.double().numpy(), jacobian.double().numpy())

    def _of_patch(self, patch: Patch) -> tuple[Tensor, Tensor]:
        like = self._model.output_scale
        return patch.shared.to(like), like.new_tensor(patch.depth)

    def _contact(self, rows: Array, pose: RigidPose) -> _Contact | None:
        patch = self._probe.measure(rows, pose)
        if patch is None:
            return None
        local_rows = self._probe.collider_rows(rows, pose)
        z = self._basis @ local_rows
        index, points = np.arange(len(z)), self._points
        if self._reach.limited:
            index = self._reach.select(z, self._probe.collider)
            points, z = points.take(torch.from_numpy(index)), z[index]
        state = PointStates.at(points, local_rows, z, self._probe.collider)
        return _Contact(patch, index, state, torch.from_numpy(pose.rotation.copy()).to(points.basis))
