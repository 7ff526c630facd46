"""The surface compliance that is kept for run time, against the solves that it stands for."""

import numpy as np
import pytest

from softprint.runtime.mechanics.compliance import columns
from softprint.runtime.mechanics.compliance import surface_compliance as module
from softprint.runtime.mechanics.compliance.null_space_compliance import NullSpaceCompliance
from softprint.runtime.mechanics.compliance.surface_compliance import compute_surface_compliance, n_columns
from softprint.runtime.mechanics.compliance.surface_compliance_arrays import (
    surface_compliance_arrays,
    take_compliance,
)


@pytest.fixture
def response(jelly_body):
    return NullSpaceCompliance(jelly_body)


def test_columns_are_the_response_to_single_forces(jelly_body, response):
    compliance = compute_surface_compliance(jelly_body, response, 10_000)
    forces = np.zeros((*jelly_body.mesh.points.shape, 1))
    forces[compliance.nodes[5], -1] = 1.0
    column = compliance.dense()[5, -1]
    exact = response.solve(forces)[..., 0]
    # Kept in float32.
    assert np.abs(column - exact).max() < 1e-6 * np.abs(exact).max()


def test_symmetric_and_in_the_null_space_of_the_subspace(jelly_body, response):
    compliance = compute_surface_compliance(jelly_body, response, 10_000)
    operator = compliance.dense()
    among = operator[:, :, compliance.nodes]
    size = np.abs(among).max()
    # float32.
    assert np.abs(among - among.transpose(2, 3, 0, 1)).max() < 1e-6 * size
    free = np.setdiff1d(np.arange(jelly_body.n_nodes), jelly_body.handles.frame_nodes)
    seen = np.einsum("nr,lanb->larb", jelly_body.constraint_basis[free], operator[:, :, free])
    assert np.abs(seen).max() < 1e-4 * size


@pytest.mark.parametrize("part", [1, 3], ids=["all of them", "between anchors"])
def test_the_same_on_several_cores(jelly3d_body, monkeypatch, part):
    """Columns that one process solves for together stay together."""
    response = NullSpaceCompliance(jelly3d_body)
    n = len(compute_surface_compliance(jelly3d_body, response, 10_000).nodes)
    monkeypatch.setattr(module, "_ANCHORS", n // part)
    monkeypatch.setattr(module, "_NEAR", 2.0)
    monkeypatch.setattr(columns, "_COLUMNS", 36)
    found, done = {}, {1: [], 3: []}
    for count in done:
        monkeypatch.setattr(columns, "worker_count", lambda batches, count=count: min(batches, count))
        found[count] = compute_surface_compliance(jelly3d_body, response, 10_000, done[count].append)
    assert sum(done[3]) == sum(done[1]) == n + (n // part if part > 1 else 0)
    alone, shared = found[1].dense(), found[3].dense()
    # The workers have one thread of BLAS, which may add up otherwise: float32.
    np.testing.assert_allclose(shared, alone, rtol=0.0, atol=1e-6 * np.abs(alone).max())
    np.testing.assert_array_equal(found[3].near.indices, found[1].near.indices)


def test_interpolated_between_anchors(jelly3d_body, monkeypatch):
    """With a third of the contact nodes for anchors, the field of a contact that covers some nodes is right to a tenth,
    and to some percent where it is pressed; columns of anchors are exact."""
    response = NullSpaceCompliance(jelly3d_body)
    exact = compute_surface_compliance(jelly3d_body, response, 10_000).dense()
    monkeypatch.setattr(module, "_ANCHORS", len(exact) // 3)
    monkeypatch.setattr(module, "_NEAR", 2.0)
    done = []
    compliance = compute_surface_compliance(jelly3d_body, response, 10_000, done.append)
    of_spread = len(compliance.anchors)
    assert sum(done) + of_spread == n_columns(jelly3d_body, 10_000)
    assert compliance.near.nnz < 0.5 * exact.size
    found = compliance.dense()
    size = np.abs(exact).max()
    assert np.abs(found[compliance.anchors] - exact[compliance.anchors]).max() < 1e-5 * size
    rest = jelly3d_body.mesh.points[compliance.nodes]
    patch = np.flatnonzero(np.linalg.norm(rest - rest[40], axis=1) < 0.03)
    forces = np.zeros((len(patch), 3), dtype=np.float32)
    forces[:, 2] = 1.0
    field = compliance.apply(patch, forces)
    # Single precision, over some tens of nodes.
    np.testing.assert_allclose(field, found[patch, 2].sum(axis=0), rtol=0.0, atol=1e-5 * np.abs(field).max())
    right = exact[patch, 2].sum(axis=0)
    # Anchors of this coarse box are 2 cm apart, no less than what is pressed; on the small Jelly it is 1 %.
    assert np.linalg.norm(field - right) < 0.1 * np.linalg.norm(right)
    pressed = compliance.nodes[patch]
    assert np.abs((field - right)[pressed]).max() < 0.05 * np.abs(right).max()


def test_fewer_contact_nodes_than_surface_nodes_keep_the_area(jelly_body, response):
    compliance = compute_surface_compliance(jelly_body, response, 20)
    outside = ~np.isin(jelly_body.mesh.surface_nodes, jelly_body.handles.frame_nodes)
    assert len(compliance.nodes) == 20
    assert compliance.areas.sum() == pytest.approx(jelly_body.mesh.surface_areas[outside].sum(), rel=1e-12)
    among = compliance.among_nodes()
    assert np.abs(among - among.transpose(1, 0, 3, 2)).max() == 0.0


def test_kept_in_half_precision(jelly3d_body, monkeypatch):
    monkeypatch.setattr(module, "_ANCHORS", 40)
    compliance = compute_surface_compliance(jelly3d_body, NullSpaceCompliance(jelly3d_body), 10_000)
    again = take_compliance(dict(surface_compliance_arrays(compliance, "it")), "it")
    before, after = compliance.dense(), again.dense()
    # Ten bits of mantissa: 5e-4 of each entry.
    assert np.abs(after - before).max() < 1e-3 * np.abs(before).max()
    assert np.array_equal(again.nodes, compliance.nodes)
