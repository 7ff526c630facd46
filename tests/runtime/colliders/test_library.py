"""The library of colliders: a clean split, valid surfaces, and correct distances."""

from __future__ import annotations

import hashlib
import subprocess
import sys

import igl
import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from softprint.runtime.colliders.build import build_collider
from softprint.runtime.colliders.kinds.registry import ColliderSpec
from softprint.runtime.colliders.library import library_collider, library_surface, zero_level
from softprint.runtime.colliders.surface_mesh.mesh_distance import MeshDistance
from softprint.runtime.colliders.surface_mesh.repair import closed_surface
from softprint.runtime.errors import SoftprintError
from softprint.runtime.shapes import SCENE_SHAPES, SHAPES, SPLIT, find_shape, names, validation_names
from softprint.runtime.shapes.scene_shapes import BRIM_RADIUS, BRIM_TIP


def test_the_split_is_30_to_22_and_no_family_is_on_both_sides() -> None:
    assert (len(names("train")), len(names("test"))) == (30, 22)
    assert len(SHAPES) == 52  # a duplicate name would count once
    assert not set(SPLIT["train"]) & set(SPLIT["test"])
    every = [
        id(shape.field) for families in SPLIT.values() for shapes in families.values() for shape in shapes
    ]
    assert len(set(every)) == 52  # nor the same solid under two names
    assert set(validation_names()) < set(names("train"))


@pytest.mark.parametrize("name", [*SHAPES, *SCENE_SHAPES])
def test_the_surface_is_closed_faces_outward_and_has_the_holes_it_is_said_to_have(name: str) -> None:
    vertices, triangles = library_surface(name)
    directed = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    codes = directed @ np.array([len(vertices), 1])
    back = directed @ np.array([1, len(vertices)])
    assert len(np.unique(codes)) == len(codes)  # every edge runs once in each direction:
    assert np.array_equal(np.sort(codes), np.sort(back))  # closed, oriented, and two triangles at an edge
    assert igl.is_vertex_manifold(triangles).all()

    shape = find_shape(name)
    assert len(np.unique(triangles)) == len(vertices)
    assert len(vertices) - len(directed) // 2 + len(triangles) == shape.euler_characteristic
    pieces = np.asarray(igl.facet_components(triangles)[1]).reshape(-1)
    signs = np.sign(np.bincount(pieces, weights=np.linalg.det(vertices[triangles])))
    assert sorted(signs) == [-1.0] * shape.voids + [1.0]  # one outside; the surface of a void faces inward

    extent = np.ptp(vertices, axis=0)
    assert extent.max() == pytest.approx(2.0, rel=1e-12)
    np.testing.assert_allclose(vertices.min(axis=0), -0.5 * extent, atol=1e-12)  # centred


def test_the_surface_is_one_that_mesh_colliders_take_without_repairs(
    caplog: pytest.LogCaptureFixture,
) -> None:
    for name in ("flask", "worm"):
        vertices, triangles = library_surface(name, 0.03)
        repaired, closed = closed_surface(vertices, triangles, name)
        assert (len(repaired), len(closed)) == (len(vertices), len(triangles))
    assert not [record for record in caplog.records if record.levelname == "WARNING"]


def test_the_hat_is_on_neither_side_and_its_brim_is_sharp() -> None:
    assert not set(SCENE_SHAPES) & set(SHAPES)
    surface = zero_level(find_shape("hat"))
    cell = 2 * 1.3 / 128
    # A point of 65 degrees in an edge of 39: the grid takes the last three cells off.
    assert surface[0][:, 0].max() > BRIM_TIP - 3 * cell
    exact, across = MeshDistance(*surface), BRIM_RADIUS / BRIM_TIP
    normal, tangent = np.array([across, np.sqrt(1 - across**2)]), np.array([np.sqrt(1 - across**2), -across])

    def distance(within: float) -> float:
        """In the middle of the sheet, so far from the straight edge between the disc and the tip."""
        return exact(np.array([[*((BRIM_RADIUS - within) * normal + 0.5 * tangent), 0.0]]))[0]

    # A wedge: its thickness is proportional to the distance from the edge, up to chords of the grid.
    for cells in (2, 4, 8):
        assert -distance(cells * cell) == pytest.approx(
            0.35 * cells * cell / np.sqrt(1 + 0.35**2), abs=0.2 * cell
        )
    assert 0 < distance(-cell) < 3 * cell


def _digest() -> str:
    content = hashlib.sha256()
    for name in ("gear_helical", "boulder", "key"):
        for part in library_surface(name):
            content.update(part.tobytes())
    return content.hexdigest()


def test_another_process_makes_the_same_shapes() -> None:
    code = "from tests.runtime.colliders.test_library import _digest; print(_digest())"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == _digest()


def test_volumes_are_those_of_geometry() -> None:
    """Surfaces within half a cell of 2/64, and mostly far nearer: closed forms to 1 %."""
    for name, of_half_extents in {
        "ball": lambda a, b, c: 4 / 3 * np.pi,
        "egg": lambda a, b, c: 4 / 3 * np.pi * a * b * c,
        "slab": lambda a, b, c: 8 * a * b * c,
        "torus": lambda a, b, c: 2 * np.pi**2 * 0.7 * 0.3**2,
    }.items():
        vertices, triangles = library_surface(name)
        volume = np.linalg.det(vertices[triangles]).sum() / 6
        assert volume == pytest.approx(of_half_extents(*vertices.max(axis=0)), rel=1e-2), name


def _ball(z):
    return np.linalg.norm(z, axis=1) - 1


def _capsule(z):
    return np.linalg.norm(np.column_stack([np.maximum(np.abs(z[:, 0]) - 0.6, 0), z[:, 1:]]), axis=1) - 0.4


def _torus(z):
    return np.hypot(np.hypot(z[:, 0], z[:, 1]) - 0.7, z[:, 2]) - 0.3


def _cushion(z):
    """A box of half extents (1, 0.8, 0.6) with edges of radius 0.25."""
    q = np.abs(z) - (0.75, 0.55, 0.35)
    return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0) - 0.25


@pytest.mark.parametrize("name", ["ball", "capsule", "torus", "cushion"])
def test_the_distance_is_the_closed_form_and_converges(name: str) -> None:
    """Near the surface these are smooth except for jumps of curvature: at least second order."""
    expected = {"ball": _ball, "capsule": _capsule, "torus": _torus, "cushion": _cushion}[name]
    size, errors = 0.03, []
    z = np.random.default_rng(3).uniform(-1.2, 1.2, (20_000, 3))
    z = z[np.abs(expected(z)) < 0.12]
    for resolution in (16, 32):
        collider = library_collider(name, size, resolution)
        assert collider.size == pytest.approx(size, rel=1e-12)
        errors.append(np.sqrt(np.mean((collider.sdf(size * z) / size - expected(z)) ** 2)))
    # Not improved by the grid: the bounds are those of the triangles, within h^2 / 8 r = 4e-4 of the solid's.
    assert errors[1] < 1.5e-3
    assert errors[1] < errors[0] / 3 or errors[1] < 4e-4


def test_a_shape_without_a_closed_form_has_the_distance_of_its_triangles() -> None:
    size = 0.02
    collider = library_collider("octahedron", size, 24)
    z = size * np.random.default_rng(4).uniform(-0.5, 0.5, (2000, 3))
    # Within it, the distance to the nearest of eight planes |x| + |y| + |z| = size; the ridges are rounded over a cell.
    expected = (np.abs(z).sum(axis=1) - size) / np.sqrt(3)
    near_a_face = np.abs(z).min(axis=1) > 2 * collider.spacing
    # Its corners are blunted by a cell of the grid that its triangles come from, so that it is that much too large.
    np.testing.assert_allclose(collider.sdf(z)[near_a_face], expected[near_a_face], atol=size / 40)


def test_an_experiment_names_a_shape_and_its_size() -> None:
    specs = TypeAdapter(list[ColliderSpec])
    by_name, by_entry, part = specs.validate_python(
        [
            {"name": "slab", "shape": "library", "size": 0.03, "resolution": 16},
            {"name": "plate", "shape": "library", "entry": "slab", "size": 0.03, "resolution": 16},
            {
                "name": "both",
                "shape": "union",
                "blend": 0.002,
                "parts": [{"shape": "library", "entry": "slab", "size": 0.03, "resolution": 16}],
            },
        ]
    )
    z = np.random.default_rng(5).uniform(-0.04, 0.04, (50, 3))
    first, second, third = (build_collider(spec) for spec in (by_name, by_entry, part))
    assert (first.name, second.name) == ("slab", "plate")
    np.testing.assert_array_equal(first.sdf(z), second.sdf(z))
    np.testing.assert_array_equal(first.sdf(z), third.sdf(z))
    with pytest.raises(ValidationError, match=r"no shape 'gear_13'; did you mean 'gear_12'"):
        specs.validate_python([{"name": "gear_13", "shape": "library", "size": 0.03}])
    with pytest.raises(SoftprintError, match=r"no shape 'teapot'; it has ball, "):
        library_collider("teapot", 0.03)
