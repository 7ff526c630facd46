"""Defective collider meshes: each is repaired with the right volume, or refused with a clear message."""

from __future__ import annotations

import logging

import numpy as np
import pytest
import trimesh

from softprint.runtime.colliders import load_mesh_collider, mesh_collider
from softprint.runtime.colliders.surface_mesh.examine import examine
from softprint.runtime.errors import SoftprintError

_MADE = trimesh.creation.icosphere(subdivisions=3, radius=0.03)
BALL, FACETS = np.array(_MADE.vertices), np.array(_MADE.faces, dtype=np.int64)
VOLUME = float(_MADE.volume)


def volume(vertices, triangles) -> float:
    return float(np.linalg.det(vertices[triangles]).sum() / 6)


def apart(shrink=0.99):
    """A triangle soup: every triangle separate, and shrunk about its centre."""
    corners = BALL[FACETS]
    middle = corners.mean(axis=1, keepdims=True)
    return (middle + shrink * (corners - middle)).reshape(-1, 3), np.arange(3 * len(FACETS)).reshape(-1, 3)


def half_turned():
    upper = BALL[FACETS].mean(axis=1)[:, 2] > 0
    return BALL, np.where(upper[:, None], FACETS[:, ::-1], FACETS)


def without_area():
    """Degenerate triangles: points, and lines between vertices at the same position."""
    k = np.arange(40)
    points, lines = np.column_stack([k, k, k]), np.column_stack([k, len(BALL) + k, FACETS[k, 0]])
    return np.vstack([BALL, BALL[:40]]), np.vstack([FACETS, points, lines])


def seam_of_doubles():
    """Two halves with separate vertices."""
    return np.vstack([BALL, BALL]), np.where(
        np.arange(len(FACETS))[:, None] < 600, FACETS, FACETS + len(BALL)
    )


REPAIRED = {
    "as it should be": lambda: (BALL, FACETS),
    "every face twice": lambda: (BALL, np.vstack([FACETS, FACETS])),
    "every face twice, one way and the other": lambda: (BALL, np.vstack([FACETS, FACETS[:, ::-1]])),
    "all of it twice": lambda: (np.vstack([BALL, BALL]), np.vstack([FACETS, FACETS + len(BALL)])),
    "two halves that only touch": seam_of_doubles,
    "half of it inside out": half_turned,
    "faces without area": without_area,
    "far from the origin": lambda: (BALL + 1e4, FACETS),
}


@pytest.mark.parametrize("name", REPAIRED)
def test_unambiguous_defects_are_repaired(name: str) -> None:
    vertices, triangles = REPAIRED[name]()
    examined = examine(vertices, triangles, name)
    assert examined.refusal == ""
    # Doubles far away: 1e4 m leaves 2e-12 m of a coordinate, 1e-10 of this ball.
    assert volume(examined.vertices - examined.vertices[0], examined.triangles) == pytest.approx(
        VOLUME, rel=1e-8
    )
    collider = mesh_collider(vertices, triangles, resolution=8)
    centre = 0.5 * (collider.lower + collider.upper)
    assert collider.sdf(centre[None])[0] == pytest.approx(-0.03, rel=0.05)  # a kink there, and facets


@pytest.mark.parametrize("scale", [1e-9, 1e6])
def test_tiny_and_huge_solids_are_that_much_smaller_and_larger(scale: float) -> None:
    """All length tolerances are relative to the solid's size."""
    examined = examine(scale * BALL, FACETS, "scaled")
    assert (examined.refusal, examined.done) == ("", [])
    z = np.random.default_rng(0).uniform(-0.1, 0.1, (500, 3))
    scaled, plain = mesh_collider(scale * BALL, FACETS, 8), mesh_collider(BALL, FACETS, 8)
    # Another unit has different round-off, which may break a tie between two facets.
    np.testing.assert_allclose(scaled.sdf(scale * z) / scale, plain.sdf(z), rtol=0.0, atol=1e-10)


def test_an_implausible_size_is_reported(tmp_path, caplog) -> None:
    trimesh.Trimesh(1000 * BALL, FACETS, process=False).export(tmp_path / "ball.stl")
    with caplog.at_level(logging.WARNING):
        load_mesh_collider(tmp_path / "ball.stl", scale=0.001, resolution=8)
        assert not caplog.records
        load_mesh_collider(tmp_path / "ball.stl", resolution=8)
    assert "a collider of 60 m; if the file is in millimetres, its scale is 0.001" in caplog.text


def figure_of_eight():
    """A tube along (sin t, sin t cos t, 0) that passes through itself in the middle: one closed, oriented surface."""
    around, across, radius = 120, 24, 0.15
    t = np.arange(around) * 2 * np.pi / around
    centre = np.column_stack([np.sin(t), np.sin(t) * np.cos(t), 0 * t])
    along = np.column_stack([np.cos(t), np.cos(2 * t), 0 * t])
    side = np.column_stack([along[:, 1], -along[:, 0], 0 * t]) / np.linalg.norm(along, axis=1)[:, None]
    angle = np.arange(across) * 2 * np.pi / across
    rim = np.cos(angle)[:, None] * side[:, None] + np.sin(angle)[:, None] * np.array([0.0, 0.0, 1.0])
    i, j = (index.ravel() for index in np.meshgrid(np.arange(around), np.arange(across), indexing="ij"))
    a, b = i * across + j, (i + 1) % around * across + j
    c, d = (i + 1) % around * across + (j + 1) % across, i * across + (j + 1) % across
    triangles = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return (centre[:, None] + radius * rim).reshape(-1, 3), triangles


def two_balls():
    return np.vstack([BALL, BALL + np.array([0.02, 0.0, 0.0])]), np.vstack([FACETS, FACETS + len(BALL)])


def spoiled(number):
    vertices = BALL.copy()
    vertices[5, 1] = number
    return vertices


REFUSED = {
    "overlapping solids": (
        two_balls,
        r"\d+ of its 2560 faces lie within the solid or pass through others; join",
    ),
    "a surface through itself": (
        figure_of_eight,
        r"\d+ of its 5760 faces lie within the solid or pass through",
    ),
    "a soup": (apart, "1280 separate pieces"),
    "no triangles": (lambda: (BALL, FACETS[:0]), "no triangles"),
    "one triangle": (lambda: (BALL[FACETS[0]], FACETS[:1] * 0 + np.arange(3)), "the drawing is flat"),
    "not a number": (lambda: (spoiled(np.nan), FACETS), "not finite numbers"),
    "infinite": (lambda: (spoiled(np.inf), FACETS), "not finite numbers"),
    "flat": (lambda: (BALL * (1.0, 1.0, 0.0), FACETS), "the drawing is flat"),
    "all at one point": (lambda: (0 * BALL, FACETS), "all vertices lie at one point"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_an_experiment_refuses_invalid_colliders_with_a_clear_error(name: str) -> None:
    mesh, message = REFUSED[name]
    with pytest.raises(SoftprintError, match=f"^dirty.stl: .*({message})") as caught:
        mesh_collider(*mesh(), resolution=8, source="dirty.stl")
    assert "\n" not in str(caught.value)
    if name in ("overlapping solids", "a surface through itself", "a soup"):
        assert "`softprint collider FILE --out MENDED.stl`" in str(caught.value)


@pytest.mark.parametrize("name", ["a surface through itself", "a soup"])
def test_the_recommended_remedy_works(name: str) -> None:
    vertices, triangles = REFUSED[name][0]()
    examined = examine(vertices, triangles, name)
    collider = mesh_collider(examined.vertices, examined.triangles, resolution=8)
    inside = collider.sdf(
        examined.vertices[examined.triangles].mean(axis=1) - 0.5 * collider.spacing * _out(examined)
    )
    assert (
        inside < 0
    ).mean() > 0.99  # half a cell below the surface is inside, but at some edge of a crossing
    # Facets of 24 to the circle take off 1.1 %, those of the ball none from its own; cells of the rebuilding as much.
    assert volume(examined.vertices, examined.triangles) == pytest.approx(_solid(name), rel=0.03)


def _out(examined):
    corners = examined.vertices[examined.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _solid(name: str) -> float:
    """The volume [m^3]; of the tube by Pappus, less what two round bars share that cross at a right angle."""
    if name == "a soup":
        return VOLUME
    t = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    length = 2 * np.pi * np.hypot(np.cos(t), np.cos(2 * t)).mean()
    return float(np.pi * 0.15**2 * length - 16 / 3 * 0.15**3)
