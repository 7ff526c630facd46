"""Tips, edges and thin limbs of a collider against the surface of a body: which points, the search, and the energy."""

from __future__ import annotations

import igl
import numpy as np
import pytest

from softprint.runtime.colliders import Box, Plane, RigidPose, Sphere
from softprint.runtime.colliders.sharp_points import sharp_points
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.sharp_contact import SharpContact
from softprint.runtime.mesh import box_mesh
from softprint.runtime.mesh.nearest_facets import SurfaceSearch, grouped_by_place, nearest_of

EDGE, PARTS = 0.1, 5
LAW = PenaltyContact(1e10, refinement=2)


def block(dim):
    """A block of some cells, deformed."""
    mesh = box_mesh([0.0] * dim, [EDGE] * dim, [PARTS] * dim)
    return mesh, mesh.points + 2e-3 * np.random.default_rng(1).standard_normal(mesh.points.shape)


def rotation(dim, angle):
    turn = np.eye(dim)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return turn


def plate(dim):
    """1 mm thick, upright."""
    return Box(np.array([0.0005, 0.02, 0.02])[[0, 2]] if dim == 2 else np.array([0.0005, 0.02, 0.02]))


def pressed_in(dim):
    """A pose in which the lower edge of the plate is 4 mm deep in the top, askew."""
    at = np.full(dim, 0.047)
    at[-1] = EDGE + 0.016
    turn = rotation(dim, 0.1) if dim == 3 else np.eye(2)
    return RigidPose(turn, at)


def nearest_by_hand(points, x, facets):
    """Distance from segments, one by one."""
    start, way = x[facets[:, 0]], x[facets[:, 1]] - x[facets[:, 0]]
    share = ((points[:, None] - start) * way).sum(axis=2) / (way**2).sum(axis=1)
    foot = start + np.clip(share, 0.0, 1.0)[..., None] * way
    return np.linalg.norm(points[:, None] - foot, axis=2).min(axis=1)


def test_nearest_point_of_a_surface(dim):
    mesh, x = block(dim)
    rng = np.random.default_rng(2)
    on_edges = x[mesh.facets[:, :2]].mean(axis=1)
    points = np.concatenate(
        [
            rng.uniform(-0.05, 0.15, (300, dim)),
            x[mesh.surface_nodes] + 1e-4 * rng.standard_normal((len(mesh.surface_nodes), dim)),
            on_edges + 1e-4 * rng.standard_normal(on_edges.shape),
        ]
    )
    search = SurfaceSearch(mesh.points, mesh.facets)
    facet, weights, depth = search.nearest(points, x)
    foot = (weights[..., None] * x[mesh.facets[facet]]).sum(axis=1)
    np.testing.assert_allclose(np.linalg.norm(points - foot, axis=1), np.abs(depth), atol=1e-15)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=1e-14)
    assert (weights >= 0.0).all()
    if dim == 3:
        exact = -igl.signed_distance(points, x, mesh.facets.astype(np.int64))[0]
    else:
        # the winding number of the closed polygon says which side
        around = x[mesh.facets] - points[:, None, None]
        angle = np.arctan2(*np.moveaxis(around, -1, 0)[::-1])
        turned = np.diff(angle, axis=2)[..., 0]
        winding = ((turned + np.pi) % (2 * np.pi) - np.pi).sum(axis=1)
        exact = nearest_by_hand(points, x, mesh.facets) * np.where(np.abs(winding) > np.pi, 1.0, -1.0)
    np.testing.assert_allclose(depth, exact, atol=1e-12)  # closed surfaces, so no side is in doubt
    # where the search begins has no effect on what it finds
    begun = search.nearest(points, x, np.random.default_rng(3).integers(0, len(mesh.facets), len(points)))
    np.testing.assert_allclose(begun.depth, depth, atol=1e-15)
    # nor has whether facets are searched in groups, or one by one
    order, group = grouped_by_place(x[mesh.facets].mean(axis=1))
    facets = mesh.facets[order]
    first, own = grouped_by_place(points)
    points, depth, beyond = points[first], depth[first], 0.01
    near = depth > -beyond
    for groups in (None, (group, np.arange(len(points))), (group, own)):
        np.testing.assert_allclose(nearest_of(points, x, facets, groups).depth, depth, atol=1e-15)
        # of points far outside it is only said that they are
        limited = nearest_of(points, x, facets, groups, beyond)
        np.testing.assert_allclose(limited.depth[near], depth[near], atol=1e-15)
        assert (limited.depth[~near] < -beyond).all()
    assert dim == 2 or (limited.depth < depth - 1e-6).any()
    begun = search.nearest(
        points, x, np.random.default_rng(4).integers(0, len(mesh.facets), len(points)), beyond
    )
    np.testing.assert_allclose(begun.depth[near], depth[near], atol=1e-15)
    assert (begun.depth[~near] < -beyond).all()
    assert (begun.depth < depth - 1e-6).any()


@pytest.mark.parametrize("flat", ["two corners in one place", "all", "corners in a line", "nearly"])
def test_nearest_point_of_a_facet_without_area(flat):
    """A facet that a deformation has flattened is its edges."""
    rng, facet, sides = np.random.default_rng(6), np.arange(3), np.array([[0, 1], [1, 2], [2, 0]])
    for _ in range(50):
        x, points = rng.normal(size=(3, 3)), 2.0 * rng.normal(size=(5, 3))
        one, other, _ = rng.permutation(3)
        if flat == "two corners in one place":
            x[one] = x[other]
        elif flat == "all":
            x[:] = x[0]
        elif flat == "corners in a line":
            x[2] = x[0] + rng.uniform(-1.0, 2.0) * (x[1] - x[0])
        else:
            x[one] = x[other] + 1e-9 * rng.normal(size=3)
        found = nearest_of(points, x, facet[None])
        foot = found.weights @ x
        np.testing.assert_allclose(np.linalg.norm(points - foot, axis=1), np.abs(found.depth), atol=1e-12)
        long = sides[np.linalg.norm(x[sides[:, 1]] - x[sides[:, 0]], axis=1) > 0.0]
        exact = nearest_by_hand(points, x, long) if len(long) else np.linalg.norm(points - x[0], axis=1)
        # The last kind is a billionth of its length wide.
        np.testing.assert_allclose(np.abs(found.depth), exact, atol=1e-8)


def test_which_points_are_sharp(dim):
    spacing = 0.003
    # a ball is sharp if its radius is less than the spacing; a plane never
    assert len(sharp_points(Sphere(0.01, dim), spacing)) == 0
    assert len(sharp_points(Sphere(0.002, dim), spacing)) > 0
    assert len(sharp_points(Plane(np.eye(dim)[-1]), spacing)) == 0
    corners = 0.01
    points = sharp_points(Box(np.full(dim, corners), 1e-5), spacing)
    # of a box the edges alone: at least dim - 1 coordinates on the faces
    assert (np.isclose(np.abs(points), corners, atol=1e-5).sum(axis=1) >= dim - 1).all()
    from_corner = np.linalg.norm(np.abs(points) - corners, axis=1)
    assert (from_corner < 1e-5).sum() == 2**dim
    if dim == 3:
        edges = 12 * 2 * corners
        assert 0.6 * edges / spacing < len(points) < 1.6 * edges / spacing
    apart = np.linalg.norm(points[:, None] - points, axis=2)[~np.eye(len(points), dtype=bool)]
    assert apart.min() > 0.5 * spacing


def test_gradient_and_hessian_are_derivatives_of_the_energy(dim):
    mesh, x = block(dim)
    sharp, pose = SharpContact(plate(dim), LAW, mesh), pressed_in(dim)
    terms = sharp.terms(x, pose)
    # nearest points in facets, and in 3D on edges
    kinds = (terms.points.shares > 0.0).sum(axis=1)
    assert len(terms.depth) > 0
    assert kinds.max() == dim
    rng = np.random.default_rng(4)
    gradient = terms.points.gradient(terms.gradient, len(x))
    blocks, nodes = terms.hessian(x), terms.points.nodes
    for _ in range(3):
        along, step = rng.standard_normal(x.shape), 1e-8
        before, after = (sharp.terms(x + sign * step * along, pose) for sign in (-1, 1))
        # central differences over 1e-8 m of depths of a millimetre
        assert np.vdot(gradient, along) == pytest.approx(
            (after.energy - before.energy) / (2 * step), rel=1e-5
        )
        slopes = [one.points.gradient(one.gradient, len(x)) for one in (before, after)]
        curved = np.zeros_like(x)
        np.add.at(curved, nodes, np.einsum("mijab,mjb->mia", blocks, along[nodes]))
        np.testing.assert_allclose(
            curved, (slopes[1] - slopes[0]) / (2 * step), atol=1e-5 * np.abs(curved).max()
        )


def test_gradient_and_hessian_on_edges_and_corners(dim):
    """Points below the edges and corners of a convex dent, where the nearest facet changes without a jump."""
    mesh, x = block(dim)
    tip = np.flatnonzero(
        np.isclose(mesh.points, EDGE)[:, -1] & (np.abs(mesh.points - 0.5 * EDGE)[:, :-1] < 0.011).all(axis=1)
    )
    x = mesh.points.copy()
    x[tip[0], -1] -= 0.004
    around = x[tip[0]] + 1e-3 * np.random.default_rng(5).standard_normal((200, dim))
    search = SurfaceSearch(mesh.points, mesh.facets)
    _, weights, depth = search.nearest(around, x)
    kinds = (weights > 0.0).sum(axis=1)[depth > 0.0]
    assert set(kinds) == set(range(1, dim + 1))
    sharp = SharpContact(Sphere(1e-3, dim), LAW, mesh)
    sharp._points, sharp._near = around, np.zeros(len(around), dtype=np.int64)
    pose = RigidPose(np.eye(dim), np.zeros(dim))
    terms = sharp.terms(x, pose)
    along, step = np.random.default_rng(6).standard_normal(x.shape), 1e-9
    before, after = (sharp.terms(x + sign * step * along, pose) for sign in (-1, 1))
    gradient = terms.points.gradient(terms.gradient, len(x))
    assert np.vdot(gradient, along) == pytest.approx((after.energy - before.energy) / (2 * step), rel=1e-5)
    curved = np.zeros_like(x)
    np.add.at(
        curved, terms.points.nodes, np.einsum("mijab,mjb->mia", terms.hessian(x), along[terms.points.nodes])
    )
    slopes = [one.points.gradient(one.gradient, len(x)) for one in (before, after)]
    # of 200 points one or two change between face and edge within the step
    np.testing.assert_allclose(curved, (slopes[1] - slopes[0]) / (2 * step), atol=1e-3 * np.abs(curved).max())


def test_a_common_rigid_motion_changes_nothing(dim):
    mesh, x = block(dim)
    sharp, pose = SharpContact(plate(dim), LAW, mesh), pressed_in(dim)
    terms = sharp.terms(x, pose)
    motion = RigidPose(rotation(dim, 1.1), np.arange(1.0, dim + 1.0))
    moved = sharp.terms(motion.apply(x), motion.compose(pose))
    # the depth is a difference of positions of a metre: 1e-16 m of a millimetre
    np.testing.assert_allclose(moved.depth, terms.depth, rtol=1e-9)
    np.testing.assert_allclose(
        moved.gradient, motion.rotate(terms.gradient), atol=1e-9 * np.abs(terms.gradient).max()
    )


def test_forces_of_body_and_collider_balance(dim):
    """The force on the nodes is that on the points of the collider, and so is its moment: both act along the way
    between them."""
    mesh, x = block(dim)
    sharp, pose = SharpContact(plate(dim), LAW, mesh), pressed_in(dim)
    terms = sharp.terms(x, pose)
    on_nodes, foot = terms.points.gradient(terms.gradient, len(x)), terms.points.positions(x)
    point = foot - terms.way
    np.testing.assert_allclose(on_nodes.sum(axis=0), terms.gradient.sum(axis=0), rtol=1e-10)

    def moment(at, force):
        tensor = at.T @ force
        return tensor - tensor.T

    scale = np.abs(terms.gradient).sum() * EDGE
    np.testing.assert_allclose(moment(x, on_nodes), moment(point, terms.gradient), atol=1e-12 * scale)


def test_no_sharp_contact_at_nodes(dim):
    mesh, _ = block(dim)
    assert SharpContact.of(plate(dim), PenaltyContact(1e10, refinement=0), mesh) is None
    assert SharpContact.of(plate(dim), LAW, mesh) is not None
