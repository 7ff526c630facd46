"""The signed distance of a mesh: the sweep compared with libigl's trees and closed forms, and its cost."""

from __future__ import annotations

import time

import numpy as np
import pytest
import trimesh

from softprint.runtime.colliders.library import library_surface, zero_level
from softprint.runtime.colliders.surface_mesh import mesh_distance
from softprint.runtime.colliders.surface_mesh.mesh_collider import surface_collider
from softprint.runtime.colliders.surface_mesh.mesh_distance import MeshDistance
from softprint.runtime.shapes import SHAPES


def nodes(origin, counts, spacing):
    axes = [o + spacing * np.arange(n) for o, n in zip(origin, counts)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


@pytest.mark.parametrize("name", ["gear_12", "hollow_cube", "torus"])
def test_the_sweep_finds_the_nearest_facets(name: str) -> None:
    exact = MeshDistance(*library_surface(name, 0.03))
    for spacing, reach in ((0.005, 0.045), (0.015, 0.15)):  # as a collider's two grids
        counts = np.full(3, 2 * round(reach / spacing) + 1)
        origin = np.full(3, -reach)
        off = np.abs(exact.on_grid(origin, counts, spacing).ravel() - exact(nodes(origin, counts, spacing)))
        # Single nodes next to a medial surface may have received the facets on one side of it only.
        assert (off > 1e-9 * spacing).mean() < 5e-3
        assert off.max() < 0.1 * spacing


def test_a_fan_of_many_triangles() -> None:
    """A cone of 800 sides: each of them shares its tip with all others."""
    cone = trimesh.creation.cone(radius=0.02, height=0.04, sections=800)
    exact = MeshDistance(np.array(cone.vertices), np.array(cone.faces, dtype=np.int64))
    origin, counts, spacing = np.array([-0.05, -0.05, -0.04]), np.array([14, 14, 16]), 0.008
    off = np.abs(exact.on_grid(origin, counts, spacing).ravel() - exact(nodes(origin, counts, spacing)))
    assert off.max() < 0.01 * spacing


@pytest.mark.parametrize("name", ["ball", "capsule", "torus", "cushion"])
def test_the_distance_of_a_library_shapes_triangles_converges_to_its_formula(name: str) -> None:
    """At second order, as chords do; and so does the collider, whose spline is of fourth order."""
    shape = SHAPES[name]
    assert shape.exact
    z = np.random.default_rng(0).uniform(-1.1, 1.1, (3000, 3)) * np.array(shape.reach)
    z = z[np.abs(shape.field(z)) < 0.12]
    errors = []
    for cells in (16, 32):
        surface = zero_level(shape, cells)
        found = MeshDistance(*surface)(z), surface_collider(*surface, resolution=cells).sdf(z)
        errors.append([np.sqrt(np.mean((distance - shape.field(z)) ** 2)) for distance in found])
    # Measured orders are 1.94 to 2.05; they depend on the position of the grid relative to the surface.
    assert np.log2(np.array(errors[0]) / errors[1]) == pytest.approx(2.0, abs=0.2)


def test_a_surface_of_many_triangles_is_fast_and_accurate() -> None:
    """The limit is ten seconds for 100,000 triangles; it takes about two seconds of processor time."""
    radius = 0.03
    made = trimesh.creation.icosphere(subdivisions=6, radius=radius)  # 81,920
    surface = np.array(made.vertices), np.array(made.faces, dtype=np.int64)
    started = time.process_time()
    collider = surface_collider(*surface, resolution=48)
    assert time.process_time() - started < 8.0
    z = np.random.default_rng(1).normal(size=(20_000, 3))
    z *= (radius + np.random.default_rng(2).uniform(-0.02, 0.02, (len(z), 1))) / np.linalg.norm(z, axis=1)[
        :, None
    ]
    off = collider.sdf(z) - (np.linalg.norm(z, axis=1) - radius)
    # Chords of 0.5 mm leave 1e-6 m; deep inside, where the distance bends, cells of 1.25 mm add some more.
    assert np.abs(off).max() < 1e-5
    slope = collider.sdf_derivatives(z).gradient
    # The normals of neighbouring facets differ by 1/60, and so does the slope; interpolated between cells, far less.
    assert np.sqrt(np.mean((np.linalg.norm(slope, axis=1) - 1.0) ** 2)) < 2e-3


def test_winding_numbers_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of a point do not depend on the other points."""
    vertices, triangles = library_surface("torus", 0.03)
    points = np.random.default_rng(3).uniform(-0.05, 0.05, (1000, 3))
    whole = mesh_distance._winding_numbers(vertices, triangles, points)
    monkeypatch.setattr(mesh_distance, "_PART", 300)
    monkeypatch.setattr(mesh_distance, "_PART_OF_TRIANGLES", 0)
    np.testing.assert_array_equal(mesh_distance._winding_numbers(vertices, triangles, points), whole)
