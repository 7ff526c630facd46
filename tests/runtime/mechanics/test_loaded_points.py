"""Contact points on facets: they tile the surface, and their compliance is that of the nodes that they lie between."""

import numpy as np
import pytest

from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mechanics.compliance.interpolated_compliance import InterpolatedCompliance
from softprint.runtime.mechanics.compliance.local_compliance import LocalCompliance
from softprint.runtime.mechanics.compliance.surface_compliance_kernels import NodalCompliance
from softprint.runtime.mechanics.loaded_points import LoadedPoints
from softprint.runtime.mesh.mesh import facet_vectors

EVERY_NODE = 10_000


SOME = {2: 12, 3: 40}  # by dimension


@pytest.fixture(params=[False, True], ids=["every node", "some nodes"])
def compliance(jelly_body, dim, request):
    count = SOME[dim] if request.param else EVERY_NODE
    return compute_mechanics(jelly_body, count, condensation=False).surface_compliance


@pytest.fixture(params=[1, 3])
def points(jelly_body, compliance, request):
    return LoadedPoints.of_compliance(jelly_body, compliance, request.param)


def dense(of: NodalCompliance, dim: int):
    """N G N^T (m*dim, m*dim) [m/N]."""
    G, corners, shares = of
    at = G.reshape(-1, dim, len(G) // dim, dim)[corners[:, :, None, None], :, corners, :]
    size = len(corners) * dim
    return np.einsum("pa,paqbij,qb->piqj", shares, at, shares).reshape(size, size)


def outside_frames(body):
    """The facets that are not entirely in rigid frames."""
    rigid = np.isin(body.mesh.facets, body.handles.frame_nodes)
    return body.mesh.facets[~rigid.all(axis=1)]


def test_points_tile_the_surface_outside_rigid_frames(jelly_body, points):
    area = np.linalg.norm(facet_vectors(jelly_body.mesh.points, outside_frames(jelly_body)), axis=1).sum()
    assert points.areas.sum() == pytest.approx(area, rel=1e-12)  # the same numbers in another order
    assert (points.areas > 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(points.normals, axis=1), 1.0, rtol=1e-12)


def test_where_every_node_is_a_contact_node_points_are_middles_and_corners(jelly_body, dim):
    compliance = compute_mechanics(jelly_body, EVERY_NODE, condensation=False).surface_compliance
    points, facets = (
        LoadedPoints.of_compliance(jelly_body, compliance, points=1),
        outside_frames(jelly_body),
    )
    middles, corners = points.take(slice(len(facets))), points.take(slice(len(facets), None))
    np.testing.assert_array_equal(middles.corners, facets)
    rigid = np.isin(facets, jelly_body.handles.frame_nodes)
    np.testing.assert_allclose(middles.shares, np.where(rigid, 0.0, 1.0 / dim), rtol=1e-15)
    np.testing.assert_array_equal(compliance.nodes[middles.nodes][~rigid], facets[~rigid])
    # Without nodes on edges of the body, whose facets are turned from their mean normal.
    mesh = jelly_body.mesh
    normals = mesh.facet_vectors / np.linalg.norm(mesh.facet_vectors, axis=1, keepdims=True)
    smooth = []
    for node in compliance.nodes:
        mean = mesh.surface_normals[mesh.surface_nodes == node][0]
        smooth.append((normals[(mesh.facets == node).any(axis=1)] @ mean > 0.866).all())
    assert 0.3 < np.mean(smooth) < 1.0
    even = facets[np.isin(facets, compliance.nodes[smooth]).all(axis=1)]
    np.testing.assert_array_equal(corners.corners[:, 0], np.unique(even))
    np.testing.assert_array_equal(corners.shares, np.tile(np.eye(1, dim), (len(corners), 1)))


def test_middles_and_corners_integrate_what_is_quadratic_on_a_facet(jelly_body, dim):
    """Simpson's rule, against one of two points in a line, or of the middles of the edges of a triangle."""
    body, facets = jelly_body, jelly_body.mesh.facets
    compliance = compute_mechanics(body, EVERY_NODE, condensation=False).surface_compliance
    points, rng = LoadedPoints.of_compliance(body, compliance, points=1), np.random.default_rng(0)
    corners = points.corners[points.weights[:, 0] == 1.0, 0]
    uneven = facets[~np.isin(facets, corners).all(axis=1)]
    inside = np.setdiff1d(corners, uneven)  # beside facets with corners alone
    assert len(inside) > 2
    values = np.zeros(body.n_nodes)  # linear on each facet, so that the square is quadratic
    values[inside] = rng.normal(size=len(inside))

    def squared(nodes, weights):
        return np.square((values[nodes] * weights).sum(axis=1))

    if dim == 3:
        rule = [np.array(weights) / 2.0 for weights in ([1, 1, 0], [1, 0, 1], [0, 1, 1])]
    else:
        rule = [np.array([0.5 + along, 0.5 - along]) for along in (-0.5 / 3**0.5, 0.5 / 3**0.5)]
    size = np.linalg.norm(facet_vectors(body.mesh.points, facets), axis=1)
    expected = sum((size * squared(facets, weights)).sum() for weights in rule) / len(rule)
    assert (points.areas * squared(points.corners, points.weights)).sum() == pytest.approx(
        expected, rel=1e-12
    )


def test_of_few_contact_nodes_points_lie_between_different_ones(jelly_body, dim):
    count = SOME[dim]
    compliance = compute_mechanics(jelly_body, count, condensation=False).surface_compliance
    points = LoadedPoints.of_compliance(jelly_body, compliance, points=1)
    assert set(points.nodes[points.shares > 0.0]) == set(range(count))
    corners = points.take(points.weights[:, 0] == 1.0)
    assert (corners.shares[:, 0] == 1.0).all()
    assert 0 < len(corners) <= count
    np.testing.assert_array_equal(compliance.nodes[corners.nodes[:, 0]], corners.corners[:, 0])
    middles = points.take(points.weights[:, 0] < 1.0)
    between = [
        frozenset(nodes[shares > 0.0]) for nodes, shares in zip(middles.nodes, middles.shares, strict=True)
    ]
    assert len(set(between)) == len(between)
    # A closed triangulation has twice as many triangles as nodes, a polygon as many edges; this one has an edge.
    assert 0.6 < len(middles) / ((dim - 1) * count) < 1.4


def test_points_move_with_their_facets(jelly_body, points):
    material, rng = points.material(jelly_body), np.random.default_rng(0)
    rows = jelly_body.rest_rows + 1e-3 * rng.normal(size=jelly_body.rest_rows.shape)
    x = jelly_body.reduced_positions(rows)
    for found, at_nodes in ((material.basis @ rows, x), (material.rest, jelly_body.mesh.points)):
        expected = (points.weights[..., None] * at_nodes[points.corners]).sum(axis=1)
        np.testing.assert_allclose(found, expected, atol=1e-15)
    np.testing.assert_allclose(points.weights.sum(axis=1), 1.0, rtol=1e-15)


def test_compliance_among_points_is_that_of_the_forces_on_nodes(jelly_body, compliance, points, dim):
    """The energy of forces on points is that of the same forces on the contact nodes, and reciprocity is exact."""
    rng, all_pairs = np.random.default_rng(1), compliance.among_nodes()
    local = InterpolatedCompliance(LocalCompliance(all_pairs), points)
    index = np.sort(rng.permutation(len(points))[:10])
    G, forces = dense(local.among(index), dim), rng.normal(size=(10, dim))
    # The same sums of at most nine terms, in double precision.
    rounding = 1e-13 * np.abs(G).max()
    np.testing.assert_allclose(G, G.T, rtol=0.0, atol=rounding)
    others = dense(local.among(index[3:]), dim)
    np.testing.assert_allclose(others, G[3 * dim :, 3 * dim :], rtol=0.0, atol=rounding)
    some = local.among(index).taken(np.arange(3, 10), dim)
    np.testing.assert_allclose(dense(some, dim), G[3 * dim :, 3 * dim :], rtol=0.0, atol=rounding)
    assert len(some.among_nodes) == dim * len(points.among(index[3:])[0])  # the nodes at their corners alone
    at = np.sort(rng.permutation(len(points))[:10])
    both = np.union1d(at, index)
    by_all = dense(local.among(both), dim).reshape(-1, dim, len(both), dim)
    here, there = (np.searchsorted(both, own) for own in (at, index))
    moved = np.einsum("iajb,jb->ia", by_all[here][:, :, there], forces)
    # Rounded to float32.
    np.testing.assert_allclose(
        local.displacement(at, *local.on_nodes(index, forces)),
        moved,
        rtol=1e-4,
        atol=1e-5 * np.abs(moved).max(),
    )
    nodes, onto = points.to_nodes(index, forces)
    expected = np.einsum("ia,ijab,jb", onto, all_pairs[nodes[:, None], nodes].astype(np.float64), onto)
    # Rounded to float32.
    assert forces.ravel() @ G @ forces.ravel() == pytest.approx(expected, rel=1e-5)


def test_the_contact_nodes_as_points_are_themselves(jelly_body, compliance, dim):
    points = LoadedPoints.of_compliance(jelly_body, compliance, points=0)
    index, forces = np.array([1, 4, 7]), np.random.default_rng(2).normal(size=(3, dim))
    for found, expected in zip(points.to_nodes(index, forces), (index, forces), strict=True):
        np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(points.corners[:, 0], compliance.nodes)
    nodes, corners, shares = points.among(index)
    np.testing.assert_array_equal(nodes[corners[:, 0]], index)
    assert (shares == 1.0).all()
