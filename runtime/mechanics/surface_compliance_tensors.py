"""A surface compliance as named tensors of a mechanics file.

Large tensors are stored in half precision, scaled by their largest entry: an error of 5e-4, at half the size.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import torch
from torch import Tensor

from softprint.runtime.mechanics.surface_compliance import SurfaceCompliance

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
    """The tensors of a compliance, named `compliance.*`."""
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
    """Removes the tensors of a compliance from those of a file, and returns the compliance. Raises KeyError or
    ValueError where they are missing or do not fit together."""
    own = {name: tensors.pop(f"compliance.{name}") for name in _NAMES}
    operator = own["operator"].float().mul_(own["operator_scale"])
    n_anchors, dim, n_nodes, _ = operator.shape
    n_contact = len(own["nodes"])
    share = (own["share"], own["share_between"], own["share_starts"])
    near = (own["near"].float() * own["near_scale"], own["near_columns"], own["near_starts"])
    return SurfaceCompliance(
        own["nodes"].numpy(),
        own["areas"].numpy(),
        own["anchors"].numpy(),
        operator.numpy(),
        sp.csr_matrix(tuple(part.numpy() for part in share), shape=(n_contact, n_anchors)),
        sp.csr_matrix(tuple(part.numpy() for part in near), shape=(n_contact * dim, n_nodes * dim)),
    )


def _structure(matrix: sp.csr_matrix) -> tuple[Tensor, Tensor]:
    return torch.from_numpy(matrix.indices.astype(np.int32)), torch.from_numpy(matrix.indptr.astype(np.int32))
