"""Training data of learned contact forces: the samples of a truth file at their contact points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import pad
from torch.nn.utils.rnn import pad_sequence

from softprint.runtime.arrays import IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.rotations import nearest_rotations
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.elasticity.displacement_field import InternalField
from softprint.runtime.learned.force.contact_state import ContactStateProbe
from softprint.runtime.learned.force.model import ForceModelOptions
from softprint.runtime.mechanics.body_mechanics import BodyMechanics
from softprint.runtime.truth.truth_file import TruthData
from softprint.surrogate.data.touching import touching_samples
from softprint.surrogate.force.loads import Loads
from softprint.surrogate.force.loss import ForceMetric


@dataclass(frozen=True, eq=False)
class ForceData:
    """s samples, padded to the largest number m of contact points. sample: (s,) their rows of the truth file; local:
    (s, m, n_local); depth: (s,); force: (s, m, dim); lever: (s, m, DIRECTIONS, dim); present: (s, m) 1 at contact
    points, 0 in the padding; loads: (s, n), n_loads (s,) of them and then padding, corners and shares: (s, m, c), and
    anchors and anchor_shares: (s, k, a), see `Loads`; h: (s, m, 2 dim) and squared: (s,), the h and c of `loss.py` with
    the edge term, of forces on points and spread around them; volume_h, volume_squared: the same without it."""

    sample: Tensor
    local: Tensor
    depth: Tensor
    force: Tensor
    lever: Tensor
    present: Tensor
    loads: Tensor
    n_loads: Tensor
    corners: Tensor
    shares: Tensor
    anchors: Tensor
    anchor_shares: Tensor
    h: Tensor
    squared: Tensor
    volume_h: Tensor
    volume_squared: Tensor

    def __len__(self) -> int:
        return len(self.depth)

    def to(self, device: torch.device) -> ForceData:
        """The same data on a device."""
        return ForceData(*(getattr(self, name).to(device) for name in ForceData.__dataclass_fields__))

    @property
    def arrays(self) -> tuple[NDArray[Any], ...]:
        """The columns, as another process can be given them."""
        return tuple(getattr(self, name).numpy() for name in ForceData.__dataclass_fields__)

    @classmethod
    def of_arrays(cls, arrays: Sequence[NDArray[Any]]) -> ForceData:
        """From `arrays`."""
        return cls(*map(torch.from_numpy, arrays))

    def take(self, which: Tensor) -> ForceData:
        """Some of the samples."""
        return ForceData(*(getattr(self, name)[which] for name in ForceData.__dataclass_fields__))


def read_force_data(
    truth: TruthData,
    body: ReducedBody,
    collider: Collider,
    mechanics: BodyMechanics,
    options: ForceModelOptions,
    metric: ForceMetric,
    samples: IntArray,
    progress: Callable[[int], None] | None = None,
    internal: InternalField | None = None,
) -> ForceData | None:
    """The given rows of a truth file. Samples in which the reduced body has no contact are dropped; None where no other
    is left. internal: correction of the body, which contact sees."""
    probe = ContactStateProbe(body, collider, mechanics, options.law, options.band, options.learned, internal)
    gradient = body.node_points().basis_gradient
    state = -1
    columns: list[tuple[Tensor, ...]] = []
    for sample, rows, _pose, contact in touching_samples(truth, samples, probe, progress):
        if not len(contact.index):
            continue
        if truth.sample_state[sample] != state:
            state = truth.sample_state[sample]
            to_rest = nearest_rotations(rows.T @ gradient).swapaxes(1, 2)
        u = truth.displacement(sample).astype(np.float64)
        w = (to_rest @ u[..., None])[..., 0]
        loads = Loads.of(contact.loaded, contact.index, mechanics.spread_compliance)
        at_loads, squared, volume_at_loads, volume_squared = metric.of_field(w, loads.loads)
        h, volume_h = (loads.to_points(at) for at in (at_loads, volume_at_loads))
        columns.append(
            (
                torch.tensor(sample),
                torch.from_numpy(contact.inputs).float(),
                torch.tensor(contact.depth),
                torch.from_numpy(contact.force).float(),
                torch.from_numpy(contact.lever).float(),
                torch.ones(len(contact.index)),
                torch.from_numpy(loads.loads),
                torch.tensor(len(loads.loads)),
                torch.from_numpy(loads.corners),
                torch.from_numpy(loads.shares).float(),
                torch.from_numpy(loads.anchors),
                torch.from_numpy(loads.anchor_shares).float(),
                torch.from_numpy(h).float(),
                torch.tensor(squared),
                torch.from_numpy(volume_h).float(),
                torch.tensor(volume_squared),
            )
        )
    if not columns:
        return None
    names = list(ForceData.__dataclass_fields__)
    whole, numbers = {"sample", "depth", "n_loads", "squared", "volume_squared"}, {"sample", "n_loads"}
    stacked = (
        torch.stack(column).to(column[0].dtype if name in numbers else torch.float32)
        if name in whole
        else pad_sequence(list(column), batch_first=True)
        for name, column in zip(names, zip(*columns, strict=True), strict=True)
    )
    return ForceData(*stacked)


def join_force_data(parts: Sequence[ForceData]) -> ForceData:
    """Concatenate the samples of all parts, padded to the largest number of contact points and loads."""
    columns = {field.name: [getattr(part, field.name) for part in parts] for field in fields(ForceData)}
    return ForceData(**{name: _joined(column) for name, column in columns.items()})


def _joined(column: Sequence[Tensor]) -> Tensor:
    """The same column of all parts; where a sample has several values, its second axis is padded."""
    if column[0].ndim < 2:
        return torch.cat(list(column))
    most = max(part.shape[1] for part in column)
    return torch.cat([_padded(part, most) for part in column])


def _padded(column: Tensor, most: int) -> Tensor:
    """Pad the second axis with zeros."""
    return pad(column, (0, 0) * (column.ndim - 2) + (0, most - column.shape[1]))
