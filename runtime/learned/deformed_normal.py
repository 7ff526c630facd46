"""Unit normals of the deformed surface of a body (Nanson's relation).

A rest normal N becomes n = cof(F) N / |cof(F) N|. The cofactor is polynomial in F, so there is no division by
det F:

    c_i = 1/2 e_ijk e_lmn F_jm F_kn N_l   (3D),      c_i = e_ij e_lm F_jm N_l   (2D).
"""

from __future__ import annotations

import torch
from torch import Tensor

# cof(F) N shorter than this is of a crushed point, where its direction is arbitrary; it is not normalised.
SHORTEST = 1e-6


def levi_civita(dim: int, like: Tensor) -> Tensor:
    """The permutation symbol, (2, 2) or (3, 3, 3), in the type of `like`."""
    if dim == 2:
        return like.new_tensor([[0.0, 1.0], [-1.0, 0.0]])
    symbol = like.new_zeros(3, 3, 3)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        symbol[i, j, k], symbol[i, k, j] = 1.0, -1.0
    return symbol


def _cofactor_slope(F: Tensor, normal: Tensor) -> Tensor:
    """dc_i/dF_jm (..., dim, dim, dim) [i, j, m] of c = cof(F) N."""
    dim = F.shape[-1]
    e = levi_civita(dim, F)
    if dim == 2:
        return torch.einsum("ij,lm,...l->...ijm", e, e, normal).expand(*F.shape[:-2], 2, 2, 2)
    return torch.einsum("ijk,...kn,lmn,...l->...ijm", e, F, e, normal)


def _cofactor(F: Tensor) -> Tensor:
    """cof(F) (..., dim, dim): in 3D its columns are the cross products of the two other columns of F."""
    if F.shape[-1] == 2:
        e = levi_civita(2, F)
        return e @ F @ e.T
    after, before = F[..., [1, 2, 0]], F[..., [2, 0, 1]]
    return torch.linalg.cross(after, before, dim=-2)


def deformed_normal(F: Tensor, normal: Tensor) -> Tensor:
    """n (..., dim) of deformation gradients F (..., dim, dim) and rest normals (..., dim)."""
    c = (_cofactor(F) @ normal[..., None])[..., 0]
    return c / c.norm(dim=-1, keepdim=True).clamp(min=SHORTEST)


def deformed_normal_derivative(F: Tensor, normal: Tensor) -> tuple[Tensor, Tensor]:
    """n (..., dim) and dn_i/dF_jm (..., dim, dim, dim) [i, j, m] = (I - n n^T) dc/dF / |c|."""
    slope = _cofactor_slope(F, normal)
    # Euler's theorem: c is homogeneous of degree dim - 1 in F.
    c = torch.einsum("...ijm,...jm->...i", slope, F) / (F.shape[-1] - 1)
    length = c.norm(dim=-1, keepdim=True).clamp(min=SHORTEST)
    n = c / length
    slope = slope / length[..., None, None]
    return n, slope - n[..., :, None, None] * torch.einsum("...i,...ijm->...jm", n, slope)[..., None, :, :]
