"""Tiny bodies for full-space solves: a block on a rigid base, in 2D and 3D, without gmsh."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from softprint.runtime.body import ReducedBody
from softprint.runtime.body.build import assemble_body
from softprint.runtime.body.handles import FrameHandle, Handles
from softprint.runtime.elasticity import make_material
from softprint.runtime.mesh import box_mesh

SIZES = {2: ([-0.05, 0.0], [0.05, 0.05], [12, 6]), 3: ([-0.05, -0.05, 0.0], [0.05, 0.05, 0.05], [4, 4, 3])}


@pytest.fixture(scope="session")
def block() -> Callable[..., ReducedBody]:
    """block(dim, model): 10 cm wide, E = 20 kPa in the upper half and 10 kPa in the lower, four point handles, the base
    a frame."""
    made: dict[tuple[int, str], ReducedBody] = {}

    def make(dim: int, model: str = "stable_neo_hookean") -> ReducedBody:
        if (dim, model) not in made:
            lower, upper, divisions = SIZES[dim]
            mesh = box_mesh(lower, upper, divisions)
            height = mesh.points[:, -1]
            base = np.flatnonzero(height < 0.02)
            top = np.flatnonzero(height > 0.049)
            corners = top[np.argsort(-np.abs(mesh.points[top, :-1]).sum(axis=1), kind="stable")][:4]
            frame = FrameHandle("base", base, mesh.points[base].mean(axis=0))
            young = np.where(mesh.cell_centroids[:, -1] > 0.025, 2e4, 1e4)
            material = make_material(model, young, np.full(mesh.n_cells, 0.4))
            handles = Handles(dim, np.sort(corners), (frame,))
            made[dim, model] = assemble_body(mesh, handles, material, 1000.0, name=f"block{dim}d")
        return made[dim, model]

    return make
