"""The correction of thesis chapter 6 at run time: a trained `DescriptorModel` on a body and any collider."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.material_points import MaterialPoints
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.elasticity.displacement_field import CorrectionField
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.contact_patch import ContactProbe, Patch
from softprint.runtime.learned.correction import require_body
from softprint.runtime.learned.reach import Reach
from softprint.runtime.learned.thesis6.descriptors import (
    Geometry,
    GridGeometry,
    MovingFrames,
    biased_frames,
    moving_frames,
)
from softprint.runtime.learned.thesis6.descriptors.attenuation import attenuation, attenuation_slope
from softprint.runtime.learned.thesis6.descriptors.smoothed_gradient import unit_normal, unit_normal_slope
from softprint.runtime.learned.thesis6.descriptors.steadiness import steadiness, steadiness_slope
from softprint.runtime.learned.thesis6.inputs import inputs_in_frame, relative_rows
from softprint.runtime.learned.thesis6.model import DescriptorModel


class DescriptorCorrection:
    """u(X) = T R r (thesis eq. 6.1). Zero unless some surface sample of the reduced body penetrates, at points whose
    reduced position is farther than d from the collider, and where the normal is undefined.

    geometry: the source of the descriptors, by default grids around the collider, computed here. The model may be
    float32, as trained, or float64 (`model.double()`), for finite differences.
    """

    def __init__(
        self,
        name: str,
        model: DescriptorModel,
        body: ReducedBody,
        collider: Collider,
        geometry: Geometry | None = None,
    ) -> None:
        require_body(name, model.dim, model.n_rows, body)
        if not np.isfinite(collider.upper - collider.lower).all():
            raise SoftprintError(
                f"correction {name!r}: collider {collider.name!r} has no bounds, and descriptors are computed around "
                "a collider; take a box, a cylinder or a mesh"
            )
        options = model.options
        self.name, self.collider, self.support = name, collider.name, options.radius
        self.model = model.eval()
        self.probe = ContactProbe(body, collider)
        self.geometry = geometry or GridGeometry(collider, options.radius, options.sets)

    def bind(self, points: MaterialPoints, reach: float | Array = np.inf) -> BoundDescriptorCorrection:
        """See `FieldCorrection.bind`."""
        return BoundDescriptorCorrection(self, points, reach)


@dataclass(frozen=True, eq=False)
class _Contact:
    """The data of one evaluation: the patch, the collider rows, and the active points in collider coordinates."""

    patch: Patch
    rows: Array
    index: IntArray
    z: Array


class BoundDescriptorCorrection:
    """A descriptor correction at n material points."""

    def __init__(
        self, correction: DescriptorCorrection, points: MaterialPoints, reach: float | Array
    ) -> None:
        self._model, self._probe, self._geometry = correction.model, correction.probe, correction.geometry
        self._basis, self._affine = points.basis, correction.probe.affine_part
        self._reach = Reach(points, np.minimum(reach, correction.support))
        self._radius = correction.support

    def displacement(self, rows: Array, pose: RigidPose) -> Array:
        """u (n, dim) [m] in the world frame."""
        displacement = np.zeros((len(self._basis), self._model.dim))
        contact = self._contact(rows, pose)
        if contact is not None and len(contact.index):
            relative = relative_rows(self._basis[contact.index], contact.rows, self._affine, contact.z)
            u = self.predict(contact.z, relative)
            u *= attenuation(self._geometry.distance(contact.z), self._radius)[:, None]
            displacement[contact.index] = self._model.fade.value(contact.patch.depth) * pose.rotate(u)
        return displacement

    def predict(self, z: Array, relative: Array) -> Array:
        """b R r (n, dim) [m] at points z (n, dim), in collider coordinates and before attenuation with distance;
        relative: see `relative_rows`."""
        u, gradient = np.zeros_like(z), self._geometry.smoothed(z)
        for frames in biased_frames(unit_normal(gradient)):
            at, R = frames.at, frames.rotation
            phi = self._model.descriptor.values(self._geometry, z[at], R)
            r = self._model.evaluate(inputs_in_frame(phi, relative[at], R))
            u[at] += frames.weight[:, None] * np.einsum("nab,nb->na", R, r)
        return u * steadiness(gradient)[:, None]

    def linearise(self, rows: Array, pose: RigidPose) -> CorrectionField:
        """u and du/drows of the points within d and within reach; an empty field where the reduced body does not
        touch."""
        contact = self._contact(rows, pose)
        if contact is None or not len(contact.index):
            return CorrectionField.empty(self._model.dim, self._model.n_rows)
        basis, z = self._basis[contact.index], contact.z
        relative = relative_rows(basis, contact.rows, self._affine, z)
        u, to_z = np.zeros_like(z), np.zeros((*z.shape, z.shape[1]))
        to_rows = np.zeros((*z.shape, *contact.rows.shape))
        smoothed = self._geometry.smoothed_derivatives(z)
        for frames in moving_frames(*unit_normal_slope(*smoothed)):
            at = frames.at
            part = self._in_frames(frames, z[at], relative[at], basis[at])
            weight = frames.weight
            u[at] += weight[:, None] * part[0]
            to_z[at] += (
                weight[:, None, None] * part[1] + part[0][:, :, None] * frames.weight_slope[:, None, :]
            )
            to_rows[at] += weight[:, None, None, None] * part[2]
        distance, gradient = self._geometry.distance_gradient(z)
        a, b = attenuation(distance, self._radius), steadiness(smoothed[0])
        slope = (b * attenuation_slope(distance, self._radius))[:, None] * gradient
        slope += a[:, None] * steadiness_slope(*smoothed)
        a *= b
        to_z = a[:, None, None] * to_z + u[:, :, None] * slope[:, None, :]
        u *= a[:, None]
        jacobian = a[:, None, None, None] * to_rows + to_z[:, :, None, :] * basis[:, None, :, None]
        # To the world: u rotates with the pose, and d(collider rows) = d(world rows) R.
        u = pose.rotate(u)
        jacobian = pose.rotation @ (jacobian @ pose.rotation.T).reshape(len(z), self._model.dim, -1)
        fade, depth = self._model.fade, contact.patch.depth
        depth_slope = contact.patch.shared_slope[0].numpy()
        jacobian = fade.value(depth) * jacobian.reshape(to_rows.shape)
        jacobian += fade.slope(depth) * u[:, :, None, None] * depth_slope
        return CorrectionField(contact.index, fade.value(depth) * u, jacobian)

    def _in_frames(
        self, frames: MovingFrames, z: Array, relative: Array, basis: Array
    ) -> tuple[Array, Array, Array]:
        """R r (n, dim) with its derivatives through z (n, dim, dim) and through the rows (n, dim, n_rows, dim), in
        collider coordinates, for points with one frame each."""
        n, dim = z.shape
        R, R_slope, descriptor = frames.rotation, frames.slope, self._model.descriptor
        phi, phi_slope = descriptor.derivatives(self._geometry, z, R, R_slope)
        r, to_inputs = self._model.derivatives(inputs_in_frame(phi, relative, R))
        to_phi = to_inputs[:, :, : len(descriptor)]
        to_rotated = to_inputs[:, :, len(descriptor) :].reshape(n, dim, -1, dim)
        # The rotated rows are y_ra = U_r v_rb R_ba with v = rows - affine z: dy/dz = U_r (v_rb dR_ba/dz - affine R_ca).
        moment = to_rotated.transpose(0, 1, 3, 2).reshape(n, dim * dim, -1) @ relative  # (n, i.a, b)
        rotation_slope = R_slope.transpose(0, 2, 1, 3).reshape(n, dim * dim, dim)  # (n, a.b, c)
        weighted = to_rotated * basis[:, None, :, None]
        r_slope = to_phi @ phi_slope + moment.reshape(n, dim, dim * dim) @ rotation_slope
        r_slope -= (self._affine @ weighted) @ R.transpose(0, 2, 1)
        u = np.einsum("nab,nb->na", R, r)
        to_z = np.einsum("nabc,nb->nac", R_slope, r) + R @ r_slope
        to_rows = (R @ (weighted @ R.transpose(0, 2, 1)[:, None]).reshape(n, dim, -1)).reshape(
            n, dim, -1, dim
        )
        return u, to_z, to_rows

    def _contact(self, rows: Array, pose: RigidPose) -> _Contact | None:
        patch = self._probe.measure(rows, pose)
        if patch is None:
            return None
        local_rows = self._probe.collider_rows(rows, pose)
        z = self._basis @ local_rows
        index = self._reach.select(z, self._probe.collider)
        return _Contact(patch, local_rows, index, z[index])
