"""The start of a step: for linear forces it is the solution; nothing is predicted where contact changes."""

from __future__ import annotations

import numpy as np
import pytest

from softprint.runtime.body import assemble_body, frame_in_box, place_handles
from softprint.runtime.colliders import KeyframedPath, Plane, RigidPose
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.dynamics import (
    DynamicsSettings,
    HandleSpring,
    KinematicHandle,
    NewtonSettings,
    PlacedCollider,
    ReducedState,
    Simulator,
)
from softprint.runtime.elasticity import make_material
from softprint.runtime.mesh import box_mesh

H = 0.01
CONTACT = PenaltyContact(1e8)
dims = pytest.mark.parametrize("dim", [2, 3])


def make_body(dim, material, frames):
    mesh = box_mesh([0.0] * dim, [0.1, 0.05, 0.05][:dim], [6, 3, 3][:dim])
    regions = [frame_in_box(mesh, "base", [[-1.0] * dim, [0.02] + [1.0] * (dim - 1)])] if frames else []
    return assemble_body(mesh, place_handles(mesh, 5, regions), make_material(material, 2e4, 0.4), 1000.0)


def pulled(dim, handle, by):
    """A spring that drags a handle along the last axis."""
    away = np.zeros(dim)
    away[-1] = by
    return HandleSpring(handle, 50.0, KeyframedPath([0.0, 1.0], [np.zeros(dim), away]))


def unknown(state):
    """The same state without a previous step, so that nothing can be predicted."""
    kept = state.time, state.rows, state.rows_velocity, state.poses, state.motions, state.frame_rows
    return ReducedState(*kept)


def play(simulator, steps):
    results, state = [], simulator.rest_state()
    for _ in range(steps):
        results.append(simulator.step(state))
        state = results[-1].state
    return results


@dims
@pytest.mark.parametrize("led", [False, True], ids=["pulled", "led"])
def test_with_linear_forces_a_step_starts_where_it_ends(dim, led):
    body = make_body(dim, "linear", frames=False)
    spring = pulled(dim, 0, 0.05)
    held = {"kinematic": [KinematicHandle(0, spring.target)]} if led else {"springs": [spring]}
    settings = DynamicsSettings(H, NewtonSettings(tolerance=1e-7))
    results = play(Simulator(body, contact=CONTACT, settings=settings, **held), 4)
    # The first step has no previous forces; from then on a step is one linear solve.
    assert results[0].iterations == 1
    assert [result.iterations for result in results[1:]] == [0, 0, 0]
    assert all(result.converged for result in results)


def on_a_floor(dim, path=None, newton=None, friction=None):
    body = make_body(dim, "stable_neo_hookean", frames=True)
    gravity = [0.0] * (dim - 1) + [-9.81]
    normal = [0.0] * (dim - 1) + [1.0]
    floor = PlacedCollider("floor", Plane(normal), path or KeyframedPath.constant(RigidPose.identity(dim)))
    settings = DynamicsSettings(H, newton or NewtonSettings(50, 1e-9))
    springs = [pulled(dim, "base", 0.01)]
    return Simulator(
        body,
        [floor],
        contact=CONTACT,
        friction=friction,
        gravity=gravity,
        springs=springs,
        settings=settings,
    )


@dims
def test_predicted_steps_agree_with_others(dim):
    simulator = on_a_floor(dim)
    known = state = simulator.rest_state()
    iterations = np.zeros(2, dtype=int)
    for _ in range(12):
        one = simulator.step(known)
        other = simulator.step(unknown(state))
        iterations += one.iterations, other.iterations
        known, state = one.state, other.state
    assert one.penetration > 0.0
    # Newton's tolerance, 1e-9 of the forces, summed over the steps.
    np.testing.assert_allclose(known.rows, state.rows, atol=1e-9)
    assert iterations[0] < iterations[1]


@dims
@pytest.mark.parametrize("what", ["collider", "friction", "unbalanced"])
def test_nothing_is_predicted_with_moving_contact_or_unbalanced_forces(dim, what):
    up = np.zeros(dim)
    up[-1] = 1e-3
    path = KeyframedPath([0.0, 1.0], [np.zeros(dim), up])
    newton = NewtonSettings(1, 1e-12) if what == "unbalanced" else NewtonSettings(50, 1e-9)
    friction = CoulombFriction(0.3, 1e-3) if what == "friction" else None
    simulator = on_a_floor(dim, path if what == "collider" else None, newton, friction)
    first = simulator.step(simulator.rest_state()).state
    assert (first.factorisation is not None) == (what == "collider")
    # Bitwise the same as from a state without a previous step.
    rows = simulator.step(first).state.rows
    np.testing.assert_array_equal(rows, simulator.step(unknown(first)).state.rows)
