"""A surface compliance as named arrays of a mechanics file.

Large ones are stored in half precision, scaled by their largest entry: an error of 5e-4, at half the size.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from softprint.runtime.mechanics.compliance.surface_compliance import SurfaceCompliance

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


def surface_compliance_arrays(compliance: SurfaceCompliance, prefix: str) -> dict[str, NDArray[Any]]:
    """The arrays of a compliance, named `prefix.*`."""
    operator, share, near = compliance.operator, compliance.share, compliance.near
    operator_scale = np.abs(operator).max(axis=(1, 2, 3), keepdims=True)
    near_scale = np.array(float(np.abs(near.data).max(initial=0.0)) or 1.0, dtype=np.float32)
    values = (
        compliance.nodes,
        compliance.areas,
        compliance.anchors,
        (operator / operator_scale).astype(np.float16),
        operator_scale,
        share.data,
        *_structure(share),
        (near.data / near_scale).astype(np.float16),
        near_scale,
        *_structure(near),
    )
    return {f"{prefix}.{name}": value for name, value in zip(_NAMES, values, strict=True)}


def take_compliance(arrays: dict[str, NDArray[Any]], prefix: str) -> SurfaceCompliance:
    """Removes the arrays of a compliance, named `prefix.*`, from those of a file, and returns the compliance. Raises
    KeyError or ValueError where they are missing or do not fit together."""
    own = {name: arrays.pop(f"{prefix}.{name}") for name in _NAMES}
    operator = own["operator"].astype(np.float32)
    operator *= own["operator_scale"]
    n_anchors, dim, n_nodes, _ = operator.shape
    n_contact = len(own["nodes"])
    share = (own["share"], own["share_between"], own["share_starts"])
    near = (own["near"].astype(np.float32) * own["near_scale"], own["near_columns"], own["near_starts"])
    return SurfaceCompliance(
        own["nodes"],
        own["areas"],
        own["anchors"],
        operator,
        sp.csr_matrix(share, shape=(n_contact, n_anchors)),
        sp.csr_matrix(near, shape=(n_contact * dim, n_nodes * dim)),
    )


def _structure(matrix: sp.csr_matrix) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    return matrix.indices.astype(np.int32), matrix.indptr.astype(np.int32)
