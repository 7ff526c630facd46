"""Simulators that share all but what holds the body, and springs on material points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from softprint.runtime.colliders import KeyframedPath
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics import (
    DynamicsSettings,
    HandleSpring,
    KinematicHandle,
    NewtonSettings,
    Simulator,
)
from softprint.runtime.dynamics.hold import held
from softprint.runtime.dynamics.terms import kept_elastic_hessian
from softprint.runtime.dynamics.terms.springs import PointSpring, Springs
from softprint.runtime.errors import SoftprintError

LAW = PenaltyContact(1e10)


def stepped(simulator, count: int = 4):
    state = simulator.rest_state()
    for _ in range(count):
        state = simulator.step(state).state
    return state.rows


def test_held_otherwise_is_the_same_as_made_otherwise(dim, jelly_body):
    body = jelly_body
    up = np.eye(dim)[-1]
    target = KeyframedPath([0.0], [body.mesh.points[body.handles.points[0]] + 0.01 * up])
    spring, kinematic = HandleSpring(0, 50.0, target), KinematicHandle("base")
    settings = DynamicsSettings(1 / 100, NewtonSettings(max_iterations=7))
    made = Simulator(body, contact=LAW, springs=[spring], kinematic=[kinematic], settings=settings)
    first = Simulator(body, contact=LAW)
    other = held(first, [spring], [kinematic], settings)
    assert np.array_equal(stepped(other), stepped(made))
    # The first one is what it was.
    assert np.array_equal(stepped(first), stepped(Simulator(body, contact=LAW)))


def test_a_state_passes_from_one_hold_to_another(dim, jelly_body, monkeypatch):
    """The elastic Hessian and the factorisation that it carries are of other free coordinates, though of as many."""
    monkeypatch.setattr(kept_elastic_hessian, "_EXPENSIVE", 0.0)
    settings = DynamicsSettings(1 / 100, NewtonSettings(max_iterations=20, tolerance=1e-9))
    one, other = ([KinematicHandle("base"), KinematicHandle(k)] for k in (0, jelly_body.handles.n_points - 1))
    gravity = np.append(np.zeros(dim - 1), -9.81)
    first = Simulator(jelly_body, contact=LAW, gravity=gravity, kinematic=one, settings=settings)
    second = held(first, kinematic=other)
    state = first.rest_state()
    for _ in range(3):
        state = first.step(state).state
    assert state.elastic_hessian is not None
    assert state.factorisation is not None
    carried, fresh = state, replace(state, elastic_hessian=None, factorisation=None)
    for _ in range(3):
        results = [second.step(carried), second.step(fresh)]
        assert all(result.converged for result in results)
        carried, fresh = (result.state for result in results)
        # The same starts and Hessians, so the same bits.
        assert np.array_equal(carried.rows, fresh.rows)
    assert np.abs(carried.rows - state.rows).max() > 1e-5


def test_a_spring_on_the_point_of_a_handle_is_the_spring_of_that_handle(dim, jelly_body):
    body, rng = jelly_body, np.random.default_rng(1)
    target = KeyframedPath([0.0], [np.full(dim, 0.03)])
    node = int(body.handles.points[1])
    at_point = Springs([PointSpring(body.basis[node], 70.0, target)], body.handles).form(0.0)
    at_handle = Springs([HandleSpring(1, 70.0, target)], body.handles).form(0.0)
    rows = body.rest_rows + 1e-3 * rng.standard_normal(body.rest_rows.shape)
    # The basis interpolates handles to 1e-9 or so.
    assert at_point.energy(rows) == pytest.approx(at_handle.energy(rows), rel=1e-6)
    stretch = body.basis[node] @ rows - 0.03
    assert at_point.energy(rows) == pytest.approx(0.5 * 70.0 * float(stretch @ stretch), rel=1e-9)


def test_a_spring_pushes_nothing_where_it_should(dim, jelly_body):
    with pytest.raises(SoftprintError, match="positive"):
        PointSpring(jelly_body.basis[0], -1.0, KeyframedPath([0.0], [np.zeros(dim)]))


def test_what_is_no_spring_of_this_body_is_refused(dim, jelly_body):
    here, elsewhere = (KeyframedPath([0.0], [np.zeros(d)]) for d in (dim, 5 - dim))
    for slip, sentence in (
        ("base", "a spring must be a HandleSpring or a PointSpring, not a str"),
        (HandleSpring("base", 1.0, elsewhere), f"a path in {5 - dim}D, and the body is {dim}D"),
        (PointSpring(jelly_body.basis[0, :-1], 1.0, here), "give the row of `body.basis` of the point"),
        (HandleSpring("base", 1.0, here, anchor=np.zeros(5 - dim)), "a point of the rest body"),
    ):
        with pytest.raises(SoftprintError, match=sentence):
            Simulator(jelly_body, contact=LAW, springs=[slip])
