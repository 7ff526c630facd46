"""The facets of a body's surface under which colliders are searched for: as far off as all nodes, drawn, are."""

from __future__ import annotations

import numpy as np
import pytest

from softprint.runtime.colliders import KeyframedPath, Sphere
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.dynamics import DynamicsSettings, KinematicHandle, PlacedCollider, Simulator
from softprint.runtime.dynamics.timings import Timings
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mesh.nearest_facets import SurfaceSearch

TOP, RADIUS, DEPTH = 0.06, 0.02, 0.012  # m


@pytest.mark.parametrize("refinement", [0, 2], ids=["nodes", "facets"])
@pytest.mark.parametrize("condensed", [False, True], ids=["bare", "mechanics"])
def test_points_are_as_deep_as_under_all_facets_of_the_drawn_surface(jelly_body, dim, condensed, refinement):
    mechanics = compute_mechanics(jelly_body, 1000, False) if condensed else None
    top = np.append(np.zeros(dim - 1), TOP + RADIUS)
    down = top - DEPTH * np.eye(dim)[-1]
    placed = PlacedCollider("ball", Sphere(RADIUS, dim, "ball"), KeyframedPath([0.0, 0.4], [top, down]))
    simulator = Simulator(
        jelly_body,
        [placed],
        contact=PenaltyContact(1e10, refinement),
        mechanics=mechanics,
        kinematic=[KinematicHandle("base")],
        settings=DynamicsSettings(1.0 / 60.0),
    )
    state = simulator.rest_state()
    for _ in range(24):
        state = simulator.step(state).state
    frame = simulator._terms.in_frame(state.rows)
    ((surface, _),) = simulator._pierced._parts
    deformed = surface.at(simulator._evaluated(frame, state, Timings()))

    x = simulator.positions(state)
    assert condensed == (np.abs(x - jelly_body.basis @ state.rows).max() > 0.1 * DEPTH)
    z = down + RADIUS * np.random.default_rng(0).normal(size=(40, dim))
    mesh = jelly_body.mesh
    exact = SurfaceSearch(mesh.points, mesh.facets).nearest(z, x).depth
    found = deformed.depths(z, np.arange(len(deformed.approximate)), np.zeros(len(z), dtype=bool))
    # Nodes turn and settle as the contact points beside them do: some per cent of the dent.
    np.testing.assert_allclose(found, exact, atol=0.03 * DEPTH)


@pytest.mark.parametrize("refinement", [0, 2], ids=["nodes", "facets"])
def test_they_are_where_friction_has_dragged_them(jelly_body, dim, refinement):
    """By a ball that is dragged over the top and sticks to it."""
    mechanics, ball = compute_mechanics(jelly_body, 1000, False), Sphere(RADIUS, dim, "ball")
    top = np.append(np.full(dim - 1, -0.01), TOP + RADIUS)
    down = top - 0.5 * DEPTH * np.eye(dim)[-1]
    aside = down + 0.015 * np.eye(dim)[0]
    simulator = Simulator(
        jelly_body,
        [PlacedCollider("ball", ball, KeyframedPath([0.0, 0.1, 0.4], [top, down, aside]))],
        contact=PenaltyContact(1e10, refinement),
        mechanics=mechanics,
        friction=CoulombFriction(3.0),
        kinematic=[KinematicHandle("base")],
        settings=DynamicsSettings(1.0 / 60.0),
    )
    state = simulator.rest_state()
    for _ in range(24):
        state = simulator.step(state).state
    frame = simulator._terms.in_frame(state.rows, state.friction)
    body = simulator._evaluated(frame, state, Timings())
    ((surface, _),) = simulator._pierced._parts
    deformed, without = surface.at(body.displaced(state.friction)), surface.at(body.under(None))

    every = np.arange(len(deformed.approximate))
    dragged = np.linalg.norm(deformed.positions(every) - without.positions(every), axis=1).max()
    assert dragged > {2: 1e-3, 3: 2e-3}[dim]
    x, mesh = simulator.positions(state), jelly_body.mesh
    z = aside + RADIUS * np.random.default_rng(0).normal(size=(40, dim))
    exact = SurfaceSearch(mesh.points, mesh.facets).nearest(z, x).depth
    # As above, of a dent half as deep and what friction adds.
    np.testing.assert_allclose(
        deformed.depths(z, every, np.zeros(len(z), dtype=bool)), exact, atol=0.03 * DEPTH
    )
