"""Points on facets: on the surface, close enough together, and enough of them that a thin tip is met where it is."""

from __future__ import annotations

import numpy as np
import pytest

from softprint.runtime.colliders import Capsule
from softprint.runtime.colliders.approach import Approach, OutOfReach
from softprint.runtime.mesh import box_mesh
from softprint.runtime.mesh.facet_lattice import facet_lattice, lattice


@pytest.mark.parametrize(("parts", "dim", "count"), [(1, 2, 0), (4, 2, 3), (1, 3, 0), (2, 3, 3), (4, 3, 12)])
def test_a_lattice_has_no_corners(parts, dim, count):
    shares = lattice(parts, dim)
    assert shares.shape == (count, dim)
    np.testing.assert_allclose(shares.sum(axis=1), 1.0)
    assert (shares >= 0.0).all()
    assert (shares < 1.0).all()


@pytest.mark.parametrize("dim", [2, 3])
def test_every_place_on_the_surface_has_a_point_near(dim):
    mesh = box_mesh([0.0] * dim, [0.1, 0.06, 0.04][:dim], [5, 3, 2][:dim])
    spacing = 0.003
    found = np.vstack([mesh.points[mesh.surface_nodes], facet_lattice(mesh.points, mesh.facets, spacing)])
    corners = mesh.points[mesh.facets]
    shares = np.random.default_rng(0).dirichlet(np.ones(dim), size=50)
    places = np.einsum("kc,mcd->mkd", shares, corners).reshape(-1, dim)
    nearest = np.array([np.linalg.norm(found - place, axis=1).min() for place in places])
    # The points of a right triangle's lattice are at most its longest edge's part apart.
    assert nearest.max() < spacing


def test_a_tip_between_nodes_is_met_where_it_is():
    """Nodes 2 cm apart, and a tip of 3 mm aimed beside one: by nodes it is not met at all."""
    mesh = box_mesh([0.0, 0.0, 0.0], [0.1, 0.1, 0.04], [5, 5, 2])
    tip = Capsule([0.0, 0.0, 0.0], [0.0, 0.0, 0.03], 0.003)
    nodes, normal = mesh.points[mesh.surface_nodes], np.array([0.0, 0.0, 1.0])
    place, depth = np.array([0.064, 0.063, 0.04]), np.array([0.002])
    with pytest.raises(OutOfReach):
        Approach(tip, nodes, place, normal, np.eye(3)).poses_at(depth)
    points = np.vstack([nodes, facet_lattice(mesh.points, mesh.facets, tip.size / 60.0)])
    (pose,) = Approach(tip, points, place, normal, np.eye(3)).poses_at(depth)
    lowest = pose.translation[2] - 0.003
    # An edge of 28 mm has 16 parts at most: a point is up to 1 mm beside the tip, where that is 0.2 mm higher.
    assert 0.04 - lowest == pytest.approx(0.002, abs=0.0003)
