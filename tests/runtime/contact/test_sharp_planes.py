"""Tips and edges of a collider against a surface that gives way under each of them: the planes, and the energy."""

from __future__ import annotations

import numpy as np
import pytest

from softprint.runtime.body import assemble_body, frame_in_box, place_handles
from softprint.runtime.colliders import Box, RigidPose, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.sharp_planes import (
    HeldPlanes,
    SharpPlanes,
    SharpSurface,
    inward_normals,
    undented_normals,
)
from softprint.runtime.elasticity import make_material
from softprint.runtime.mesh import box_mesh
from softprint.runtime.mesh.mesh import node_normals

EDGE, PARTS = 0.1, 5
LAW = PenaltyContact(1e10, refinement=2)


@pytest.fixture(params=[2, 3])
def dim(request):
    return request.param


def block(dim):
    return box_mesh([0.0] * dim, [EDGE] * dim, [PARTS] * dim)


def rotation(dim, angle):
    turn = np.eye(dim)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return turn


def plate(dim):
    """1 mm thick, upright: its edges are sharp, and nothing else is."""
    return Box(np.array([0.0005, 0.02, 0.02])[[0, 2]] if dim == 2 else np.array([0.0005, 0.02, 0.02]))


def pressed_in(dim, depth=0.004, place=0.047):
    """A pose in which the lower edge of the plate is as deep in the top [m]."""
    at = np.full(dim, place)
    at[-1] = EDGE + 0.02 - depth
    return RigidPose(np.eye(dim), at)


def held(dim, x, pose, normals=None):
    """The surface and the planes of the plate."""
    mesh = block(dim)
    surface = SharpSurface(plate(dim), LAW, mesh)
    normals = node_normals(mesh.points, mesh.facets) if normals is None else normals
    return surface, surface.held(x, pose, normals)


def shaken(dim):
    """Positions of the nodes, of a surface that is not flat."""
    points = block(dim).points
    return points + 1e-3 * np.random.default_rng(1).standard_normal(points.shape)


def test_gradient_and_hessian_are_derivatives_of_the_energy(dim):
    x, pose = shaken(dim), pressed_in(dim)
    surface, planes = held(dim, x, pose)
    terms = planes.terms(surface.weight, x, pose)
    assert len(terms.depth) > 0
    rng = np.random.default_rng(4)
    gradient = terms.points.gradient(terms.gradient, len(x))
    nodes, blocks = terms.points.hessian(terms.hessian)
    for _ in range(3):
        along, step = rng.standard_normal(x.shape), 1e-8
        before, after = (planes.terms(surface.weight, x + sign * step * along, pose) for sign in (-1, 1))
        # central differences over 1e-8 m of depths of a millimetre
        slope = (after.energy - before.energy) / (2 * step)
        assert np.vdot(gradient, along) == pytest.approx(slope, rel=1e-5)
        slopes = [one.points.gradient(one.gradient, len(x)) for one in (before, after)]
        curved = np.zeros_like(x)
        np.add.at(curved, nodes, np.einsum("mijab,mjb->mia", blocks, along[nodes]))
        change = (slopes[1] - slopes[0]) / (2 * step)
        np.testing.assert_allclose(curved, change, atol=1e-5 * np.abs(curved).max())


def test_the_hessian_has_no_negative_curvature(dim):
    x, pose = shaken(dim), pressed_in(dim)
    surface, planes = held(dim, x, pose)
    hessian = planes.terms(surface.weight, x, pose).hessian
    assert np.linalg.eigvalsh(hessian).min() >= -1e-12 * np.abs(hessian).max()  # round-off


def test_a_common_rigid_motion_changes_nothing(dim):
    """Of body and collider, with the normals of the body."""
    x, pose, mesh = shaken(dim), pressed_in(dim), block(dim)
    surface, planes = held(dim, x, pose)
    terms = planes.terms(surface.weight, x, pose)
    motion = RigidPose(rotation(dim, 1.1), np.arange(1.0, dim + 1.0))
    turned = motion.rotate(node_normals(mesh.points, mesh.facets))
    where = motion.apply(x), motion.compose(pose)
    _, others = held(dim, *where, turned)
    moved = others.terms(surface.weight, *where)
    # the depth is a difference of positions of a metre: 1e-16 m of a millimetre
    np.testing.assert_allclose(moved.depth, terms.depth, rtol=1e-9)
    np.testing.assert_allclose(
        moved.gradient, motion.rotate(terms.gradient), atol=1e-9 * np.abs(terms.gradient).max()
    )


@pytest.mark.parametrize("place", [0.041, 0.044, 0.047, 0.05, 0.053, 0.056])
def test_an_edge_has_no_force_along_a_flat_surface_wherever_it_lies(dim, place):
    """Nodes are 20 mm apart, and one of them has given way, so that facets are tilted: a frictionless rigid body on a
    flat block is pushed back along the normal of the block alone."""
    mesh, pose = block(dim), pressed_in(dim, place=place)
    x = mesh.points.copy()
    top = np.isclose(x[:, -1], EDGE)
    nearest = np.linalg.norm(x[:, :-1] - 0.04, axis=1)
    x[top & (nearest == nearest[top].min()), -1] -= 0.003
    surface, planes = held(dim, x, pose)
    terms = planes.terms(surface.weight, x, pose)
    force = terms.gradient.sum(axis=0)
    tilted = node_normals(x, mesh.facets)[terms.points.nodes].sum(axis=1)
    assert (np.abs(tilted[:, 0]) > 0.02 * tilted[:, -1]).any()
    # the normal of the collider is the gradient of a signed distance that is smoothed at its edges
    assert np.abs(force[:-1]).max() < 3e-3 * force[-1]


def test_the_side_of_a_limb_bears_along_the_facet_that_it_leans_on(dim):
    """Points half-way up the plate have its sides alone, which face no top: there the wall of a dent bears."""
    x, pose = shaken(dim), pressed_in(dim, depth=0.025)
    mesh = block(dim)
    _, planes = held(dim, x, pose)
    facets = mesh.facets[planes.facet]
    outward = np.stack([node_normals(x, facet[None])[facet[0]] for facet in facets])
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    along_facet = np.isclose((planes.direction * outward).sum(axis=1), -1.0, atol=1e-9)
    height = planes.place[:, -1]
    if dim == 3:  # in 2D the only points that are not sharp corners
        assert along_facet[np.abs(height) < 0.015].all()
    low = (height < -0.0199) & (np.abs(planes.direction[:, -1]) > 0.9)
    assert low.any()
    np.testing.assert_allclose(planes.direction[low, -1], -1.0, atol=1e-3)


def test_planes_are_found_again_until_their_forces_stay(dim):
    mesh, pose = block(dim), pressed_in(dim)
    planes = SharpPlanes(SharpSurface(plate(dim), LAW, mesh), node_normals(mesh.points, mesh.facets))
    x = mesh.points.copy()
    assert not planes.renew(x, pose)  # there are none yet
    before = planes.terms(x, pose)
    assert not planes.renew(x, pose)
    drawn = x + 0.004 * np.eye(dim)[0]
    np.testing.assert_array_equal(planes.terms(drawn, pose).points.shares, before.points.shares)
    assert planes.renew(drawn, pose)
    assert not planes.renew(drawn, pose)
    # the same place of the collider is above a place of the body that is 4 mm farther back
    there = planes.terms(drawn, pose).points.positions(mesh.points)
    np.testing.assert_allclose(there.mean(axis=0)[0], before.points.positions(x).mean(axis=0)[0] - 0.004)


def test_planes_are_found_again_no_more_often_than_they_may(dim):
    mesh, pose = block(dim), pressed_in(dim)
    surface = SharpSurface(plate(dim), LAW, mesh)
    planes = SharpPlanes(surface, node_normals(mesh.points, mesh.facets), renewals=2)
    x = mesh.points
    planes.hold(x, pose)
    # each time the surface has moved on under the plate
    renewed = [planes.renew(x + 0.002 * times * np.eye(dim)[0], pose) for times in (1, 2, 3, 4)]
    assert renewed == [True, True, False, False]


def test_ranks_share_the_facets(dim):
    x, pose = shaken(dim), pressed_in(dim)
    surface, planes = held(dim, x, pose)
    whole = planes.terms(surface.weight, x, pose)
    facets = block(dim).facets
    parts = []
    for rank in range(2):
        local = np.where(np.arange(len(facets))[:, None] % 2 == rank, facets, -1)
        parts.append(planes.on_part(local).terms(surface.weight, x, pose))
    assert sum(part.energy for part in parts) == pytest.approx(whole.energy, rel=1e-12)


def test_no_sharp_contact_at_nodes_or_with_a_smooth_collider(dim):
    mesh = block(dim)
    assert SharpSurface.of(plate(dim), PenaltyContact(1e10, refinement=0), mesh) is None
    assert SharpSurface.of(Sphere(0.3, dim), LAW, mesh) is None
    assert SharpSurface.of(plate(dim), LAW, mesh) is not None


def test_far_from_the_body_nothing_is_held(dim):
    x, pose = shaken(dim), pressed_in(dim, depth=-0.5)
    surface, planes = held(dim, x, pose)
    assert isinstance(planes, HeldPlanes)
    assert planes.terms(surface.weight, x, pose).energy == 0.0


def test_normals_without_a_dent_turn_with_the_reduced_body(dim):
    """Rotated and stretched: cof(F) n, in the direction of the normal of the deformed surface."""
    mesh = block(dim)
    base = frame_in_box(mesh, "base", [[-1.0] * dim, [1.0] * (dim - 1) + [0.021]])
    material = make_material("stable_neo_hookean", 1e4, 0.4)
    body = assemble_body(mesh, place_handles(mesh, 4, [base]), material, 1000.0)
    F = rotation(dim, 0.7) @ np.diag([1.2, 0.9, 1.1][:dim])
    x = mesh.points @ F.T
    found = undented_normals(body, body.rest_rows @ F.T)
    inside = np.setdiff1d(np.arange(mesh.n_nodes), mesh.surface_nodes)
    assert (found[inside] == 0.0).all()
    # nodes within a face, where all facets around have one normal
    normals = node_normals(mesh.points, mesh.facets)
    flat = (np.abs(normals) > 1e-12).sum(axis=1) == 1
    deformed = node_normals(x, mesh.facets)[flat]
    cosine = (found[flat] * deformed).sum(axis=1)
    cosine /= np.linalg.norm(found[flat], axis=1) * np.linalg.norm(deformed, axis=1)
    np.testing.assert_allclose(cosine, 1.0, atol=1e-9)
    # into the body, in the coordinates of a collider that is turned as well
    pose = RigidPose(rotation(dim, 0.7), np.zeros(dim))
    inward = inward_normals(np.flatnonzero(flat)[:, None], np.ones((flat.sum(), 1)), found, pose)
    np.testing.assert_allclose(np.linalg.norm(inward, axis=1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(
        inward, -normals[flat] / np.linalg.norm(normals[flat], axis=1)[:, None], atol=1e-9
    )
