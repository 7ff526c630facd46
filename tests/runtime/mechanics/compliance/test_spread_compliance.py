"""Spread compliance: the response of the body to forces on balls of material."""

import numpy as np
import pytest

from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mechanics.compliance import surface_compliance as module
from softprint.runtime.mechanics.compliance.null_space_compliance import NullSpaceCompliance
from softprint.runtime.mechanics.compliance.spread_compliance import (
    ball_weights,
    compute_spread_compliance,
    reach,
)
from softprint.runtime.mechanics.compliance.surface_compliance import compute_surface_compliance


@pytest.fixture
def response(jelly_body):
    return NullSpaceCompliance(jelly_body)


def test_balls_hold_all_of_a_force_outside_rigid_frames(jelly_body):
    body, radius = jelly_body, reach(jelly_body)
    nodes = body.mesh.surface_nodes[~np.isin(body.mesh.surface_nodes, body.handles.frame_nodes)][::7]
    weights = ball_weights(body, body.mesh.points[nodes], radius).toarray()
    # Sums of some ten numbers.
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=1e-14)
    assert (weights >= 0.0).all()
    assert not weights[:, body.handles.frame_nodes].any()
    distance = np.linalg.norm(body.mesh.points[nodes][:, None] - body.mesh.points, axis=2)
    assert not weights[distance > radius].any()
    assert ((weights > 0.0).sum(axis=1) > 1).all()  # they are spread


def test_radius_grows_with_the_distance_of_handles(jelly_body):
    handles = jelly_body.handles.n_points + len(jelly_body.handles.frames)
    volume = jelly_body.mesh.cell_volumes.sum()
    assert handles * (2.0 * reach(jelly_body)) ** jelly_body.dim == pytest.approx(volume, rel=1e-12)


def test_field_is_the_response_to_spread_forces(jelly_body, response):
    """Where each contact node is its own anchor; the reduced state does not change by it."""
    surface = compute_surface_compliance(jelly_body, response, 10_000)
    spread = compute_spread_compliance(jelly_body, response, surface)
    dim, index = jelly_body.dim, np.array([2, 5])
    phi = np.random.default_rng(0).normal(size=(2, dim))
    centres = jelly_body.mesh.points[surface.nodes[index]]
    forces = ball_weights(jelly_body, centres, reach(jelly_body)).T @ phi
    expected = response.solve(forces[..., None])[..., 0]
    found = spread.apply(index, phi)
    # Columns are in single precision.
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())
    kept = jelly_body.constraint_basis.T @ found
    assert np.abs(kept).max() < 1e-5 * np.abs(jelly_body.constraint_basis).T.sum() * np.abs(found).max()


def test_a_spread_force_dents_less_and_as_much_far_away(jelly_body, response):
    surface = compute_surface_compliance(jelly_body, response, 10_000)
    spread = compute_spread_compliance(jelly_body, response, surface)
    top = int(np.argmax(jelly_body.mesh.points[surface.nodes][:, -1]))
    push = -np.eye(jelly_body.dim)[-1:]
    one, other = (of.apply(np.array([top]), push)[surface.nodes[top], -1] for of in (surface, spread))
    assert one < other < 0.0


def test_between_anchors_fields_are_interpolated(jelly3d_body, monkeypatch):
    monkeypatch.setattr(module, "_ANCHORS", 40)
    mechanics = compute_mechanics(jelly3d_body, 10_000, condensation=False)
    spread, phi = mechanics.spread_compliance, np.random.default_rng(1).normal(size=(3, 3))
    assert len(spread.operator) == 40 < len(spread.nodes)
    index = np.array([0, 11, 30])
    expected = np.einsum("lanb,la->nb", spread.dense()[index], phi)
    # Single precision.
    np.testing.assert_allclose(spread.apply(index, phi), expected, atol=1e-6 * np.abs(expected).max())
    # Moving least squares reproduce constants: all of a force is spread.
    np.testing.assert_allclose(spread.share.sum(axis=1), 1.0, rtol=1e-9)
