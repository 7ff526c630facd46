"""A turned answer of full space, turned back, is the answer: exact for affine displacements, on any mesh."""

from __future__ import annotations

import numpy as np

from benchmarks.reference_floor import places, turned_back
from benchmarks.thin_shapes import about_the_axis
from softprint.runtime.mesh import box_mesh

ROUND_OFF = 1e-12  # m, of coordinates of centimetres


def test_places_are_barycentric_also_outside():
    mesh = box_mesh([-0.02, -0.02, 0.0], [0.04, 0.04, 0.02], [4, 4, 2])
    points = np.random.default_rng(0).uniform([-0.022, -0.022, 0.0], [0.022, 0.022, 0.021], (200, 3))
    cells, weights = places(mesh, points)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-9)
    found = np.einsum("nc,ncd->nd", weights, mesh.points[mesh.cells[cells]])
    np.testing.assert_allclose(found, points, atol=ROUND_OFF)
    inside = (np.abs(points[:, :2]).max(axis=1) < 0.02) & (points[:, 2] < 0.02)
    assert weights[inside].min() > -1e-9


def test_an_affine_answer_is_turned_back_exactly():
    """In the turned scene the material point R X is displaced by R A X."""
    mesh = box_mesh([-0.02, -0.02, 0.0], [0.04, 0.04, 0.02], [4, 4, 2])
    turn, slope = 0.6, np.random.default_rng(1).normal(size=(3, 3))
    rotation = about_the_axis(turn)
    answer = mesh.points + mesh.points @ slope.T
    turned = mesh.points + mesh.points @ (rotation @ slope @ rotation.T).T
    np.testing.assert_allclose(turned_back(turned[None], mesh, turn)[0], answer, atol=ROUND_OFF)
