"""How far two surfaces are from each other, from each to the other: sampled Hausdorff distances."""

from __future__ import annotations

from dataclasses import dataclass

import igl
import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.mesh.mesh import facet_vectors

_DRAWN = 20_000  # points of a surface, by area


@dataclass(frozen=True)
class Fidelity:
    """Distances in the surfaces' unit, at points drawn by area. there: from the old surface to the new one; back:
    from the new one to the old one; buried: share of the old area that lies inside the new surface and is left
    out."""

    there_most: float
    there_mean: float
    back_most: float
    back_mean: float
    buried: float


def fidelity(old: tuple[Array, IntArray], new: tuple[Array, IntArray], deep: float) -> Fidelity:
    """Of surfaces, each vertices (v, 3) and triangles (t, 3); the new one is closed. Where parts of the old surface
    passed through each other, some of it lies inside: points that are inside by more than `deep` are left out."""
    rng = np.random.default_rng(0)
    of_old, of_new = _drawn(*old, rng), _drawn(*new, rng)
    there, back = _distance(of_old, *new), _distance(of_new, *old)
    buried: BoolArray = (there > deep) & (np.asarray(igl.fast_winding_number(*new, of_old)) > 0.5)
    kept = there[~buried] if not buried.all() else there
    return Fidelity(
        float(kept.max()), float(kept.mean()), float(back.max()), float(back.mean()), float(buried.mean())
    )


def _drawn(vertices: Array, triangles: IntArray, rng: np.random.Generator) -> Array:
    area = np.linalg.norm(facet_vectors(vertices, triangles), axis=1)
    facets = vertices[triangles[rng.choice(len(triangles), size=_DRAWN, p=area / area.sum())]]
    return np.einsum("nc,ncd->nd", rng.dirichlet(np.ones(3), size=_DRAWN), facets)


def _distance(points: Array, vertices: Array, triangles: IntArray) -> Array:
    unit = float(np.ptp(vertices, axis=0).max())  # libigl has absolute thresholds
    squared = igl.point_mesh_squared_distance(points / unit, vertices / unit, triangles)[0]
    return unit * np.sqrt(np.asarray(squared))
