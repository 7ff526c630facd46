"""Surfaces of colliders: closed, outward, and of the right size."""

from __future__ import annotations

import numpy as np
import pytest

from softprint.runtime.colliders import Plane, Sphere
from softprint.runtime.colliders.level_set import collider_surface
from softprint.runtime.errors import SoftprintError
from softprint.runtime.inspect.mesh_quality import facet_edges
from softprint.runtime.mesh.mesh import facet_vectors


def test_a_ball_has_its_surface_and_volume(dim) -> None:
    vertices, facets = collider_surface(Sphere(0.02, dim=dim))
    vectors = facet_vectors(vertices, facets)
    # Chords of a grid of 72 (240 in 2D) cells: their sagitta reduces the size by h^2 / 8 r^2, and
    # facets of marching cubes bend either way, by less than 0.5 %.
    assert np.linalg.norm(vectors, axis=1).sum() == pytest.approx(
        {2: 2 * np.pi * 0.02, 3: 4 * np.pi * 0.02**2}[dim], rel=5e-3
    )
    # The divergence theorem gives the volume only if every normal points outward.
    enclosed = (vertices[facets].mean(axis=1) * vectors).sum() / dim
    assert enclosed == pytest.approx({2: np.pi * 0.02**2, 3: 4 / 3 * np.pi * 0.02**3}[dim], rel=5e-3)
    assert (facet_edges(facets) == 2).all()


def test_vertices_lie_on_the_surface(dim) -> None:
    vertices, _ = collider_surface(Sphere(0.02, dim=dim), cells=40)
    # Linear interpolation across a cell of 1 mm misses a circle of 20 mm by at most h^2 / 8 r (times the
    # square of the diagonal).
    assert np.abs(np.linalg.norm(vertices, axis=1) - 0.02).max() < dim * 1e-3**2 / (8 * 0.02)


def test_unbounded_colliders_have_no_surface() -> None:
    with pytest.raises(SoftprintError, match="has no bounds"):
        collider_surface(Plane([0.0, 0.0, 1.0], name="floor"))
