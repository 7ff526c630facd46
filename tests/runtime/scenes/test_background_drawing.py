"""A surface drawn in parallel with the following steps is the same as one drawn immediately."""

import time
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from softprint.runtime.colliders import KeyframedPath, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics import KinematicHandle, PlacedCollider, Simulator
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.force.correction import ForceCorrection
from softprint.runtime.learned.force.model import ForceModel, ForceModelOptions
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mechanics.compliance.local_compliance import LocalCompliance
from softprint.runtime.scenes.background_drawing import BackgroundDrawing
from softprint.runtime.scenes.playing import ReducedModel
from softprint.runtime.scenes.speed import measure, speed_table

STIFFNESS = 1e10  # N/m^4


@pytest.fixture
def simulator(jelly_body, dim):
    """A ball that moves along keyframes through the top of a block, with a correction that changes the surface."""
    torch.manual_seed(1)
    model = ForceModel(ForceModelOptions((4, 4), "silu", 5e-4, 1e-2, STIFFNESS), dim, jelly_body.n_rows)
    with torch.no_grad():
        model.network.head.bias.fill_(0.3)
    ball = Sphere(0.02, dim, "ball")
    ends = [np.append(np.full(dim - 1, aside), 0.06 + 0.02 - 0.006) for aside in (-0.015, 0.015)]
    mechanics = compute_mechanics(jelly_body, 400, True)
    path = KeyframedPath([0.0, 0.2], ends)
    placed = PlacedCollider(
        "ball", ball, path, correction=ForceCorrection("x", model, jelly_body, ball, mechanics)
    )
    held = [KinematicHandle(frame.name, None) for frame in jelly_body.handles.frames]
    return Simulator(
        jelly_body, [placed], contact=PenaltyContact(STIFFNESS), mechanics=mechanics, kinematic=held
    )


def test_a_surface_drawn_later_is_the_same(simulator):
    state = simulator.rest_state()
    drawn = []
    for _ in range(5):
        state = simulator.step(state).state
        drawn.append((simulator.surface_snapshot(state), simulator.surface_positions(state)))
    assert np.abs(drawn[-1][1] - drawn[0][1]).max() > 1e-4  # something has moved
    for snapshot, at_once in drawn:
        np.testing.assert_array_equal(simulator.surface_drawn(snapshot), at_once)


def played(simulator, draw, frames=8):
    """The drawn surface of each frame."""
    state, surfaces = simulator.rest_state(), []
    for _ in range(frames):
        state = simulator.step(state).state
        surfaces.append(draw(state))
    return surfaces


def test_surfaces_drawn_on_another_thread_during_steps(simulator):
    alone = played(simulator, simulator.surface_positions)
    with ThreadPoolExecutor(1) as second:

        def submitted(state):
            return second.submit(simulator.surface_drawn, simulator.surface_snapshot(state))

        beside = [surface.result() for surface in played(simulator, submitted)]
    np.testing.assert_array_equal(beside, alone)


def test_surfaces_drawn_in_another_process_one_frame_late(simulator):
    alone = played(simulator, simulator.surface_positions)
    with BackgroundDrawing(simulator) as drawer:
        first, *beside = played(simulator, drawer.next)
        assert first is None
        np.testing.assert_array_equal([*beside, drawer.last()], alone)
        assert drawer.last() is None


def test_two_drawings_may_end_in_any_order(simulator):
    state = simulator.step(simulator.rest_state()).state
    drawers = [BackgroundDrawing(simulator) for _ in range(2)]
    for drawer in drawers:
        drawer.next(state)
    for drawer in drawers:
        np.testing.assert_array_equal(drawer.last(), simulator.surface_positions(state))
        drawer.close()
        drawer.close()


def test_an_error_in_the_other_process_is_reported(simulator):
    state = simulator.step(simulator.rest_state()).state
    with BackgroundDrawing(simulator) as drawer:
        drawer.next(state)
        assert drawer.last() is not None
        drawer._ours.send(simulator.surface_snapshot(state)._replace(rows="no numbers"))
        drawer._waiting = True
        with pytest.raises(Exception, match=r".+"):
            drawer.last()
        # It continues to work.
        drawer.next(state)
        np.testing.assert_array_equal(drawer.last(), simulator.surface_positions(state))


def test_a_killed_process_is_reported(simulator):
    state = simulator.step(simulator.rest_state()).state
    with BackgroundDrawing(simulator) as drawer:
        drawer.next(state)
        drawer.last()
        drawer._process.kill()
        drawer._process.join()
        with pytest.raises(SoftprintError, match="has ended"):
            drawer.next(state)


def test_measured_on_two_cores(simulator):
    model = ReducedModel(simulator, held=False)
    one, two = (measure("ours", model, 6, 4, beside) for beside in (False, True))
    assert one is not None
    assert two is not None
    assert (one.steps, two.steps) == (4, 4)
    assert two.converged == one.converged
    assert set(two.phases) == set(one.phases)


def test_returned_compliance_does_not_change_with_later_requests():
    """A new array is allocated for nodes that do not fit beside cached ones."""
    rng = np.random.default_rng(3)
    all_pairs = rng.normal(size=(2000, 2000, 2, 2)).astype(np.float32)
    all_pairs += all_pairs.transpose(1, 0, 3, 2).copy()
    compliance = LocalCompliance(all_pairs)
    orders = [np.sort(rng.choice(2000, 150, replace=False)) for _ in range(40)]
    forces = rng.normal(size=(150, 2))

    def ask(nodes):
        return compliance.displacement(nodes, nodes, forces)

    with ThreadPoolExecutor(4) as threads:
        for nodes, found in zip(orders, threads.map(ask, orders), strict=True):
            expected = np.einsum("ijcd,jd->ic", all_pairs[np.ix_(nodes, nodes)], forces)
            # Sums of float64 products, in another order.
            np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


class Played:
    """Replaces a model of a scene: a step takes a given time; steps without a time have no contact. The first contact
    takes longer, as if kernels were compiled."""

    def __init__(self, seconds, first=0.0):
        self.seconds, self.first = seconds, first

    def start(self):
        return SimpleNamespace(state=0)

    def step(self, at):
        took = self.seconds[at]
        if took > 0:
            time.sleep(took + self.first)
            self.first = 0.0
        return SimpleNamespace(
            state=at + 1, in_contact=took > 0, iterations=1, converged=took < 0.02, timings={}
        )

    def surface_positions(self, at):
        return None


def test_slow_frames_at_the_end_are_seen():
    """Nine steps of 1 ms in contact, and two of 30 ms, which do not affect the median."""
    seconds = [0.0] + 9 * [0.001] + 2 * [0.03]
    speed = measure("x", Played(seconds, first=0.5), len(seconds), None)
    assert speed.p95 < 0.25  # nothing is compiled while the clock runs
    assert (speed.steps, speed.converged) == (11, pytest.approx(9 / 11))
    # Sleeping takes its time at least, and a few milliseconds more on a busy machine.
    assert speed.median < 0.02 < 0.03 <= speed.p95
    assert speed.median < speed.mean < speed.p95
    assert speed.frames_per_second == pytest.approx(1.0 / speed.mean)
    first = measure("x", Played(seconds), len(seconds), 4)
    assert (first.steps, first.converged) == (4, 1.0)
    line = speed_table([speed])[1].split()
    assert line[1:5] == ["11", *(f"{1e3 * value:.2f}" for value in (speed.mean, speed.p95, speed.median))]
