"""Mesh and polygon colliders: distances against closed forms, smoothness, repairs and refusals."""

import logging
from pathlib import Path

import numpy as np
import pytest
import trimesh

from softprint.runtime.colliders import (
    GridCollider,
    load_mesh_collider,
    load_polygon,
    mesh_collider,
    polygon_collider,
)
from softprint.runtime.colliders.sampled.spline import SplineGrid
from softprint.runtime.colliders.surface_mesh.mesh_collider import read_surface
from softprint.runtime.colliders.surface_mesh.repair import closed_surface
from softprint.runtime.errors import SoftprintError

MESHES = Path(__file__).parents[3] / "meshes"
POINTY_TIP = 0.006


def ball(radius: float = 0.03):
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    return np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int64)


@pytest.fixture(scope="module")
def pointy() -> GridCollider:
    return load_mesh_collider(MESHES / "pointy.stl", resolution=32)


@pytest.fixture(scope="module")
def star() -> GridCollider:
    return polygon_collider(load_polygon(MESHES / "star.txt"), rounding=0.005)


@pytest.mark.parametrize("dim", [2, 3])
def test_spline_is_fourth_order_and_exact_on_its_nodes(dim):
    def f(z):
        return np.cos(z).prod(axis=-1)

    errors = []
    for cells in (8, 16):
        h = np.pi / cells  # cos mirrors about both ends of [0, pi], as the spline's boundary does
        nodes = h * np.stack(np.meshgrid(*[np.arange(cells + 1)] * dim, indexing="ij"), axis=-1)
        grid = SplineGrid(f(nodes), np.zeros(dim), h)
        np.testing.assert_allclose(grid.value(nodes.reshape(-1, dim)), f(nodes).ravel(), atol=1e-12)
        z = np.random.default_rng(1).uniform(0, np.pi, (500, dim))
        np.testing.assert_allclose(grid.derivatives(z).value, grid.value(z), atol=1e-14)
        errors.append(np.abs(grid.value(z) - f(z)).max())
    assert errors[0] / errors[1] > 2**3.5  # order 4, less sampling noise of the maximum


@pytest.mark.parametrize("dim", [2, 3])
def test_spline_is_nowhere_below_the_bound_by_its_coefficients(dim):
    rng = np.random.default_rng(2)
    grid = SplineGrid(
        rng.normal(size=(6, 7, 8)[:dim]), rng.normal(size=dim), 0.5
    )  # as rough as a grid can be
    z = rng.uniform(grid.origin, grid.upper, (2000, dim))
    z[:2] = grid.origin, grid.upper  # the first and the last cell too
    value, least = grid.value(z), grid.at_least(z)
    assert (least <= value + 1e-14).all()
    assert least.min() > grid._coefficients.min() - 1e-14  # a bound of the cell, not of nothing
    assert len(np.unique(least)) > 5


@pytest.mark.parametrize("name", ["pointy", "star"])
@pytest.mark.parametrize(
    "share", [-0.1, 0.0, 0.1, 0.3, 1.0, 4.0]
)  # of the size: within the fine grid and beyond
def test_closer_finds_what_the_distance_of_all_points_finds(name, share, request):
    collider = request.getfixturevalue(name)
    centre = 0.5 * (collider.lower + collider.upper)
    z = centre + np.random.default_rng(6).uniform(-3, 3, (4000, collider.dim)) * collider.size
    index, value = collider.closer(z, share * collider.size)
    expected = collider.sdf(z)
    np.testing.assert_array_equal(index, np.flatnonzero(expected < share * collider.size))
    np.testing.assert_allclose(value, expected[index], rtol=0.0, atol=1e-15)  # one formula, in other chunks


@pytest.mark.parametrize("name", ["pointy", "star"])
@pytest.mark.parametrize(
    "reach", [1.0, 1.6, 3.0, 6.0]
)  # fine, its blend, coarse, its blend with the ball; in sizes
def test_gradient_and_hessian_by_finite_differences(name, reach, request):
    collider = request.getfixturevalue(name)
    centre = 0.5 * (collider.lower + collider.upper)
    z = centre + np.random.default_rng(5).uniform(-reach, reach, (800, collider.dim)) * collider.size
    d, step = collider.sdf_derivatives(z), 1e-7
    np.testing.assert_allclose(collider.sdf(z), d.value, atol=1e-15)
    for j, e in enumerate(step * np.eye(collider.dim)):
        slope = (collider.sdf(z + e) - collider.sdf(z - e)) / (2 * step)
        np.testing.assert_allclose(
            d.gradient[:, j], slope, atol=1e-6
        )  # round-off: 1e-17 / 1e-7, with a margin
        forward, backward = collider.sdf_derivatives(z + e), collider.sdf_derivatives(z - e)
        column = (forward.gradient - backward.gradient) / (2 * step)
        # the third derivative jumps between cells: error up to curvature change over a step / cell
        scale = np.abs(d.hessian).max()
        np.testing.assert_allclose(d.hessian[:, :, j], column, atol=1e-3 * scale)


def test_ball_mesh_against_the_closed_form():
    vertices, triangles = ball()
    collider = mesh_collider(vertices, triangles, resolution=32)
    z = np.random.default_rng(2).uniform(-0.045, 0.045, (2000, 3))
    radius = np.linalg.norm(z, axis=1)
    off_centre = radius > 0.01  # the kink at the centre is rounded over about a cell of 2 mm
    # the facets of 1,280 triangles lie up to 0.15 mm inside the sphere; the grid adds a tenth of that
    np.testing.assert_allclose(collider.sdf(z)[off_centre], radius[off_centre] - 0.03, atol=2e-4)
    normals = collider.sdf_derivatives(z).gradient
    expected = z / radius[:, None]
    near = np.abs(radius - 0.03) < 0.01  # deeper, facets meet in medial sheets of their own
    np.testing.assert_allclose(normals[near], expected[near], atol=0.1)  # facets tilt by up to 0.08 rad


def test_far_away_the_distance_is_continued():
    collider = mesh_collider(*ball(), resolution=16)
    z = np.array([[0.5, 0.0, 0.0], [0.3, -0.4, 0.2], [1.0, 1.0, 1.0]])
    expected = np.linalg.norm(z, axis=1) - 0.03
    np.testing.assert_allclose(collider.sdf(z), expected, rtol=0.02)
    gradient = collider.sdf_derivatives(z).gradient
    np.testing.assert_allclose(np.linalg.norm(gradient, axis=1), 1.0, atol=1e-12)


def test_pointy_is_what_the_examples_need(pointy):
    accuracy = pointy.accuracy(np.random.default_rng(0), points=4000)
    assert accuracy["surface_rms"] < 0.02 * pointy.spacing
    assert accuracy["surface_max"] < 0.1 * pointy.spacing
    assert accuracy["gradient_rms"] < 0.05  # facets: the surface itself turns by about this between triangles
    assert 0.025 < pointy.size < 0.035
    assert (MESHES / "pointy.stl").stat().st_size < 250_000
    # blunt: no sharper than its tips, up to the facets of the decimated mesh
    corners = pointy.vertices[pointy.facets]
    surface = corners.mean(axis=1)
    curvature = np.linalg.eigvalsh(pointy.sdf_derivatives(surface).hessian)[:, -1]
    assert np.quantile(curvature, 0.95) < 2 / POINTY_TIP


def test_star_is_blunt_and_exact(star):
    accuracy = star.accuracy(np.random.default_rng(0), points=4000)
    assert accuracy["surface_max"] < 0.02 * star.spacing
    reach = np.linalg.norm(star.vertices, axis=1).max()
    assert 0.028 < reach < 0.033
    inside = star.sdf_derivatives(star.vertices)
    curvature = np.trace(inside.hessian, axis1=1, axis2=2)
    assert np.abs(curvature).max() < 1.5 / 0.005  # a rounding of 5 mm, smoothed by a grid of 0.6 mm


def test_polygon_distance_of_a_square_by_hand():
    square = polygon_collider([[0, 0], [0, 1], [1, 1], [1, 0]], resolution=32)  # clockwise: turned
    z = np.array([[0.5, 0.2], [0.5, -0.2], [1.3, 1.4], [0.05, 0.5]])
    np.testing.assert_allclose(square.exact(z), [-0.2, 0.2, 0.5, -0.05], atol=1e-14)
    rounded = polygon_collider([[0, 0], [1, 0], [1, 1], [0, 1]], rounding=0.2, resolution=32)
    corner = np.sqrt(2) * 0.2 - 0.2  # distance of the fillet from the old corner
    np.testing.assert_allclose(
        rounded.exact(np.array([[1.0, 1.0]])), [corner], atol=1e-4
    )  # chords of 3 degrees


def test_sides_of_a_polygon_may_lie_on_one_line():
    """As the ends of the teeth of a comb do; they cross where they overlap."""
    comb = [[0, 0], [1, 0], [1, 1], [2, 1], [2, 0], [3, 0], [3, 2], [0, 2]]
    collider = polygon_collider(comb, resolution=32)
    z = np.array([[0.5, -0.1], [1.5, 0.5], [2.5, 0.2]])
    np.testing.assert_allclose(collider.exact(z), [0.1, 0.5, -0.2], atol=1e-14)
    with pytest.raises(SoftprintError, match="cross"):
        polygon_collider([[0, 0], [2, 0], [2, 1], [1.5, 0], [0.5, 0], [0, 1]])


@pytest.mark.parametrize(
    ("vertices", "rounding", "message"),
    [
        ([[0, 0], [1, 0]], 0.0, "at least three"),
        ([[0, 0], [1, 1], [1, 0], [0, 1]], 0.0, "cross"),
        ([[0, 0], [1, 0], [1, 1], [0, 1]], 0.6, "at most 0.5"),
        ([[0, 0], [1, np.nan], [1, 1]], 0.0, "finite"),
    ],
)
def test_polygon_refusals(vertices, rounding, message):
    with pytest.raises(SoftprintError, match=message):
        polygon_collider(vertices, rounding)


def volume(vertices, triangles) -> float:
    return float(np.linalg.det(vertices[triangles]).sum() / 6)


def test_inward_surfaces_are_flipped_and_reported(caplog):
    vertices, triangles = ball()
    with caplog.at_level(logging.WARNING):
        v, t = closed_surface(vertices, triangles[:, ::-1], "ball.stl")
    assert volume(v, t) > 0
    assert "ball.stl: flipped an inward-facing surface outward" in caplog.text


def test_mixed_orientation_is_made_consistent():
    vertices, triangles = ball()
    flipped = triangles.copy()
    flipped[::3] = flipped[::3, ::-1]
    assert volume(*closed_surface(vertices, flipped, "ball")) == pytest.approx(volume(vertices, triangles))


def test_soup_duplicates_and_degenerate_triangles_are_cleaned(caplog):
    vertices, triangles = ball()
    soup = vertices[triangles].reshape(-1, 3)
    index = np.arange(len(soup)).reshape(-1, 3)
    index = np.vstack([index, index[:1], [[0, 0, 1]]])  # one repeated, one degenerate
    v, t = closed_surface(soup, index, "soup")
    assert (len(v), len(t)) == (len(vertices), len(triangles))
    assert "1 degenerate" in caplog.text
    assert "1 repeated" in caplog.text


def test_a_small_hole_is_closed_and_a_large_one_refused(caplog):
    vertices, triangles = ball()
    v, t = closed_surface(vertices, triangles[1:], "ball")
    assert volume(v, t) == pytest.approx(volume(vertices, triangles), rel=0.01)
    assert "closed a hole" in caplog.text
    upper = triangles[vertices[triangles].mean(axis=1)[:, 2] > 0]
    with pytest.raises(SoftprintError, match=r"open: \d+ edge"):
        closed_surface(vertices, upper, "half")


def test_a_cavity_stays_a_cavity():
    outer, faces = ball(0.03)
    inner, _ = ball(0.01)
    v, t = closed_surface(np.vstack([outer, inner]), np.vstack([faces, faces + len(outer)]), "shell")
    assert volume(v, t) == pytest.approx(volume(outer, faces) - volume(inner, faces))


def test_refusals():
    vertices, triangles = ball()
    bad = vertices.copy()
    bad[3, 0] = np.nan
    with pytest.raises(SoftprintError, match="1 vertices are not finite"):
        closed_surface(bad, triangles, "m")
    with pytest.raises(SoftprintError, match="no triangles"):
        closed_surface(vertices, triangles[:0], "m")
    finned = np.vstack([triangles, [[triangles[0, 0], triangles[0, 1], len(vertices)]]])
    with pytest.raises(SoftprintError, match="non-manifold"):
        closed_surface(np.vstack([vertices, [[0.04, 0.0, 0.0]]]), finned, "m")
    flat = np.c_[np.random.default_rng(0).normal(size=(5, 1)), np.zeros((5, 2))]
    with pytest.raises(SoftprintError, match="degenerate"):
        closed_surface(flat, np.array([[0, 1, 2], [2, 3, 4]]), "m")


def test_a_moebius_strip_is_refused():
    count = 12
    angle = np.arange(count) * 2 * np.pi / count
    rim = [
        np.c_[
            (1 + s * np.cos(angle / 2)) * np.cos(angle),
            (1 + s * np.cos(angle / 2)) * np.sin(angle),
            s * np.sin(angle / 2),
        ]
        for s in (-0.3, 0.3)
    ]
    pairs = [(i, i + count, i + 1, i + 1 + count) for i in range(count - 1)] + [
        (count - 1, 2 * count - 1, count, 0)
    ]
    strip = np.array([t for a, b, c, d in pairs for t in ((a, b, c), (b, d, c))])
    with pytest.raises(SoftprintError, match=r"one side|open"):
        closed_surface(np.vstack(rim), strip, "strip")


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply"])
def test_files_of_every_kind_give_the_same_solid(tmp_path, suffix):
    vertices, triangles = ball()
    path = tmp_path / f"ball.{suffix}"
    trimesh.Trimesh(1000 * vertices, triangles, process=False).export(path)
    collider = load_mesh_collider(path, scale=0.001, resolution=8)
    np.testing.assert_allclose(collider.upper, vertices.max(axis=0), rtol=1e-6)  # float32 in STL


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("missing.stl", None, "no such"),
        ("truncated.stl", b"", r"cannot be read|no triangles"),
        ("cut.stl", "half", r"cannot be read|no triangles"),
        ("words.ply", b"this is no mesh", r"cannot be read|no triangles"),
        ("shape.step", b"", "STL, OBJ or PLY"),
    ],
)
def test_bad_files_are_named(tmp_path, name, content, message):
    path = tmp_path / name
    if content == "half":
        whole = (MESHES / "pointy.stl").read_bytes()
        content = whole[: len(whole) // 2]
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SoftprintError, match=message) as caught:
        load_mesh_collider(path)
    assert name in str(caught.value)


@pytest.mark.parametrize("name", ["pointy", "star"])
def test_a_nan_point_has_no_distance_and_does_not_affect_others(name, request):
    collider = request.getfixturevalue(name)
    z = np.tile(0.5 * (collider.lower + collider.upper), (3, 1))
    z[1, 0] = np.nan
    for value in (collider.sdf(z), collider.fine.grid.value(z), collider.fine.grid.derivatives(z).value):
        assert np.isnan(value[1])
        assert value[0] == value[2] < 0.0


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_triangle_strips_of_ply_files_are_read(tmp_path, form):
    """The same triangles, facing the same way, as the mesh that the strips were made of: a tetrahedron as one strip of
    four triangles, and three as strips of their own."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype="<f4")
    strips = [[0, 2, 1, 3, 0, 2], [0, 2, 1, -1, 0, 1, 3, -1, 1, 2, 3, -1, 2, 0, 3]]
    for number, strip in enumerate(strips):
        head = f"ply\nformat {form} 1.0\nelement vertex 4\n"
        head += "".join(f"property float {axis}\n" for axis in "xyz")
        head += "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
        file = tmp_path / f"{number}.ply"
        if form == "ascii":
            rows = [" ".join(map(str, vertex)) for vertex in vertices]
            file.write_text(head + "\n".join([*rows, " ".join(map(str, [len(strip), *strip]))]) + "\n")
        else:
            content = vertices.tobytes() + np.array([len(strip), *strip], "<i4").tobytes()
            file.write_bytes(head.encode() + content)
        found, triangles = read_surface(file)
        np.testing.assert_array_equal(found, vertices)
        mesh = trimesh.Trimesh(found, triangles, process=False)
        assert mesh.is_watertight
        assert mesh.volume == pytest.approx(1 / 6)  # positive: outward
