"""G of the rest body compared with a dense solve of the constrained problem, for fixed and floating bodies."""

import numpy as np
import pytest
import scipy.linalg as sl

from softprint.runtime.body import assemble_body, frame_in_box, place_handles
from softprint.runtime.elasticity import make_material
from softprint.runtime.mechanics.compliance.null_space_compliance import NullSpaceCompliance, rest_stiffness
from softprint.runtime.mesh import box_mesh


@pytest.mark.parametrize("held", [True, False])
def test_it_solves_the_constrained_problem(dim, held):
    mesh = box_mesh([0.0] * dim, [0.1, 0.05, 0.05][:dim], [6, 3, 3][:dim])
    regions = [frame_in_box(mesh, "base", [[-1.0] * dim, [0.02] + [1.0] * (dim - 1)])] if held else []
    handles = place_handles(mesh, 6, regions)
    body = assemble_body(mesh, handles, make_material("stable_neo_hookean", 2e4, 0.4), 1000.0)
    check(body, 1e-9 if held else 1e-7)


def test_a_body_with_frames_only_is_unconstrained(dim):
    mesh = box_mesh([0.0] * dim, [0.1, 0.05, 0.05][:dim], [6, 3, 3][:dim])
    ends = [[[-1.0] * dim, [0.02] + [1.0] * (dim - 1)], [[0.08] + [-1.0] * (dim - 1), [1.0] * dim]]
    handles = place_handles(mesh, 0, [frame_in_box(mesh, f"end{k}", box) for k, box in enumerate(ends)])
    body = assemble_body(mesh, handles, make_material("stable_neo_hookean", 2e4, 0.4), 1000.0)
    check(body, 1e-9)


def check(body, tolerance):
    """Compare with null-space coordinates. Floating bodies: within the round-off of results stored in float32."""
    dim = body.dim
    free = np.setdiff1d(np.arange(body.n_nodes), body.handles.frame_nodes)
    unknowns = (free[:, None] * dim + np.arange(dim)).ravel()
    stiffness = rest_stiffness(body)[unknowns][:, unknowns].toarray()
    columns = body.constraint_basis[free]
    among = sl.null_space(columns.T) if columns.size else np.eye(len(free))
    null = np.kron(among, np.eye(dim))
    forces = np.random.default_rng(0).normal(size=(body.n_nodes, dim, 4))
    expected = null @ np.linalg.solve(null.T @ stiffness @ null, null.T @ forces[free].reshape(-1, 4))
    found = NullSpaceCompliance(body).solve(forces)
    # With twice the stiffness it gives half the response, and does not change.
    compliance = NullSpaceCompliance(body)
    half = compliance.with_stiffness(2.0 * rest_stiffness(body)).solve(forces)
    np.testing.assert_allclose(half, 0.5 * found, atol=tolerance * np.abs(found).max())
    np.testing.assert_array_equal(compliance.solve(forces), found)
    assert not found[body.handles.frame_nodes].any()
    error = np.abs(found[free].reshape(-1, 4) - expected).max()
    assert error < tolerance * np.abs(expected).max()
