"""A compliance as named tensors of a correction file.

What is large is kept in half precision, scaled by its largest entry: an error of 5e-4, at half the size.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import torch
from torch import Tensor

from runtime.mechanics.surface_compliance import SurfaceCompliance

_NAMES = (
    "nodes",
    "areas",
    "anchors",
    "operator",
    "operator_scale",
    "share",
    "share_between",
    "share_starts",
    "near",
    "near_scale",
    "near_columns",
    "near_starts",
)


def surface_compliance_tensors(compliance: SurfaceCompliance) -> dict[str, Tensor]:
    """Of the names `compliance.*`."""
    operator, share, near = torch.from_numpy(compliance.operator), compliance.share, compliance.near
    operator_scale = operator.abs().amax(dim=(1, 2, 3), keepdim=True)
    near_scale = torch.tensor(float(np.abs(near.data).max(initial=0.0)) or 1.0)
    values = (
        torch.from_numpy(compliance.nodes),
        torch.from_numpy(compliance.areas),
        torch.from_numpy(compliance.anchors),
        (operator / operator_scale).half(),
        operator_scale,
        torch.from_numpy(share.data),
        *_structure(share),
        (torch.from_numpy(near.data) / near_scale).half(),
        near_scale,
        *_structure(near),
    )
    return {f"compliance.{name}": value for name, value in zip(_NAMES, values, strict=True)}


def take_compliance(tensors: dict[str, Tensor]) -> SurfaceCompliance:
    """Takes its tensors out of those of a file; KeyError or ValueError where they are not there or do not fit."""
    own = {name: tensors.pop(f"compliance.{name}") for name in _NAMES}
    operator = own["operator"].float().mul_(own["operator_scale"])
    n_anchors, dim, n_nodes, _ = operator.shape
    n_loads = len(own["nodes"])
    share = (own["share"], own["share_between"], own["share_starts"])
    near = (own["near"].float() * own["near_scale"], own["near_columns"], own["near_starts"])
    return SurfaceCompliance(
        own["nodes"].numpy(),
        own["areas"].numpy(),
        own["anchors"].numpy(),
        operator.numpy(),
        sp.csr_matrix(tuple(part.numpy() for part in share), shape=(n_loads, n_anchors)),
        sp.csr_matrix(tuple(part.numpy() for part in near), shape=(n_loads * dim, n_nodes * dim)),
    )


def _structure(matrix: sp.csr_matrix) -> tuple[Tensor, Tensor]:
    return torch.from_numpy(matrix.indices.astype(np.int32)), torch.from_numpy(matrix.indptr.astype(np.int32))
