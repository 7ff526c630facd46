"""Displacement by given forces: as by the compliance, wherever and however often it is asked for."""

import numpy as np
import pytest

from softprint.runtime.contact.solver.given_displacement import GivenDisplacement
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mechanics.compliance.interpolated_compliance import InterpolatedCompliance
from softprint.runtime.mechanics.compliance.local_compliance import LocalCompliance
from softprint.runtime.mechanics.loaded_points import LoadedPoints


@pytest.fixture
def given(jelly_body, dim):
    """Forces on three neighbouring nodes in the middle of the top; the compliance of all."""
    surface = compute_mechanics(jelly_body, 400, condensation=False).surface_compliance
    of_nodes = LocalCompliance(surface.among_nodes())
    middle = np.append(np.zeros(dim - 1), 0.06)
    order = np.argsort(np.linalg.norm(jelly_body.mesh.points[surface.nodes] - middle, axis=1), kind="stable")
    nodes = np.sort(order[:3])
    forces = np.random.default_rng(0).normal(size=(3, dim))
    return GivenDisplacement(of_nodes, nodes, forces), surface, of_nodes, nodes, forces


def test_of_nodes(given):
    displacement, _, of_nodes, nodes, forces = given
    rng = np.random.default_rng(1)
    every = of_nodes.displacement(np.arange(len(of_nodes)), nodes, forces)
    for _ in range(4):
        some = rng.choice(len(of_nodes), 9)  # some of them again
        # Sums of the same products, in another order in single precision.
        np.testing.assert_allclose(displacement.of_nodes(some), every[some], atol=1e-6 * np.abs(every).max())
    assert displacement.farthest >= np.linalg.norm(every, axis=1).max()


def test_of_points(given, jelly_body):
    displacement, surface, of_nodes, nodes, forces = given
    loaded = LoadedPoints.of_compliance(jelly_body, surface, 2)
    points = np.arange(0, len(loaded), 3)
    expected = InterpolatedCompliance(of_nodes, loaded).displacement(points, nodes, forces)
    found = displacement.of_points(loaded.nodes[points], loaded.shares[points])
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())
