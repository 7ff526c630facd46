"""Contact at points of facets: exact sums, derivatives by the nodes, and the search for facets near a collider."""

from __future__ import annotations

import numpy as np
import pytest

from softprint.runtime.colliders import Box, RigidPose, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.surface_quadrature import SurfaceQuadrature
from softprint.runtime.mesh import box_mesh
from softprint.runtime.mesh.midpoints import midpoints

CONTACT = PenaltyContact(1e10)


def block(dim):
    """A block of some cells, deformed."""
    mesh = box_mesh([0.0] * dim, [0.1] * dim, [4] * dim)
    x = mesh.points + 2e-3 * np.random.default_rng(1).standard_normal(mesh.points.shape)
    return mesh, x


def poses(dim):
    """A pose that presses a ball of 40 mm into the top."""
    at = np.full(dim, 0.043)
    at[-1] = 0.13
    return RigidPose(np.eye(dim), at)


@pytest.mark.parametrize("parts", [1, 2, 5])
def test_midpoints_integrate_linear_functions_exactly(dim, parts):
    shares = midpoints(parts, dim)
    assert len(shares) == parts ** (dim - 1)
    np.testing.assert_allclose(shares.sum(axis=1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(shares.mean(axis=0), 1.0 / dim, rtol=1e-14)  # the integral of each N
    assert (shares > 0.0).all()
    assert len(np.unique(shares.round(12), axis=0)) == len(shares)


def test_areas_are_those_of_the_surface(dim):
    mesh, _ = block(dim)
    whole = 2 * dim * 0.1 ** (dim - 1)
    for points in (
        SurfaceQuadrature.at_nodes(mesh.surface_nodes, mesh.surface_areas),
        SurfaceQuadrature.on_facets(mesh.points, mesh.facets, 3),
    ):
        every = np.arange(len(points.facets) * len(points.shares))
        assert points.area(every).sum() == pytest.approx(whole, rel=1e-12)
        np.testing.assert_array_equal(points.nodes, mesh.surface_nodes)


def energy(points, x, collider, pose):
    near = points.near(x, collider, pose)
    return CONTACT.energy(points.points(near).positions(x), points.area(near), collider, pose)


@pytest.mark.parametrize("refinement", [0, 1, 4])
def test_no_point_is_missed(dim, refinement):
    mesh, x = block(dim)
    if refinement:
        points = SurfaceQuadrature.on_facets(mesh.points, mesh.facets, refinement)
    else:
        points = SurfaceQuadrature.at_nodes(mesh.surface_nodes, mesh.surface_areas)
    every = np.arange(len(points.facets) * len(points.shares))
    rng = np.random.default_rng(2)
    for collider in (Sphere(0.02, dim), Box(np.array([0.03, 0.001, 0.03])[:dim])):
        for _ in range(20):
            pose = RigidPose(np.eye(dim), 0.05 + 0.06 * rng.uniform(-1, 1, dim))
            exact = CONTACT.energy(points.points(every).positions(x), points.area(every), collider, pose)
            assert energy(points, x, collider, pose) == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("refinement", [0, 3])
def test_gradient_and_hessian_are_derivatives_of_the_energy(dim, refinement):
    mesh, x = block(dim)
    if refinement:
        points = SurfaceQuadrature.on_facets(mesh.points, mesh.facets, refinement)
    else:
        points = SurfaceQuadrature.at_nodes(mesh.surface_nodes, mesh.surface_areas)
    collider, pose = Sphere(0.04, dim), poses(dim)

    def gradient(x):
        near = points.near(x, collider, pose)
        terms = CONTACT.terms(points.points(near).positions(x), points.area(near), collider, pose)
        return near[terms.index], terms, points.points(near[terms.index]).gradient(terms.gradient, len(x))

    index, terms, slope = gradient(x)
    assert len(index) > 1
    nodes, blocks = points.points(index).hessian(terms.hessian)
    hessian = np.zeros((*x.shape, *x.shape))
    for own, block_ in zip(nodes, blocks, strict=True):
        for a, first in enumerate(own):
            for b, second in enumerate(own):
                hessian[first, :, second] += block_[a, b]
    step = 1e-7
    for node in np.unique(nodes):
        for axis in range(dim):
            moved = [x.copy(), x.copy()]
            moved[0][node, axis] -= step
            moved[1][node, axis] += step
            difference = [energy(points, y, collider, pose) for y in moved]
            # central differences of an energy of 1e-6 J: its curvature changes by parts in ten thousand over a step
            assert slope[node, axis] == pytest.approx(
                (difference[1] - difference[0]) / (2 * step), rel=1e-4, abs=1e-6 * np.abs(slope).max()
            )
            by_difference = (gradient(moved[1])[2] - gradient(moved[0])[2]) / (2 * step)
            np.testing.assert_allclose(
                hessian[:, :, node, axis], by_difference, atol=1e-4 * np.abs(hessian).max()
            )


def test_force_and_moment_of_the_nodes_are_those_of_the_points(dim):
    mesh, x = block(dim)
    points = SurfaceQuadrature.on_facets(mesh.points, mesh.facets, 4)
    collider, pose = Sphere(0.04, dim), poses(dim)
    near = points.near(x, collider, pose)
    terms = CONTACT.terms(points.points(near).positions(x), points.area(near), collider, pose)
    index = near[terms.index]
    at_nodes = points.points(index).gradient(terms.gradient, len(x))
    np.testing.assert_allclose(at_nodes.sum(axis=0), terms.gradient.sum(axis=0), rtol=1e-10)

    def moments(positions, forces):
        return np.einsum("ni,nj->ij", positions, forces)

    np.testing.assert_allclose(
        moments(x, at_nodes),
        moments(points.points(index).positions(x), terms.gradient),
        atol=1e-12 * np.abs(terms.gradient).sum(),
    )
