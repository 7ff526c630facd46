"""How deep a collider lies inside a deformed body, without any contact law."""

from __future__ import annotations

import igl
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from softprint.runtime.colliders import Box, Plane, Sphere
from softprint.runtime.colliders.surface_points import POINTS_ALONG, surface_points
from softprint.runtime.contact.intrusion import intrusion, located
from softprint.runtime.mesh import Mesh, box_mesh


def block(dim):
    return box_mesh([0.0] * dim, [0.1] * dim, [6] * dim)


def above(dim, depth, half):
    """Where a collider of half extent `half` is `depth` deep in the middle of the top."""
    at = np.full(dim, 0.05)
    at[-1] = 0.1 + half - depth
    return at


def test_points_lie_on_the_surface_and_cover_it(dim):
    collider = Sphere(0.02, dim)
    points = surface_points(collider)
    assert np.abs(collider.sdf(points)).max() < 1e-12
    spacing = 0.04 / POINTS_ALONG[dim]
    drawn = np.random.default_rng(0).standard_normal((500, dim))
    on_sphere = 0.02 * drawn / np.linalg.norm(drawn, axis=1, keepdims=True)
    distance = np.linalg.norm(on_sphere[:, None] - points, axis=2).min(axis=1)
    assert distance.max() < spacing


def test_edges_corners_and_both_sides_of_a_thin_wall_have_points(dim):
    half = np.array([0.03, 0.0002, 0.02])[:dim]  # thinner than the spacing of points
    wall = Box(half)
    points = surface_points(wall)
    np.testing.assert_allclose(points.max(axis=0), half, atol=wall.rounding)
    np.testing.assert_allclose(points.min(axis=0), -half, atol=wall.rounding)
    corner = half * np.where(np.arange(dim) == 0, -1, 1)
    assert np.linalg.norm(points - corner, axis=1).min() < wall.rounding
    for side in (-1, 1):
        assert (np.abs(points[:, 1] - side * half[1]) < wall.rounding).sum() > 40


def test_a_collider_without_bounds_has_no_points(dim):
    points = surface_points(Plane(np.eye(dim)[-1]))
    assert points.shape == (0, dim)
    assert np.isnan(intrusion(points, block(dim), block(dim).points).depth)


@pytest.mark.parametrize("depth", [0.002, 0.015])
def test_depth_of_a_ball(dim, depth):
    mesh = block(dim)
    points = surface_points(Sphere(0.02, dim)) + above(dim, depth, 0.02)
    found = intrusion(points, mesh, mesh.points)
    # The deepest point of a grid is within half a spacing, sideways, of the lowest point of the ball.
    spacing = 0.04 / POINTS_ALONG[dim]
    assert depth - spacing**2 / 0.04 <= found.depth <= depth + 1e-12
    np.testing.assert_allclose(found.point, above(dim, depth, 0.0), atol=spacing)


def test_a_needle_between_nodes_is_found(dim):
    """No node of the body is inside it, so contact at nodes would see nothing."""
    mesh = block(dim)
    half = np.full(dim, 1e-4)
    half[-1] = 0.03
    needle = Box(half)
    at = above(dim, 0.01, 0.03)
    at[:-1] += 0.0041
    assert needle.sdf(mesh.points - at).min() > 0.0
    assert intrusion(surface_points(needle) + at, mesh, mesh.points).depth == pytest.approx(0.01, abs=1e-5)


def test_a_collider_outside_is_not_in_the_body(dim):
    mesh = block(dim)
    found = intrusion(surface_points(Sphere(0.02, dim)) + above(dim, -0.001, 0.02), mesh, mesh.points)
    assert found.depth == 0.0
    assert np.isnan(found.point).all()


def test_a_point_in_the_box_about_a_body_but_near_no_cell(dim):
    """The body is two blocks far apart."""
    one = box_mesh([0.0] * dim, [0.01] * dim, [2] * dim)
    cells = np.concatenate([one.cells, one.cells + one.n_nodes])
    two = Mesh(np.concatenate([one.points, one.points + 0.2]), cells)
    assert intrusion(np.full((3, dim), 0.1), two, two.points).depth == 0.0


def test_depth_does_not_change_with_a_rigid_motion(dim):
    mesh = block(dim)
    turn = (
        Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
        if dim == 3
        else np.array([[0.6, -0.8], [0.8, 0.6]])
    )
    points = surface_points(Sphere(0.02, dim)) + above(dim, 0.01, 0.02)
    deformed = mesh.points * np.append(np.full(dim - 1, 1.05), 0.95)
    here = intrusion(points, mesh, deformed)
    there = intrusion(points @ turn.T + 1.0, mesh, deformed @ turn.T + 1.0)
    assert here.depth > 0.004  # 5 mm less than in the undeformed block
    assert there.depth == pytest.approx(here.depth, rel=1e-9)


def test_location_agrees_with_the_shape_of_the_body(dim):
    """Of random points, those in a sheared block."""
    mesh = block(dim)
    shear = np.eye(dim)
    shear[0, -1] = 0.4
    points = np.random.default_rng(3).uniform(-0.05, 0.2, (4000, dim))
    back = points @ np.linalg.inv(shear).T
    inside = ((back > 0.0) & (back < 0.1)).all(axis=1)
    np.testing.assert_array_equal(located(points, mesh, mesh.points @ shear.T), inside)


def test_flat_and_inverted_cells_do_no_harm():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    mesh = Mesh(points, np.array([[0, 1, 2], [1, 3, 2]]))
    flat, inverted = points.copy(), points.copy()
    flat[3] = [0.5, 0.5]
    inverted[3] = [0.2, 0.2]
    asked = np.array([[0.15, 0.15], [0.3, 0.3], [0.6, 0.6], [0.9, 0.9]])
    np.testing.assert_array_equal(located(asked, mesh, flat), [True, True, False, False])
    # The second cell has folded over the first: the surface no longer encloses what is under both.
    np.testing.assert_array_equal(located(asked, mesh, inverted), [True, False, False, False])


def test_what_is_inside_is_what_the_surface_winds_around(dim):
    """Against winding numbers, for a body so distorted that many of its cells are inverted."""
    mesh = box_mesh([0.0] * dim, [1.0] * dim, [5] * dim)
    rng = np.random.default_rng(4)
    x = mesh.points + 0.15 * rng.normal(size=mesh.points.shape)
    assert (np.linalg.det(x[mesh.cells[:, 1:]] - x[mesh.cells[:, :1]]) < 0.0).sum() > 0.02 * mesh.n_cells
    asked = rng.uniform(-0.3, 1.3, size=(400, dim))
    winding = igl.winding_number(x, np.ascontiguousarray(mesh.facets), asked)
    np.testing.assert_array_equal(located(asked, mesh, x), np.abs(winding) > 0.5)
