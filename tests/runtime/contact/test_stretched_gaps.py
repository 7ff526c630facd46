"""Points on blunt parts of colliders, which bear where the surface is stretched."""

from __future__ import annotations

import numpy as np
import pytest

from softprint.runtime.colliders import RigidPose, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.sharp_point_search import SharpPointSearch
from softprint.runtime.contact.stretched_gaps import BLUNT, bearing_share, longest_edges
from softprint.runtime.mesh.box import box_mesh

TOP = 0.05  # m


def test_share_grows_from_the_stretch_at_which_a_part_fits():
    stretch = np.array([1.0, 2.0, 3.0, 6.0, 9.0])
    np.testing.assert_allclose(bearing_share(np.full(5, 2.0), stretch), [0.0, 0.0, 0.25, 1.0, 1.0])
    # Tips and edges always bear.
    np.testing.assert_array_equal(bearing_share(np.zeros(5), stretch), 1.0)
    # It has no jump in the stretch.
    fine = np.linspace(0.0, 10.0, 1001)
    assert np.abs(np.diff(bearing_share(np.full(1001, 2.0), fine))).max() < 0.003


def test_stretch_is_that_of_the_surface(dim):
    rng = np.random.default_rng(dim)
    x, facets = rng.normal(size=(30, dim)), rng.permuted(np.tile(np.arange(30), (20, 1)), axis=1)[:, :dim]
    turn, longest = np.linalg.qr(rng.normal(size=(dim, dim)))[0], longest_edges(x, facets)
    np.testing.assert_allclose(longest_edges(x @ turn.T + rng.normal(size=dim), facets), longest)
    np.testing.assert_allclose(longest_edges(2.5 * x, facets), 2.5 * longest)


@pytest.mark.parametrize("factor", [1.0, 1.5, 4.0])
def test_a_blunt_ball_is_met_where_the_surface_is_stretched(dim, factor):
    """The block is drawn out sideways under a ball that is twice as wide as what fits between its contact points."""
    mesh = box_mesh([-0.04] * (dim - 1) + [0.0], [0.04] * (dim - 1) + [TOP], [8] * (dim - 1) + [5])
    law = PenaltyContact(1e10, refinement=2)
    fits = {2: 1.3, 3: 1.5}[dim] * law.sharp_spacing(mesh)
    ball = Sphere(2.0 * fits, dim)
    pose = RigidPose(np.eye(dim), np.append(np.zeros(dim - 1), TOP + 1.8 * fits))
    x = mesh.points * np.append(np.full(dim - 1, factor), 1.0)
    met = SharpPointSearch(ball, law, mesh, BLUNT).met(x, pose, 0.0)
    if factor < 2.0:
        assert not len(met.depth)
    else:
        # 2 = r / r_0, to the curvature that a point finds a bit outside of the ball.
        np.testing.assert_allclose(met.share, (4.0 / 2.0 - 1.0) / 2.0, rtol=0.05)
        assert (met.depth > 0.0).any()
    assert not len(SharpPointSearch(ball, law, mesh).met(x, pose, 0.0).depth)
