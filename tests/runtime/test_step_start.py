"""Where a step starts: with forces that are linear it starts where it ends, and what moves contact is not foretold."""

from __future__ import annotations

import numpy as np
import pytest

from runtime.body import assemble_body, frame_in_box, place_handles
from runtime.colliders import KeyframedPath, Plane, RigidPose
from runtime.contact import CoulombFriction, PenaltyContact
from runtime.dynamics import (
    DynamicsSettings,
    HandleSpring,
    KinematicHandle,
    NewtonSettings,
    PlacedCollider,
    Simulator,
)
from runtime.elasticity import make_material
from runtime.mesh import box_mesh

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


def play(simulator, steps, poses=None):
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
    # The first step knows no forces yet; from then on one linear system is all there is to a step.
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
def test_foretold_steps_lead_where_others_lead(dim):
    foretold, forgetful = on_a_floor(dim), on_a_floor(dim)
    known, state = foretold.rest_state(), forgetful.rest_state()
    iterations = np.zeros(2, dtype=int)
    for _ in range(12):
        one = foretold.step(known)
        # A state that no step led to: nothing is known of it.
        other = forgetful.step(type(state)(**vars(state)))
        iterations += one.iterations, other.iterations
        known, state = one.state, other.state
    assert one.penetration > 0.0
    # Newton's tolerance, 1e-9 of the forces, summed over the steps.
    np.testing.assert_allclose(known.rows, state.rows, atol=1e-9)
    assert iterations[0] < iterations[1]


@dims
@pytest.mark.parametrize("what", ["collider", "friction", "unbalanced"])
def test_nothing_is_foretold_where_contact_is_moved_or_forces_do_not_balance(dim, what):
    up = np.zeros(dim)
    up[-1] = 1e-3
    path = KeyframedPath([0.0, 1.0], [np.zeros(dim), up])
    newton = NewtonSettings(1, 1e-12) if what == "unbalanced" else NewtonSettings(50, 1e-9)
    friction = CoulombFriction(0.3, 1e-3) if what == "friction" else None
    simulator = on_a_floor(dim, path if what == "collider" else None, newton, friction)
    first = simulator.step(simulator.rest_state()).state
    again = type(first)(**vars(first))
    foretold = simulator.step(first).state.rows
    # The same to the last bit as from a state of which nothing is known.
    np.testing.assert_array_equal(foretold, simulator.step(again).state.rows)
