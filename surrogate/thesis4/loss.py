"""The loss of thesis 4.3.3 for object-centric corrections, and the error on held-out samples."""

from __future__ import annotations

import torch
from torch import Tensor

from softprint.runtime.learned.thesis4.model import ObjectCentricModel
from softprint.surrogate.data.component_targets import ComponentTargets
from softprint.surrogate.learning_task import HeldOutError


def object_centric_loss(
    model: ObjectCentricModel, targets: ComponentTargets, z: Tensor, depth: Tensor, index: Tensor
) -> Tensor:
    """L2 error of r over the volume, of inputs z (b, n_inputs) and depths (b,) of the samples `index` (b,)."""
    return targets.loss(model(z, depth), index)


@torch.no_grad()
def held_out_error(
    model: ObjectCentricModel, targets: ComponentTargets, z: Tensor, depth: Tensor
) -> HeldOutError:
    """Error of r over the volume on the held-out samples, relative to r itself."""
    return targets.held_out_error(model(z, depth))
