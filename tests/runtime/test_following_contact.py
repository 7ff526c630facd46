"""Contacts that are followed: of several equilibria, that which a slow press from outside comes to."""

import numpy as np
import pytest

from runtime.colliders import Capsule, KeyframedPath, RigidPose, Sphere
from runtime.contact import PenaltyContact
from runtime.contact.condensed.contact_potential import ContactPotential
from runtime.contact.condensed.equilibrium import LoadProbe
from runtime.contact.condensed.potential_group import JointPotential, SinglePotential
from runtime.dynamics import KinematicHandle, PlacedCollider, Simulator
from runtime.learned.correction import FollowsContact
from runtime.learned.force.contact_state import ContactStateProbe
from runtime.learned.force.correction import ForceCorrection
from runtime.learned.force.model import ForceModel, ForceModelOptions
from runtime.mechanics.body_mechanics import compute_mechanics

TOP, RADIUS, DEPTH = 0.06, 0.004, 0.006
STIFFNESS, BAND = 1e10, 0.004


def lying(depth):
    """A thin rod pressed flat into the top of the block."""
    return RigidPose(np.eye(2), np.array([0.003, TOP + RADIUS - depth]))


@pytest.fixture(scope="module")
def pressed(jelly2d_body):
    rod = Capsule([-0.02, 0.0], [0.02, 0.0], RADIUS, "rod")
    return rod, compute_mechanics(jelly2d_body, 400, internal=False)


def heights(probe, rows, pose):
    """By how much the loads that bear pressure are moved upwards [m]."""
    press = probe.loads.press(rows, pose, rows)
    return press.solution.moved[press.bearing, 1]


def test_a_thin_rod_that_is_followed_does_not_let_the_surface_through(jelly2d_body, pressed):
    """Deeper than its middle, the near way out of it is on the other side; that is where loads go that are put there at
    once, and where they are not carried."""
    rod, mechanics = pressed
    probe = ContactStateProbe(jelly2d_body, rod, mechanics, STIFFNESS, BAND)
    rows = jelly2d_body.rest_rows
    probe.begin()
    at_once = heights(probe, rows, lying(DEPTH))
    assert DEPTH > RADIUS
    assert at_once.max() > 0.0
    probe.begin()
    for depth in DEPTH * np.arange(1, 8) / 8:
        probe.lead(rows, lying(depth))
    followed = heights(probe, rows, lying(DEPTH))
    # Those under the rod are moved by most of the depth; the last two, by its round ends, aside.
    assert (np.sort(followed)[:-2] < -0.5 * DEPTH).all()
    probe.begin()
    np.testing.assert_array_equal(heights(probe, rows, lying(DEPTH)), at_once)


@pytest.mark.parametrize("band", [BAND, 0.0])
def test_what_has_gone_through_a_thin_rod_is_not_let_go(jelly2d_body, pressed, band):
    """Pressed in by twice its thickness: undisplaced, all of the surface under it is beyond it, farther out than loads
    are looked for. A linear body's energy goes with the square of the depth, and a bit more while more of the depth is
    the body's and less the penalty's."""
    rod, mechanics = pressed
    rows, probe = jelly2d_body.rest_rows, LoadProbe(jelly2d_body, rod, mechanics, STIFFNESS, band)
    presses = [probe.press(rows, lying(depth), rows) for depth in RADIUS * np.arange(1, 33) / 8]
    assert all(press.solution.converged for press in presses)
    through = presses[-1]
    assert rod.sdf(lying(4.0 * RADIUS).apply_inverse(through.around_position)).min() > 1.5 * BAND
    energies = np.array([press.solution.energy for press in presses])
    assert 4.0 < energies[-1] / energies[15] < 5.0
    # Nowhere does it leap: its second differences are positive and change slowly.
    bend = np.diff(energies, 2)
    assert (bend > 0.0).all()
    assert np.abs(np.diff(bend)).max() < 0.2 * bend.max()
    # Drawn out slowly enough to be followed, it lets go.
    for depth in RADIUS * np.arange(31, -2, -1) / 8:
        out = probe.press(rows, lying(depth), rows)
    assert out is None or not out.bearing.size


def groups(body, pressed):
    """The rod on its own, and together with another collider that is far away."""
    rod, mechanics = pressed
    far = Sphere(0.01, 2, "far")

    def of(collider):
        return ContactPotential(LoadProbe(body, collider, mechanics, STIFFNESS))

    return SinglePotential("rod", of(rod)), JointPotential({"rod": of(rod), "far": of(far)})


def test_together_with_others_it_is_not_let_go_either(jelly2d_body, pressed):
    """A collider that touches nothing changes nothing; what differs is the order in which floats are summed."""
    rows = jelly2d_body.rest_rows
    alone, together = groups(jelly2d_body, pressed)
    for depth in RADIUS * np.arange(1, 33) / 8:
        poses = {"rod": lying(depth), "far": RigidPose(np.eye(2), np.array([0.0, 1.0]))}
        energy = alone.linearise(rows, poses, rows)[0]
        assert energy > 0.0
        assert together.linearise(rows, poses, rows)[0] == pytest.approx(energy, rel=1e-6)
    # What is drawn of it, too, knows of all loads that bear pressure.
    rod, mechanics = pressed
    joint = together.probe.press(rows, poses, rows)
    measured = ContactStateProbe(jelly2d_body, rod, mechanics, STIFFNESS, BAND).measure(
        rows, poses["rod"], rows, joint
    )
    assert set(joint.press.pressed) <= set(measured.index)
    np.testing.assert_array_equal(
        measured.load[np.isin(measured.index, joint.press.pressed)], joint.press.load
    )


def test_what_comes_in_past_the_middle_stays_on_its_side(jelly2d_body, pressed):
    """A tilted rod, thinner than the next step is long, comes to a load that did not bear pressure: the near way out is
    on the other side, but that is not where the load came from."""
    thin, mechanics = Capsule([-0.03, 0.0], [0.03, 0.0], 0.002, "thin"), pressed[1]
    rows, probe = jelly2d_body.rest_rows, LoadProbe(jelly2d_body, thin, mechanics, STIFFNESS, BAND)

    def down_to(height):
        pose = RigidPose.from_rotation_vector([0.25], [0.02, TOP + height])
        return pose, probe.press(rows, pose, rows)

    for height in np.arange(0.0090, 0.0064, -0.0005):
        before = down_to(height)[1]
    pose, press = down_to(0.0041)
    came = press.index[np.isin(press.index, before.index) & ~np.isin(press.index, before.pressed)]
    position = probe.loads.positions(rows, rows, came)
    assert came.size == 1
    assert thin.sdf(pose.apply_inverse(position)) < 0.0 < pose.apply_inverse(position)[0, 1]
    assert press.solution.normal[press.index == came][0, 1] < 0.0
    probe.begin()
    at_once = down_to(0.0041)[1]
    assert at_once.solution.normal[at_once.index == came][0, 1] > 0.0


def test_what_is_drawn_out_at_once_lets_go(jelly2d_body, pressed):
    """A collider that has leapt away is another contact, and takes nothing along."""
    rod, mechanics = pressed
    rows, probe = jelly2d_body.rest_rows, LoadProbe(jelly2d_body, rod, mechanics, STIFFNESS, BAND)
    for depth in RADIUS * np.arange(1, 33) / 8:
        assert probe.press(rows, lying(depth), rows).bearing.size
    assert probe.press(rows, lying(-0.03), rows) is None


def test_a_trial_elsewhere_changes_nothing(jelly2d_body, pressed):
    """A line search looks about the state that was linearised, wherever its last trial was."""
    rows = jelly2d_body.rest_rows

    def poses(depth):
        return {"rod": lying(depth), "far": RigidPose(np.eye(2), np.array([0.0, 1.0]))}

    for group in groups(jelly2d_body, pressed):
        for depth in DEPTH * np.arange(1, 9) / 8:
            followed = group.linearise(rows, poses(depth), rows)[0]
        trial = group.energy(rows, poses(0.98 * DEPTH), rows)
        assert trial == pytest.approx(followed, rel=0.05)
        assert group.energy(rows, poses(-0.001), rows) == 0.0
        assert group.energy(rows, poses(0.98 * DEPTH), rows) == trial
        group.begin()
        # At once the rod is let through, at a tenth of the energy.
        assert group.energy(rows, poses(0.98 * DEPTH), rows) < 0.2 * trial


def test_a_motion_begins_anew(jelly2d_body, pressed):
    """The rod begins deep in the block, goes out and comes in again, in balance otherwise than it was at the start."""
    rod, mechanics = pressed
    model = ForceModel(ForceModelOptions((8,), "silu", 1e-3, BAND, STIFFNESS), 2, jelly2d_body.n_rows)
    path = KeyframedPath([0.0, 0.3, 0.6], [lying(depth).translation for depth in (DEPTH, -0.002, DEPTH)])
    correction = ForceCorrection("mechanics", model, jelly2d_body, rod, mechanics)
    handles = jelly2d_body.handles
    held = [*(frame.name for frame in handles.frames), *range(handles.n_points)]
    simulator = Simulator(
        jelly2d_body,
        [PlacedCollider("rod", rod, path, correction=correction)],
        contact=PenaltyContact(STIFFNESS),
        kinematic=[KinematicHandle(handle, None) for handle in held],
    )

    def forces():
        result = simulator.settle()
        found = [result.contacts["rod"].force]
        for _ in range(36):
            result = simulator.step(result.state)
            found.append(result.contacts["rod"].force)
        return np.array(found)

    first = forces()
    assert first[0, 1] * first[-1, 1] < 0.0
    np.testing.assert_array_equal(forces(), first)


def test_a_bound_correction_is_led_like_its_loads(jelly2d_body, pressed):
    rod, mechanics = pressed
    model = ForceModel(ForceModelOptions((8,), "silu", 1e-3, BAND, STIFFNESS), 2, jelly2d_body.n_rows)
    bound = ForceCorrection("mechanics", model, jelly2d_body, rod, mechanics).bind(jelly2d_body.node_points())
    assert isinstance(bound, FollowsContact)
    rows, under = jelly2d_body.rest_rows, np.abs(jelly2d_body.mesh.points - [0.003, TOP]).max(axis=1) < 0.01
    bound.begin()
    at_once = bound.displacement(rows, lying(DEPTH))
    bound.begin()
    for depth in DEPTH * np.arange(1, 8) / 8:
        bound.lead(rows, lying(depth))
    followed = bound.displacement(rows, lying(DEPTH))
    top = under & (jelly2d_body.mesh.points[:, 1] > TOP - 1e-9)
    assert followed[top, 1].max() < -0.5 * DEPTH
    assert at_once[top, 1].max() > 0.0
