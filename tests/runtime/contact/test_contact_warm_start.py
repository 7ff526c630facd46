"""Contacts that are followed from state to state: of several equilibria, that which a slow approach from outside comes
to."""

from dataclasses import replace

import numpy as np
import pytest

from softprint.runtime.colliders import Capsule, KeyframedPath, RigidPose, Sphere
from softprint.runtime.colliders.pose import rotation_matrix
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.contact.solver import sharp_search
from softprint.runtime.contact.solver.candidates import PointDistance, PosedCollider
from softprint.runtime.contact.solver.contact_solve import ContactProblem
from softprint.runtime.contact.solver.warm_start import WarmStart
from softprint.runtime.dynamics import KinematicHandle, PlacedCollider, Simulator
from softprint.runtime.learned.force.contact_state import ContactMeasurement, ContactStateProbe
from softprint.runtime.learned.force.correction import ForceCorrection
from softprint.runtime.learned.force.model import ForceModel, ForceModelOptions
from softprint.runtime.learned.static_correction import StaticCorrection
from softprint.runtime.mechanics.body_mechanics import compute_mechanics

TOP, RADIUS, DEPTH = 0.06, 0.004, 0.006
STIFFNESS, BAND = 1e10, 0.004
FAR = RigidPose(np.eye(2), np.array([0.0, 1.0]))


def lying(depth):
    """A thin rod pressed flat into the top of the block."""
    return RigidPose(np.eye(2), np.array([0.003, TOP + RADIUS - depth]))


@pytest.fixture(autouse=True)
def contact_points_alone(monkeypatch):
    """Without sharp points on the rod, which is blunter than tips: these bear as far as the last dent has stretched the
    surface, so that two ways to a state differ by more than the balance of forces."""
    monkeypatch.setattr(sharp_search, "BLUNT", 1.0)


@pytest.fixture(scope="module")
def rod():
    # Of a length with which no point leaves it round an end.
    return Capsule([-0.021, 0.0], [0.021, 0.0], RADIUS, "rod")


@pytest.fixture(scope="module")
def mechanics(jelly2d_body):
    return compute_mechanics(jelly2d_body, 400, condensation=False)


def followed(contact, rows, along):
    """The evaluations of the contact at one state of the body with colliders at poses, each started from the last."""
    nodes, found = contact.in_frame(rows), []
    for poses in along:
        found.append(contact.evaluate(nodes, rows, poses, found[-1].warm_start if found else None))
    return found


def heights(solved):
    """By how much the active nodes are displaced upwards [m]."""
    return solved.solution.displacement[solved.solution.active, 1]


def test_a_thin_rod_that_is_followed_does_not_let_the_surface_through(jelly2d_body, rod, mechanics):
    """Deeper than its middle, the near way out of it is on the other side; that is where nodes go that are put there at
    once, and where they are not carried."""
    probe = ContactStateProbe(jelly2d_body, rod, mechanics, PenaltyContact(STIFFNESS), BAND)
    rows = jelly2d_body.rest_rows
    at_once = heights(probe.solve(rows, lying(DEPTH)))
    assert DEPTH > RADIUS
    assert at_once.max() > 0.0
    near = None
    for depth in DEPTH * np.arange(1, 8) / 8:
        near = probe.solve(rows, lying(depth), near)
    along = heights(probe.solve(rows, lying(DEPTH), near))
    # Those under the rod are displaced by most of the depth; the last two, by its round ends, aside.
    assert (np.sort(along)[:-2] < -0.5 * DEPTH).all()
    np.testing.assert_array_equal(heights(probe.solve(rows, lying(DEPTH))), at_once)


@pytest.mark.parametrize("band", [BAND, 0.0])
def test_what_has_gone_through_a_thin_rod_is_not_let_go(jelly2d_body, rod, mechanics, band):
    """Pressed in by twice its thickness: without contact displacement, all of the surface under it is beyond it,
    farther out than candidates are searched for. A linear body's energy goes with the square of the depth, and a bit
    more while more of the depth is the body's and less the penalty's."""
    rows = jelly2d_body.rest_rows
    contact = CondensedContact.of(jelly2d_body, mechanics, {"rod": rod}, PenaltyContact(STIFFNESS), band)
    into = RADIUS * np.arange(1, 33) / 8
    # Drawn out slowly enough to be followed, it lets go.
    out_again = RADIUS * np.arange(31, -2, -1) / 8
    path = [{"rod": lying(depth)} for depth in (*into, *out_again)]
    evaluations = followed(contact, rows, path)
    pressed, out = evaluations[: len(into)], evaluations[-1]
    assert all(evaluation.converged for evaluation in pressed)
    nearby = pressed[-1].solved.near["rod"].position
    assert rod.sdf(lying(4.0 * RADIUS).apply_inverse(nearby)).min() > 1.5 * BAND
    energies = np.array([evaluation.energy for evaluation in pressed])
    assert 4.0 < energies[-1] / energies[15] < 5.0
    # Nowhere does it leap: its second differences are positive and change slowly.
    bend = np.diff(energies, 2)
    assert (bend > 0.0).all()
    assert np.abs(np.diff(bend)).max() < 0.2 * bend.max()
    assert not out.active_points("rod").index.size


def dragged(rod, along):
    """Pressed in beyond its middle, and from there along the top."""
    down = [lying(part) for part in np.linspace(0.0, DEPTH, 25)[1:]]
    return [{rod.name: pose} for pose in down], {
        rod.name: RigidPose(np.eye(2), down[-1].translation + np.array([along, 0.0]))
    }


def test_points_that_a_thin_rod_comes_to_start_where_the_dent_has_taken_them(
    jelly2d_body, mechanics, monkeypatch
):
    """Lower on its round end than where they would be without the dent."""
    rod, rows = Capsule([-0.012, 0.0], [0.012, 0.0], RADIUS, "rod"), jelly2d_body.rest_rows
    contact = CondensedContact.of(jelly2d_body, mechanics, {"rod": rod}, PenaltyContact(STIFFNESS, 4, 2))
    down, moved = dragged(rod, 0.009)
    before = followed(contact, rows, down)[-1]
    entering, undisplaced = [], []

    def predict(start, index, problem, poses, after, compliance, found=WarmStart.predict):
        began = found(start, index, problem, poses, after, compliance)
        penetration, normal = began
        new = np.isin(index, start.solved.index, invert=True) & (penetration > 0.0)
        entering.extend(normal[new, 1])
        undisplaced.extend(after(problem.position).gradient[new, 1])
        return began

    monkeypatch.setattr(WarmStart, "predict", predict)
    contact.evaluate(contact.in_frame(rows), rows, moved, before.warm_start)
    assert len(entering) >= 3
    assert (np.array(entering) < np.array(undisplaced)).all()


def test_a_contact_that_is_lost_on_the_way_is_followed_in_parts(jelly2d_body, mechanics, monkeypatch):
    """As if Newton's method could not follow a rod that moves by more than two millimetres at a time."""
    rod, rows = Capsule([-0.012, 0.0], [0.012, 0.0], RADIUS, "rod"), jelly2d_body.rest_rows
    contact = CondensedContact.of(jelly2d_body, mechanics, {"rod": rod}, PenaltyContact(STIFFNESS))
    points, down = contact.in_frame(rows), [{"rod": lying(0.5 * RADIUS)}]
    before = followed(contact, rows, down)[-1]
    end = {"rod": RigidPose(np.eye(2), down[0]["rod"].translation + np.array([0.004, 0.0]))}
    expected = contact.evaluate(points, rows, end, before.warm_start)
    places = []

    def follow(problem, start, most=np.inf, found=ContactProblem.follow):
        (collider,) = problem.distance.colliders
        there = collider.pose.translation[0]
        if start is None or there - places[-1] > 0.0021:
            return None
        places.append(there)
        return found(problem, start, most)

    places.append(down[0]["rod"].translation[0])
    monkeypatch.setattr(ContactProblem, "follow", follow)
    found = contact.evaluate(points, rows, end, before.warm_start)
    ways = np.diff(np.unique(np.round(places, 9)))
    np.testing.assert_allclose(ways, 0.002, rtol=1e-6)
    assert len(ways) == 2
    # Both are balanced to 1e-5 of the depth.
    assert found.energy == pytest.approx(expected.energy, rel=1e-8)


def test_a_way_too_long_for_one_prediction_is_followed_in_parts(jelly2d_body, rod, mechanics):
    """From a shallow contact to beyond the middle of the rod at once: more than twice the displacement by contact, from
    which nothing is predicted."""
    rows = jelly2d_body.rest_rows
    contact = CondensedContact.of(jelly2d_body, mechanics, {"rod": rod}, PenaltyContact(STIFFNESS))
    slowly = followed(contact, rows, [{"rod": lying(depth)} for depth in DEPTH * np.arange(1, 9) / 8])
    shallow, deep = followed(contact, rows, [{"rod": lying(0.3 * DEPTH)}, {"rod": lying(DEPTH)}])
    assert 2.0 * shallow.solved.depth < 0.7 * DEPTH
    assert not shallow.solved.followed
    assert deep.solved.followed
    # Both are balanced to 1e-5 of the depth.
    assert deep.energy == pytest.approx(slowly[-1].energy, rel=1e-8)
    at_once = followed(contact, rows, [{"rod": lying(DEPTH)}])[0]
    assert at_once.energy < 0.9 * deep.energy  # the surface is through there


@pytest.mark.parametrize("lost", [0.5, 2.0])
def test_what_is_lost_from_afar_has_the_least_energy(jelly2d_body, rod, mechanics, monkeypatch, lost):
    """As if a contact that cannot be followed ended with another energy than that which is found anew."""
    rows = jelly2d_body.rest_rows
    contact = CondensedContact.of(jelly2d_body, mechanics, {"rod": rod}, PenaltyContact(STIFFNESS))
    points, shallow = contact.in_frame(rows), followed(contact, rows, [{"rod": lying(0.3 * DEPTH)}])[0]
    (anew,) = followed(contact, rows, [{"rod": lying(DEPTH)}])

    def in_halves(contact, *given, solved=anew.solved):
        solution = replace(solved.solution, energy=lost * solved.solution.energy)
        return replace(solved, solution=solution, followed=False)

    monkeypatch.setattr(CondensedContact, "_in_halves", in_halves)
    found = contact.evaluate(points, rows, {"rod": lying(DEPTH)}, shallow.warm_start)
    assert found.solved.solution.energy == pytest.approx(
        min(lost, 1.0) * anew.solved.solution.energy, rel=1e-12
    )


def test_a_prediction_far_off_is_not_followed(jelly2d_body, mechanics, monkeypatch):
    """Ten times as deep as the solution, whose forces would throw the surface through the rod."""
    rod, rows = Capsule([-0.012, 0.0], [0.012, 0.0], RADIUS, "rod"), jelly2d_body.rest_rows
    contact = CondensedContact.of(jelly2d_body, mechanics, {"rod": rod}, PenaltyContact(STIFFNESS, 4, 2))
    down, moved = dragged(rod, 0.001)
    points, before = contact.in_frame(rows), followed(contact, rows, down)[-1]
    expected = contact.evaluate(points, rows, moved, before.warm_start)

    def predict(*given, found=WarmStart.predict):
        penetration, normal = found(*given)
        return 10.0 * penetration, normal

    monkeypatch.setattr(WarmStart, "predict", predict)
    found = contact.evaluate(points, rows, moved, before.warm_start)
    # Both are balanced to 1e-5 of the depth.
    assert found.energy == pytest.approx(expected.energy, rel=1e-8)
    np.testing.assert_array_equal(found.solved.active, expected.solved.active)


def test_forces_that_are_held_turn_with_body_and_collider(jelly2d_body, rod, mechanics):
    contact = CondensedContact.of(jelly2d_body, mechanics, {"rod": rod}, PenaltyContact(STIFFNESS))
    rows, pose = jelly2d_body.rest_rows, lying(0.5 * RADIUS)
    start = followed(contact, rows, [{"rod": pose}])[-1].warm_start
    solved, turn = start.solved, rotation_matrix([0.7], 2)
    turned = contact.evaluate(
        contact.in_frame(rows @ turn.T),
        rows @ turn.T,
        {"rod": RigidPose(turn @ pose.rotation, turn @ pose.translation)},
        None,
    ).solved
    distance = PointDistance(("rod",), (PosedCollider(rod, turned.poses["rod"]),), solved.owner)
    problem = ContactProblem(
        contact.compliance.among(solved.index),
        turned.carriers,
        contact.stiffness[solved.index],
        turned.position,
        solved.depth,
        distance,
    )
    penetration, normal = start.held(solved.index, problem, turned.poses)
    b, solution = solved.solution.active, solved.solution
    # Round-off.
    np.testing.assert_allclose(penetration[b], solution.penetration[b], rtol=1e-12)
    np.testing.assert_allclose(normal[b], solution.normal[b] @ turn.T, atol=1e-12)
    assert (penetration[np.setdiff1d(np.arange(len(penetration)), b)] == -np.inf).all()
    # That is the solution, but for the rounding of single precision.
    assert problem.lowest((10.0 * penetration, normal), (penetration, normal))[0] is penetration


def test_beside_another_collider_it_is_not_let_go_either(jelly2d_body, rod, mechanics):
    """A collider that touches nothing changes nothing."""
    rows = jelly2d_body.rest_rows
    far = Sphere(0.01, 2, "far")
    alone = CondensedContact.of(jelly2d_body, mechanics, {"rod": rod}, PenaltyContact(STIFFNESS))
    beside = CondensedContact.of(jelly2d_body, mechanics, {"rod": rod, "far": far}, PenaltyContact(STIFFNESS))
    path = [{"rod": lying(depth), "far": FAR} for depth in RADIUS * np.arange(1, 33) / 8]
    expected, found = (followed(contact, rows, path) for contact in (alone, beside))
    energies = [evaluation.energy for evaluation in expected]
    assert min(energies) > 0.0
    assert [evaluation.energy for evaluation in found] == energies
    # What is drawn of it, too, knows of all nodes that bear pressure.
    solved = found[-1].solved
    measured = ContactMeasurement(beside, "rod", rod, BAND, 1e4).measure(solved)
    assert set(solved.active) <= set(measured.index)
    active = np.isin(measured.index, solved.active)
    np.testing.assert_array_equal(measured.force[active], solved.rest_force)


def test_what_comes_in_past_the_middle_stays_on_its_side(jelly2d_body, mechanics):
    """A tilted rod, thinner than the next step is long, comes to a node that did not bear pressure: the near way out is
    on the other side, but that is not where the node came from."""
    thin = Capsule([-0.03, 0.0], [0.03, 0.0], 0.002, "thin")
    rows = jelly2d_body.rest_rows
    contact = CondensedContact.of(jelly2d_body, mechanics, {"thin": thin}, PenaltyContact(STIFFNESS), BAND)

    def tilted(height):
        return {"thin": RigidPose.from_rotation_vector([0.25], [0.02, TOP + height])}

    path = [tilted(height) for height in (*np.arange(0.0090, 0.0064, -0.0005), 0.0041)]
    before, after = (evaluation.solved for evaluation in followed(contact, rows, path)[-2:])
    candidates = np.isin(after.index, before.index) & ~np.isin(after.index, before.active)
    came, pose = after.index[candidates], path[-1]["thin"]
    position = contact.in_frame(rows).positions(rows, came)
    assert came.size == 1
    assert thin.sdf(pose.apply_inverse(position)) < 0.0 < pose.apply_inverse(position)[0, 1]
    assert after.solution.normal[after.index == came][0, 1] < 0.0
    (at_once,) = followed(contact, rows, path[-1:])
    normal = at_once.solved.solution.normal
    assert normal[at_once.solved.index == came][0, 1] > 0.0


def test_what_is_drawn_out_at_once_lets_go(jelly2d_body, rod, mechanics):
    """A collider that has leapt away is another contact, and takes nothing along."""
    contact = CondensedContact.of(jelly2d_body, mechanics, {"rod": rod}, PenaltyContact(STIFFNESS), BAND)
    path = [{"rod": lying(depth)} for depth in (*RADIUS * np.arange(1, 33) / 8, -0.03)]
    *pressed, away = followed(contact, jelly2d_body.rest_rows, path)
    assert all(evaluation.active_points("rod").index.size for evaluation in pressed)
    assert away.solved is None


@pytest.mark.parametrize("names", [("rod",), ("rod", "far")], ids=["one collider", "several colliders"])
def test_a_trial_elsewhere_changes_nothing(jelly2d_body, rod, mechanics, names):
    """A line search solves from the state that was linearised, wherever its last trial was."""
    rows = jelly2d_body.rest_rows
    shapes = {"rod": rod, "far": Sphere(0.01, 2, "far")}
    contact = CondensedContact.of(
        jelly2d_body, mechanics, {name: shapes[name] for name in names}, PenaltyContact(STIFFNESS)
    )

    def poses(depth):
        return {"rod": lying(depth), "far": FAR}

    last = followed(contact, rows, [poses(depth) for depth in DEPTH * np.arange(1, 9) / 8])[-1]

    def energy(depth, start):
        return contact.evaluate(contact.in_frame(rows), rows, poses(depth), start).energy

    trial = energy(0.98 * DEPTH, last.warm_start)
    assert trial == pytest.approx(last.energy, rel=0.05)
    assert energy(-0.001, last.warm_start) == 0.0
    assert energy(0.98 * DEPTH, last.warm_start) == trial
    # The same from the plain data that a state carries.
    assert energy(0.98 * DEPTH, contact.resume(last.solved)) == trial
    # At once the rod is let through, at a tenth of the energy.
    assert energy(0.98 * DEPTH, None) < 0.2 * trial


def correction_of(body, rod, mechanics, refinement=2):
    """An untrained one: its field is that of mechanics."""
    options = ForceModelOptions((8,), "silu", 1e-3, BAND, STIFFNESS, refinement=refinement)
    model = ForceModel(options, 2, body.n_rows)
    return ForceCorrection("mechanics", model, body, rod, mechanics)


def test_a_motion_begins_anew(jelly2d_body, rod, mechanics):
    """With contact at nodes, the rod begins deep in the block, goes out and comes in again, in balance otherwise than
    it was at the start.
    Nothing of one motion is remembered in the next, for what a step starts from is in its state."""
    path = KeyframedPath([0.0, 0.3, 0.6], [lying(depth).translation for depth in (DEPTH, -0.002, DEPTH)])
    handles = jelly2d_body.handles
    held = [*(frame.name for frame in handles.frames), *range(handles.n_points)]
    simulator = Simulator(
        jelly2d_body,
        [PlacedCollider("rod", rod, path, correction=correction_of(jelly2d_body, rod, mechanics, 0))],
        contact=PenaltyContact(STIFFNESS, refinement=0),
        mechanics=mechanics,
        kinematic=[KinematicHandle(handle, None) for handle in held],
    )

    def motion():
        results = [simulator.settle()]
        while len(results) < 37:
            results.append(simulator.step(results[-1].state))
        return results

    def forces(results):
        return np.array([result.contacts["rod"].force for result in results])

    first = motion()
    assert forces(first)[0, 1] * forces(first)[-1, 1] < 0.0
    np.testing.assert_array_equal(forces(motion()), forces(first))
    again = simulator.step(first[-2].state)
    np.testing.assert_array_equal(forces([again]), forces(first[-1:]))


def test_a_static_correction_follows_an_approach_path(jelly2d_body, rod, mechanics):
    correction = StaticCorrection(correction_of(jelly2d_body, rod, mechanics), jelly2d_body)
    rows, rest = jelly2d_body.rest_rows, jelly2d_body.mesh.points
    at_once = correction.displacement(rows, lying(DEPTH))
    along = correction.displacement_along(rows, [lying(depth) for depth in DEPTH * np.arange(1, 9) / 8])
    under = np.abs(rest - [0.003, TOP]).max(axis=1) < 0.01
    top = under & (rest[:, 1] > TOP - 1e-9)
    assert along[top, 1].max() < -0.5 * DEPTH
    assert at_once[top, 1].max() > 0.0


def test_a_static_correction_goes_in_steps_to_a_state_that_is_far_away(
    jelly2d_body, rod, mechanics, monkeypatch
):
    """The body rises as the rod comes down, together by three times the depth of the contact before."""
    correction = StaticCorrection(correction_of(jelly2d_body, rod, mechanics), jelly2d_body)
    rows = jelly2d_body.rest_rows
    shallow, risen = correction.solve(rows, lying(0.2 * DEPTH), None), np.add(rows, [0.0, 0.29 * DEPTH])
    states = []

    def evaluate(contact, points, at, poses, *given, found=CondensedContact.evaluate):
        assert points.frame_rows is at
        states.append((at[0, 1] - rows[0, 1], TOP + RADIUS - poses["rod"].translation[1]))
        return found(contact, points, at, poses, *given)

    monkeypatch.setattr(CondensedContact, "evaluate", evaluate)
    correction.solve(rows, lying(0.55 * DEPTH), shallow)
    assert len(states) == 1  # near enough to predict from
    states.clear()
    deep = correction.solve(risen, lying(0.5 * DEPTH), shallow)
    # 0.59 DEPTH in steps of 0.1 DEPTH, half of the depth of the first contact.
    steps = np.arange(1, 7) / 6
    expected = np.column_stack([0.29 * DEPTH * steps, (0.2 + 0.3 * steps) * DEPTH])
    np.testing.assert_allclose(states, expected, atol=1e-12)
    slowly = correction.solve(rows, lying(0.2 * DEPTH), None)
    for t in np.arange(1, 31) / 30:
        slowly = correction.solve(
            np.add(rows, [0.0, 0.29 * DEPTH * t]), lying((0.2 + 0.3 * t) * DEPTH), slowly
        )
    # Both are balanced to 1e-5 of the depth.
    assert deep.solution.energy == pytest.approx(slowly.solution.energy, rel=1e-8)
