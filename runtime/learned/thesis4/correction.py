"""The object-centric correction of thesis chapter 4 at run time: u = F(q) r(A(q)^-1 z), for one collider.

The deformation gradient F of the subspace maps r to the world, as for an internal correction. Corrections of several
colliders and an internal one add up: x = U q + F (r_int + sum_c r_ext(z_c)) (eq. 4.7), which is right where colliders
are far apart. Where the reduced body does not touch the collider there is none.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.material_points import MaterialPoints
from softprint.runtime.body.node_gradients import basis_gradient_at_nodes
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.elasticity.displacement_field import CorrectionField
from softprint.runtime.errors import SoftprintError
from softprint.runtime.lazy import lazy
from softprint.runtime.learned.contact_patch import ContactProbe, Patch
from softprint.runtime.learned.correction import require_body
from softprint.runtime.learned.internal.correction import MappedField
from softprint.runtime.learned.internal.local_field import ModelField
from softprint.runtime.learned.thesis4.inputs import InteractionState, parameters_of
from softprint.runtime.learned.thesis4.model import ObjectCentricModel

# Points count as nodes up to this distance, relative to the size of the body.
_AT_NODE = 1e-9


class ObjectCentricCorrection:
    """A trained model on a body and a collider. Raises SoftprintError for a collider of another shape, or of a size
    outside the trained range."""

    support = np.inf

    def __init__(self, name: str, model: ObjectCentricModel, body: ReducedBody, collider: Collider) -> None:
        require_body(name, model.dim, model.n_rows, body)
        self.probe = ContactProbe(body, collider)
        model.require(collider, name)
        self.name, self.collider = name, collider.name
        self.model = model.eval()
        self.body = body
        self.inputs = InteractionState.of(body)
        self.parameters = parameters_of(collider, model.options.parameters)
        self._gradient = basis_gradient_at_nodes(body)

    def bind(self, points: MaterialPoints, reach: float | Array = np.inf) -> BoundObjectCentric:
        """See `FieldCorrection.bind`. The points are nodes of the body; all of them are active in contact."""
        mesh = self.body.mesh
        away, nodes = cKDTree(mesh.points).query(points.rest)
        if away.max(initial=0.0) > _AT_NODE * mesh.size:
            raise SoftprintError(f"correction {self.name!r} is known at the nodes of its body only")
        return BoundObjectCentric(self, nodes, self._gradient[nodes])


class BoundObjectCentric:
    """An object-centric correction at n nodes."""

    def __init__(self, correction: ObjectCentricCorrection, nodes: IntArray, gradient: Array) -> None:
        model = correction.model
        self._inputs, self._parameters = correction.inputs, correction.parameters
        self._probe, self._fade, self._shape = correction.probe, model.fade, gradient.shape
        at_identity = self._inputs.seen(RigidPose.identity(model.dim), self._parameters)
        self._local = ModelField(model.as_arrays(), model.modes.double().numpy(), at_identity, nodes)
        self._mapped = MappedField(self._local, gradient)

    def displacement(self, rows: Array, pose: RigidPose) -> Array:
        """u (n, dim) [m] in the world frame."""
        patch = self._probe.measure(rows, pose)
        if patch is None:
            n, _, dim = self._shape
            return np.zeros((n, dim))
        return self._fade.value(patch.depth) * self._at(pose).displacement(rows)

    def linearise(self, rows: Array, pose: RigidPose) -> CorrectionField:
        """u and du/drows of all points; an empty field where the reduced body does not touch."""
        patch = self._probe.measure(rows, pose)
        if patch is None:
            return CorrectionField.empty(self._shape[2], self._shape[1])
        faded = self._fade.value(patch.depth), self._fade.slope(patch.depth)
        return FadedField(self._at(pose).linearise(rows), *faded, patch)

    def _at(self, pose: RigidPose) -> MappedField:
        """The field with the collider at a pose."""
        return self._mapped.of(self._local.reading(self._inputs.seen(pose, self._parameters)))


class FadedField(CorrectionField):
    """phi(D) u at one state, of a field u. Its curvature is without the second derivative of phi(D)."""

    def __init__(self, field: CorrectionField, factor: float, slope: float, patch: Patch) -> None:
        self.__dict__ |= {"_field": field, "_factor": factor, "_slope": slope, "_patch": patch}
        self.__dict__ |= {"index": field.index, "displacement": factor * field.displacement}

    _field: CorrectionField
    _factor: float
    _slope: float
    _patch: Patch

    @lazy
    def _faded(self) -> Array:
        """dphi/drows (n_rows, dim)."""
        return self._slope * self._patch.shared_slope[0].numpy()

    @lazy
    def jacobian(self) -> Array:
        """See `CorrectionField`."""
        own = self._field
        return self._factor * own.jacobian + own.displacement[:, :, None, None] * self._faded

    def along(self, directions: Array | None) -> NDArray[np.floating[Any]]:
        """See `CorrectionField`."""
        faded = self._faded.ravel() if directions is None else self._faded.ravel() @ directions
        return self._factor * self._field.along(directions) + np.outer(self._field.displacement, faded)

    def pulled_back(self, forces: Array) -> Array:
        """See `CorrectionField`."""
        own = self._field
        return self._factor * own.pulled_back(forces) + np.vdot(own.displacement, forces) * self._faded

    def curvature(self, forces: Array, directions: Array | None) -> Array | None:
        """See `CorrectionField`."""
        own = self._field.curvature(forces, directions)
        if own is None:
            return None
        slope, faded = self._field.pulled_back(forces).ravel(), self._faded.ravel()
        if directions is not None:
            slope, faded = slope @ directions, faded @ directions
        cross = np.outer(slope, faded)
        return self._factor * own + cross + cross.T
