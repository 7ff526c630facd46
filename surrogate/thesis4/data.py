"""Training data of object-centric corrections: the samples of a truth file, mapped back (thesis eqs. 4.8 and 4.9).

    contact    r = F^-1 (x - x_internal), what contact adds to the internal equilibrium
    whole      r = F^-1 (x - U q), all that the subspace lacks

Samples in which the reduced body does not touch the collider are dropped: the correction is zero there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.node_gradients import basis_gradient_at_nodes
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.contact_patch import ContactProbe
from softprint.runtime.learned.internal.correction import unmapped
from softprint.runtime.learned.thesis4.inputs import InteractionState, parameters_of
from softprint.runtime.learned.thesis4.model import SAME_SHAPE, SAME_SIZE, unit_shape
from softprint.runtime.truth.truth_file import TruthData
from softprint.surrogate.data.touching import touching_samples


@dataclass(frozen=True, eq=False)
class ObjectCentricData:
    """inputs: z (s, n_inputs); depth: of the contact patch (s,) [m]; fields: r (s, n_nodes, dim) [m], single precision;
    sample: (s,) rows of the truth file."""

    inputs: Array
    depth: Array
    fields: Array
    sample: IntArray

    def some(self, samples: IntArray) -> ObjectCentricData:
        """Those of the given rows of the truth file."""
        own = np.isin(self.sample, samples)
        return ObjectCentricData(self.inputs[own], self.depth[own], self.fields[own], self.sample[own])


def read_object_centric(
    truth: TruthData,
    body: ReducedBody,
    samples: Iterable[tuple[Collider, IntArray]],
    target: Literal["contact", "whole"],
    parameters: Sequence[str] = (),
    progress: Callable[[int], None] | None = None,
) -> ObjectCentricData:
    """The given rows of a truth file, by collider. Raises SoftprintError where in none of them the reduced body touches
    the collider, and where the subspace inverts the body at a node."""
    state, gradient = InteractionState.of(body), basis_gradient_at_nodes(body)
    inputs, depth, fields, kept = [], [], [], []
    for collider, own in samples:
        values = parameters_of(collider, parameters)
        for sample, rows, pose, patch in touching_samples(truth, own, ContactProbe(body, collider), progress):
            u = truth.displacement(sample).astype(np.float64)
            if target == "whole":
                u += truth.internal(int(truth.sample_state[sample]))
            inputs.append(state.seen(pose, values)(rows))
            depth.append(patch.depth)
            fields.append(unmapped(gradient, rows, u).astype(np.float32))
            kept.append(sample)
    if not kept:
        raise SoftprintError(f"{truth.path}: in none of the samples does the reduced body touch the collider")
    return ObjectCentricData(np.array(inputs), np.array(depth), np.array(fields), np.array(kept))


@dataclass(frozen=True, eq=False)
class TrainedColliders:
    """What a correction knows of the colliders that it learns from. shape: at size one; sizes: (2,) the least and the
    largest [m]."""

    shape: Array
    sizes: Array


def common_shape(colliders: Sequence[Collider], parameters: Sequence[str]) -> TrainedColliders:
    """The one shape of colliders of several sizes. Raises SoftprintError where they have several, where their sizes
    differ and are no parameter, and where they do not differ and are one."""
    first = colliders[0]
    shape, sizes = unit_shape(first), np.array([collider.size for collider in colliders])
    for other in colliders[1:]:
        if np.abs(unit_shape(other) - shape).max() > SAME_SHAPE:
            raise SoftprintError(
                f"the colliders {first.name!r} and {other.name!r} have different shapes, and a model of form thesis4 "
                "learns one: train on one collider, or on one shape in several sizes"
            )
    differ = float(np.ptp(sizes)) > SAME_SIZE * sizes.max()
    if differ and "size" not in parameters:
        raise SoftprintError(
            f"the colliders have sizes from {sizes.min():.3g} to {sizes.max():.3g} m, which the model is not told: "
            'give its [[training.models]] table parameters = ["size"]'
        )
    if not differ and "size" in parameters:
        raise SoftprintError(
            f'parameters = ["size"], but all colliders have the size {sizes.max():.3g} m, so that there is nothing to '
            "learn from it: train on several sizes, or leave it out"
        )
    return TrainedColliders(shape, np.array([sizes.min(), sizes.max()]))
