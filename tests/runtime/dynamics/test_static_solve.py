"""Static equilibrium of a slender body that bends far: a cantilever under its own weight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from softprint.runtime.body import assemble_body, frame_in_box, place_handles
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics import KinematicHandle, Simulator
from softprint.runtime.dynamics.step import static_solve
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mesh.box import box_mesh
from softprint.runtime.optimise import Status

LENGTH, THICKNESS = 0.2, 0.02  # m


@pytest.fixture
def cantilever(dim):
    """Held by one of its two rigid frames; so soft that it sags by two fifths of its length."""
    upper = [LENGTH, THICKNESS, THICKNESS][:dim]
    mesh = box_mesh([0.0] * dim, upper, [24, 3, 3][:dim])
    root = frame_in_box(mesh, "root", [[-1.0] * dim, [0.018] + [1.0] * (dim - 1)])
    tip = frame_in_box(mesh, "tip", [[0.182] + [-1.0] * (dim - 1), [1.0] * dim])
    material = make_material("stable_neo_hookean", 2e5, 0.4)
    body = assemble_body(mesh, place_handles(mesh, 4, [root, tip]), material, 1000.0, name="cantilever")
    gravity = np.append(np.zeros(dim - 1), -9.81)
    return Simulator(
        body,
        contact=PenaltyContact(1e9),
        mechanics=compute_mechanics(body, 200, True, gravity),
        gravity=gravity,
        kinematic=[KinematicHandle("root")],
    )


def test_what_has_settled_settles_no_further(cantilever):
    settled = cantilever.settle()
    assert settled.converged
    x = cantilever.positions(settled.state)
    sag = (cantilever.body.mesh.points - x)[:, -1].max()
    assert sag > 0.35 * LENGTH
    again = cantilever.settle(settled.state)
    assert again.converged
    # The last change of a rotation is 1e-6 rad at most, and each is at most four fifths of the one before: 5e-6 rad are
    # left, of a beam of 0.2 m.
    np.testing.assert_allclose(cantilever.positions(again.state), x, atol=5e-6 * LENGTH)
    stepped = cantilever.step(settled.state)
    np.testing.assert_allclose(cantilever.positions(stepped.state), x, atol=5e-6 * LENGTH)


def test_what_has_not_settled_says_so(cantilever, monkeypatch):
    monkeypatch.setattr(static_solve, "_FRAMES", 10)
    result = cantilever.settle()
    assert result.status is Status.MAX_ITERATIONS
    assert not result.converged
    # In the frame of the result, and not 1e-7 in that of the last solve: rotations still change by 1e-2 rad per frame.
    assert 0.01 < result.residual < 1.0
    assert f"residual {result.residual:.1e}" in result.reason


@pytest.mark.parametrize("moved", [1e-4, 1e-3, 5e-3])
def test_what_nothing_loads_settles_at_rest(jelly_body, dim, moved):
    """Forces are compared with those of a strain of 1e-9, and energies there are round-off of what cancels in them."""
    root = KinematicHandle(jelly_body.handles.frames[0].name)
    simulator = Simulator(jelly_body, contact=PenaltyContact(1e9), gravity=[0.0] * dim, kinematic=[root])
    rest, points = simulator.rest_state(), jelly_body.handles.n_points
    rows = rest.rows.copy()
    rows[:points] += moved * np.random.default_rng(0).normal(size=(points, dim))
    settled = simulator.settle(replace(rest, rows=rows))
    assert settled.converged
    # Balanced to 1e-6 of those forces: a strain of 1e-15, to round-off of positions of 0.1 m.
    np.testing.assert_allclose(settled.state.rows, rest.rows, atol=1e-14)
