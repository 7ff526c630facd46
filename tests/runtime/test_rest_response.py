"""G of the rest body against a dense solve of the constrained problem, held and floating."""

import numpy as np
import pytest
import scipy.linalg as sl

from runtime.body import assemble_body, frame_in_box, place_handles
from runtime.corrections.rest_response import RestResponse, rest_stiffness
from runtime.elasticity import make_material
from runtime.mesh import box_mesh


@pytest.mark.parametrize("held", [True, False])
def test_it_solves_the_constrained_problem(dim, held):
    mesh = box_mesh([0.0] * dim, [0.1, 0.05, 0.05][:dim], [6, 3, 3][:dim])
    regions = [frame_in_box(mesh, "base", [[-1.0] * dim, [0.02] + [1.0] * (dim - 1)])] if held else []
    handles = place_handles(mesh, 6, regions)
    body = assemble_body(mesh, handles, make_material("stable_neo_hookean", 2e4, 0.4), 1000.0)
    free = np.setdiff1d(np.arange(body.n_nodes), body.handles.frame_nodes)
    unknowns = (free[:, None] * dim + np.arange(dim)).ravel()
    stiffness = rest_stiffness(body)[unknowns][:, unknowns].toarray()
    null = np.kron(sl.null_space(body.constraint_basis[free].T), np.eye(dim))
    forces = np.random.default_rng(0).normal(size=(body.n_nodes, dim, 4))
    expected = null @ np.linalg.solve(null.T @ stiffness @ null, null.T @ forces[free].reshape(-1, 4))
    found = RestResponse(body).solve(forces)
    assert not found[body.handles.frame_nodes].any()
    # Floating: within the round-off of the float32 in which answers are kept.
    error = np.abs(found[free].reshape(-1, 4) - expected).max()
    assert error < (1e-9 if held else 1e-7) * np.abs(expected).max()
