"""A step is a function of its arguments: states can be replayed, stored, and stepped anywhere, to the same bits."""

from __future__ import annotations

import multiprocessing
import threading
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing.reduction import ForkingPickler

import numpy as np
import pytest

from softprint.runtime.colliders import Box, KeyframedPath, RigidPose, Sphere
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.dynamics import KinematicHandle, PlacedCollider, Simulator
from softprint.runtime.dynamics.state_file import load_state, save_state
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.force.correction import ForceCorrection
from softprint.runtime.learned.force.model import ForceModel, ForceModelOptions
from softprint.runtime.mechanics.body_mechanics import compute_mechanics

STIFFNESS = 1e10  # N/m^4
STEPS, BRANCH, BEYOND = 14, 8, 4  # of the motion; where it is taken up again, in contact; for so many steps


def simulator_of(body, mechanics, friction, refinement=0):
    """A block held by its base, into whose top a ball with an (untrained) correction is pressed, and drawn aside; with
    contact on facets a box, with sharp edges."""
    dim = body.dim
    above, inside = np.full(dim, 0.01), np.full(dim, 0.01)
    above[-1], inside[-1], inside[0] = 0.085, 0.074, 0.014
    ball = Box([0.02] * dim, name="ball") if refinement else Sphere(0.02, dim, "ball")
    options = ForceModelOptions((4, 4), "silu", 5e-4, 3e-3, STIFFNESS, refinement=refinement)
    model = ForceModel(options, dim, body.n_rows)
    correction = ForceCorrection("force", model, body, ball, mechanics)
    path = KeyframedPath([0.0, 0.2], [above, inside])
    return Simulator(
        body,
        [PlacedCollider("ball", ball, path, correction)],
        contact=PenaltyContact(STIFFNESS, refinement),
        mechanics=mechanics,
        friction=friction,
        gravity=[0.0] * (dim - 1) + [-9.81],
        kinematic=[KinematicHandle("base")],
    )


def play(simulator, state, steps):
    """The states after each step."""
    states = []
    for _ in range(steps):
        state = simulator.step(state).state
        states.append(state)
    return states


@pytest.fixture(
    params=[(None, 0), (CoulombFriction(0.4), 0), (CoulombFriction(0.4), 2)],
    ids=["smooth", "rough", "rough, with sharp edges"],
)
def motion(jelly_body, request):
    """A simulator, and the states of a motion of its body."""
    mechanics = compute_mechanics(jelly_body, 300, True)
    simulator = simulator_of(jelly_body, mechanics, *request.param)
    states = play(simulator, simulator.settle().state, STEPS)
    contact = states[BRANCH].contact
    assert contact is not None  # the motion is in contact where it is taken up again
    assert (contact.pressed is not None) == (request.param[1] > 0)
    return simulator, states


def same_bits(one, other):
    np.testing.assert_array_equal(one.rows, other.rows)
    np.testing.assert_array_equal(one.rows_velocity, other.rows_velocity)


def test_the_body_is_drawn_as_friction_bends_it(motion):
    simulator, states = motion
    state, friction = states[BRANCH], states[BRANCH].friction
    if simulator._friction is None:
        assert friction is None
        return
    assert friction is not None
    moved = simulator.positions(state) - simulator.positions(replace(state, friction=None))
    assert not moved[simulator.body.handles.frame_nodes].any()
    # The block is strained by some tenths at most, so that rest and world coordinates are nearly the same.
    nodes = simulator.mechanics.surface_compliance.nodes[friction.nodes]
    work = (friction.forces * moved[nodes]).sum()
    assert work > 0.5 * np.linalg.norm(friction.forces) * np.linalg.norm(moved[nodes])


def test_the_same_state_steps_to_the_same_bits_in_any_order(motion):
    simulator, states = motion
    order = np.random.default_rng(0).permutation(STEPS - 1)
    for k in (*order, order[0], order[0]):
        same_bits(simulator.step(states[k]).state, states[k + 1])


def test_simulators_that_share_a_correction_do_not_feel_each_other(motion):
    first, states = motion
    second = Simulator(
        first.body,
        first.colliders,
        contact=first.colliders[0].correction.law,
        mechanics=first.mechanics,
        friction=first._friction,
        gravity=first._gravity,
        kinematic=[KinematicHandle("base")],
    )
    state, elsewhere = states[BRANCH], states[2]
    for k in range(BEYOND):
        state = first.step(state).state
        elsewhere = second.step(elsewhere).state  # at another place of the same motion, in between
        same_bits(state, states[BRANCH + 1 + k])
        same_bits(elsewhere, states[3 + k])


def test_a_stored_state_goes_on_with_the_same_bits(motion, tmp_path):
    simulator, states = motion
    save_state(tmp_path / "state.h5", states[BRANCH])
    loaded = load_state(tmp_path / "state.h5")
    assert loaded.time == states[BRANCH].time
    same_bits(play(simulator, loaded, BEYOND)[-1], states[BRANCH + BEYOND])
    drawn = simulator.surface_positions(loaded)
    np.testing.assert_array_equal(drawn, simulator.surface_positions(states[BRANCH]))


def play_elsewhere(pickled, path):
    """In another process: goes on from a stored state."""
    return play(ForkingPickler.loads(pickled), load_state(path), BEYOND)[-1]


@pytest.fixture(scope="module")
def processes():
    """One of each kind, as a new interpreter takes seconds to start."""
    found = {
        method: ProcessPoolExecutor(1, mp_context=multiprocessing.get_context(method))
        for method in ("fork", "spawn")
    }
    yield found
    for process in found.values():
        process.shutdown()


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_another_process_goes_on_with_the_same_bits(motion, processes, tmp_path, method):
    simulator, states = motion
    save_state(tmp_path / "state.h5", states[BRANCH])
    pickled = bytes(ForkingPickler.dumps(simulator))
    reached = processes[method].submit(play_elsewhere, pickled, tmp_path / "state.h5").result()
    same_bits(reached, states[BRANCH + BEYOND])


def test_threads_that_share_a_simulator_come_to_the_same_bits(motion):
    simulator, states = motion
    reached = {}

    def run(first):
        reached[first] = play(simulator, states[first], BEYOND)[-1]

    threads = [threading.Thread(target=run, args=(first,)) for first in (2, 5, BRANCH)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for first, state in reached.items():
        same_bits(state, states[first + BEYOND])


def test_a_file_that_is_no_state_is_refused_in_one_sentence(motion, tmp_path):
    simulator, states = motion
    with pytest.raises(SoftprintError, match="what is saved must be a ReducedState, not a StepResult"):
        save_state(tmp_path / "result.h5", simulator.step(states[0]))
    assert not (tmp_path / "result.h5").exists()
    with pytest.raises(SoftprintError, match="there is no such state file"):
        load_state(tmp_path / "missing.h5")
    path = tmp_path / "state.h5"
    save_state(path, states[0])
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(SoftprintError, match=r"state\.h5"):
        load_state(path)


def test_a_collider_that_is_put_elsewhere_leaves_its_contact_behind(jelly_body, dim):
    """Forces and drawn nodes are those of the poses of the state, not of the contact that it carries."""
    mechanics = compute_mechanics(jelly_body, 400, True)
    simulator = simulator_of(jelly_body, mechanics, None)
    pressed = play(simulator, simulator.rest_state(), BRANCH)[-1]
    assert np.linalg.norm(simulator.contact_forces(pressed)["ball"].force) > 0.0
    far = pressed.poses["ball"].translation + np.append(np.zeros(dim - 1), 0.05)
    lifted = replace(pressed, poses={"ball": RigidPose(np.eye(dim), far)})
    assert np.array_equal(simulator.contact_forces(lifted)["ball"].force, np.zeros(dim))
    anew = replace(lifted, contact=None)
    np.testing.assert_array_equal(simulator.positions(lifted), simulator.positions(anew))
    assert np.abs(simulator.positions(lifted) - simulator.positions(pressed)).max() > 1e-4


def test_a_state_with_contact_at_points_that_are_not_there_is_refused(jelly_body):
    """Of mechanics with more contact nodes: it was an IndexError."""
    many, few = (simulator_of(jelly_body, compute_mechanics(jelly_body, n, True), None) for n in (300, 10))
    touching = play(many, many.settle().state, STEPS)[BRANCH]
    assert touching.contact.index.max() >= 10
    for slip in (few.step, few.settle):
        with pytest.raises(SoftprintError, match="contact at points that this simulator does not have"):
            slip(touching)
