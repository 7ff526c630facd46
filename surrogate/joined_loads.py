"""Load data of many colliders as one data set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import torch
from torch import Tensor
from torch.nn.functional import pad

from surrogate.load_task import ForceData


def join_force_data(parts: Sequence[ForceData]) -> ForceData:
    """The samples of all parts one after the other, padded to the largest number of loads."""
    most = max(part.index.shape[1] for part in parts)
    joined = {
        field.name: torch.cat([_padded(getattr(part, field.name), most) for part in parts])
        for field in fields(ForceData)
    }
    return ForceData(**joined)


def _padded(column: Tensor, most: int) -> Tensor:
    """With zeros for loads (second axis) that are not there; columns of whole samples stay as they are."""
    if column.ndim < 2:
        return column
    return pad(column, (0, 0) * (column.ndim - 2) + (0, most - column.shape[1]))
