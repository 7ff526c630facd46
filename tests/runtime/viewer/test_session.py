"""The interactive session, driven by commands as the page drives it."""

from __future__ import annotations

import numpy as np
import pytest

from softprint.runtime.colliders.kinds.sphere import SphereSpec
from softprint.runtime.viewer.session import commands as ask
from softprint.runtime.viewer.session.painting import QUANTITIES, order_of
from softprint.runtime.viewer.session.session import Session

TOP = 0.06  # m, of the toy's block
RADIUS = 0.02  # m, of its ball and its disc


@pytest.fixture
def session(toy):
    session = Session(toy.workshop())
    yield session
    session.close()


def over(session, height: float):
    """A point over a node near the middle of the block, which in 3D has nodes 2 cm apart."""
    return np.append(np.full(session.body.dim - 1, 0.01 if session.body.dim == 3 else 0.0), height)


def press(session, depth: float, steps: int = 20):
    """Lead the collider so deep into the top, and step."""
    session.handle(ask.LeadCollider(session.tables[0].name, over(session, TOP + RADIUS - depth)))
    return [session.advance() for _ in range(steps)][-1]


def force(result) -> float:
    return float(sum(contact.force[-1] for contact in result.contacts.values()))


def sentences(session, kind: str = "bad") -> list[str]:
    return [event.text for event in session.events() if isinstance(event, ask.Notice) and event.kind == kind]


def test_pressing_deeper_pushes_back_harder(session):
    (light,) = press(session, 2e-3)
    (hard,) = press(session, 5e-3)
    assert 0.0 < force(light) < force(hard)
    assert light.converged
    assert hard.converged


def test_a_led_collider_arrives_at_its_target_and_no_faster_than_the_limit(session):
    name, h = session.tables[0].name, session.settings.time_step
    target = over(session, 0.5)  # a leap of half a metre
    session.handle(ask.LeadCollider(name, target))
    before = session.hands.colliders[name].pose.translation
    for _ in range(200):
        session.advance()
        now = session.hands.colliders[name].pose.translation
        # Round-off of the sum of a step.
        assert np.linalg.norm(now - before) <= session.hands.speed * h * (1 + 1e-9)
        before = now
    assert np.allclose(before, target, atol=1e-9)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_target_that_is_no_number_is_refused_and_changes_nothing(session, bad):
    name = session.tables[0].name
    before = session.hands.colliders[name].target
    session.handle(ask.LeadCollider(name, np.full(session.body.dim, bad)))
    session.handle(ask.LeadCollider(name, over(session, 0.1), np.full((session.body.dim,) * 2, bad)))
    session.handle(ask.LeadCollider("nothing", over(session, 0.1)))
    session.handle(ask.LeadCollider(name, np.zeros(5)))
    assert session.hands.colliders[name].target is before
    assert len(sentences(session)) == 4
    assert session.advance()


def test_a_wild_collider_is_survived(session):
    """Thrown through the body and about it, the session goes on, and after a reset the body is whole."""
    rng, name = np.random.default_rng(5), session.tables[0].name
    for _ in range(60):
        session.handle(ask.LeadCollider(name, rng.uniform(-0.08, 0.12, session.body.dim)))
        session.advance()
    session.handle(ask.Reset())
    (result,) = session.advance()
    assert np.isfinite(result.state.rows).all()
    assert np.abs(result.state.rows - session.players[0].model.rest_rows).max() < 1e-3  # m: it is at rest


def test_a_collider_that_pierces_the_body_is_reported(toy2d):
    """One that is led down to the rigid base: the block, 6 cm high, cannot give way by 5 cm."""
    session = Session(toy2d.workshop())
    session.handle(ask.SetShapes((SphereSpec(shape="circle", name="pea", radius=2e-3),)))
    session.fetch(wait=True)
    session.handle(ask.LeadCollider("pea", np.array([0.0, 0.01])))
    statuses = {session.advance()[0].status.name for _ in range(25)}
    assert "PIERCED" in statuses
    session.close()


def test_models_change_while_it_plays_and_the_body_keeps_its_shape(session):
    (bare,) = press(session, 4e-3)
    session.handle(ask.SetModels(("ours",)))
    assert session.setting().building == "ours"
    session.fetch(wait=True)
    assert session.setting().models == ("ours",)
    assert np.array_equal(session.players[0].state.rows, bare.state.rows)
    for _ in range(15):
        (ours,) = session.advance()
    # Where the surface gives way to contact by itself, the same press takes less force.
    assert 0.0 < force(ours) < force(bare)


def test_two_models_play_side_by_side_under_the_same_collider(session):
    session.handle(ask.SetModels(("bare", "ours")))
    session.fetch(wait=True)
    bare, ours = press(session, 4e-3)
    name = session.tables[0].name
    assert np.array_equal(bare.state.poses[name].translation, ours.state.poses[name].translation)
    assert force(ours) < force(bare)
    session.handle(ask.SetModels(("bare", "bare", "ours")))
    session.handle(ask.SetModels(("theirs",)))
    assert len(sentences(session)) == 2


def test_a_dropped_collider_falls_onto_the_body_which_bears_it(session):
    name = session.tables[0].name
    session.handle(ask.LeadCollider(name, over(session, TOP + RADIUS + 5e-3)))
    for _ in range(40):
        session.advance()
    session.handle(ask.DropCollider(name, 1000.0))
    session.fetch(wait=True)
    for _ in range(30):  # 0.6 s: at rest, and in the plane it rolls off later
        (result,) = session.advance()
    placed = session.players[0].simulator.colliders[0]
    weight = placed.free.mass.mass * 9.81
    # The body bears the weight; 5 %: it has not quite come to rest.
    assert force(result) == pytest.approx(weight, rel=0.05)
    # Taken hold of again, it goes where it is led.
    session.handle(ask.LeadCollider(name, over(session, 0.2)))
    session.fetch(wait=True)
    for _ in range(60):
        session.advance()
    assert session.hands.colliders[name].pose.translation[-1] == pytest.approx(0.2)


def test_a_collider_that_falls_off_comes_back(session):
    name = session.tables[0].name
    aside = over(session, 0.05) + 0.2 * np.eye(session.body.dim)[0]
    session.handle(ask.LeadCollider(name, aside))
    for _ in range(60):
        session.advance()
    session.handle(ask.DropCollider(name, 1000.0))
    session.fetch(wait=True)
    for _ in range(60):
        session.advance()
        session.fetch(wait=True)
    assert any("fell off" in text for text in sentences(session, "info"))
    assert session.hands.colliders[name].pose.translation[-1] > 0.0


def test_a_grabbed_point_follows_the_mouse_and_springs_back(session):
    top = over(session, TOP)
    session.handle(ask.GrabBody(top))
    node = session.hands.grab.node
    rest = session.body.basis[node] @ session.players[0].state.rows
    session.handle(ask.PullBody(rest + np.append(np.zeros(session.body.dim - 1), 0.02)))
    for _ in range(30):
        (pulled,) = session.advance()
    lifted = (session.body.basis[node] @ pulled.state.rows - rest)[-1]
    assert 2e-3 < lifted < 0.02  # m: it comes along, and the body holds it back
    assert pulled.energies["springs"] > 0.0
    session.handle(ask.LetGo())
    for _ in range(60):
        (result,) = session.advance()
    assert result.energies["springs"] == 0.0
    back = (session.body.basis[node] @ result.state.rows - rest)[-1]
    assert abs(back) < 0.2 * lifted  # it still swings a little


def test_a_frame_is_led_and_given_back(session):
    along = np.eye(session.body.dim)[0]
    session.handle(ask.LeadHandle("base", 0.01 * along))
    for _ in range(20):
        (result,) = session.advance()
    handles, rest = session.body.handles, session.body.rest_rows
    moved = handles.position(result.state.rows, "base") - handles.position(rest, "base")
    assert np.allclose(moved, 0.01 * along, atol=1e-6)
    session.handle(ask.LeadHandle("base", None))
    (result,) = session.advance()
    assert np.allclose(handles.position(result.state.rows, "base"), handles.position(rest, "base"))
    session.handle(ask.LeadHandle("none such", along))
    assert len(sentences(session)) == 1


def test_a_free_point_becomes_kinematic_where_it_is(session):
    """Taking hold of a handle does not make it jump."""
    press(session, 5e-3)
    before = session.players[0].state.rows[0]
    displacement = before - session.body.rest_rows[0]
    session.handle(ask.LeadHandle(0, displacement))
    (result,) = session.advance()
    assert np.allclose(result.state.rows[0], before, atol=1e-12)


def test_other_shapes_and_more_of_them(session):
    shape = "sphere" if session.body.dim == 3 else "circle"
    ball = SphereSpec(shape=shape, name="marble", radius=0.01)
    session.handle(ask.SetShapes((*session.tables, ball)))
    session.fetch(wait=True)
    assert [table.name for table in session.tables] == [session.workshop.tables[0].name, "marble"]
    session.handle(ask.LeadCollider("marble", over(session, TOP + 0.01 - 3e-3)))
    for _ in range(25):
        (result,) = session.advance()
    assert result.contacts["marble"].force[-1] > 0.0
    # The same name twice, and none at all.
    session.handle(ask.SetShapes((ball, ball)))
    session.handle(ask.SetShapes(()))
    assert len(sentences(session)) == 2
    assert len(session.tables) == 2


def test_a_shape_that_cannot_be_made_leaves_the_scene_as_it_was(session):
    other = SphereSpec(shape="circle" if session.body.dim == 3 else "sphere", name="flat", radius=0.01)
    session.handle(ask.SetShapes((other,)))
    session.fetch(wait=True)
    assert len(sentences(session)) == 1
    assert session.setting().tables == session.workshop.tables
    assert session.advance()


def test_pause_step_and_newton_limits(session):
    session.handle(ask.SetPace(paused=True))
    assert not session.running
    session.handle(ask.StepOnce())
    assert session.running
    session.advance()
    assert not session.running
    session.handle(ask.SetPace(iterations=1))
    assert session.players[0].simulator.settings.newton.max_iterations == 1
    for pace in (ask.SetPace(speed=0.0), ask.SetPace(speed=np.nan), ask.SetPace(iterations=0)):
        session.handle(pace)
    assert len(sentences(session)) == 3
    assert session.running


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_every_quantity_is_painted(toy3d, quantity):
    session = Session(toy3d.workshop(), ("ours",))
    (result,) = press(session, 4e-3)
    painter = session.players[0].model.painter
    vertices, values = painter.paint(order_of(result, quantity))
    assert vertices.shape == (len(session.body.mesh.surface_nodes), 3)
    assert len(values) == len(vertices)
    if quantity == "contact pressure":
        # Its integral over the surface is the force; 10 %: the forces are not parallel.
        areas = session.body.mesh.surface_areas
        assert 1e3 * float(values @ areas) == pytest.approx(force(result), rel=0.1)
    if quantity == "confidence":
        assert np.nanmin(values) == np.nanmax(values) == 1.0  # an untrained one has no range of training
    if quantity == "nothing":
        assert np.isnan(values).all()
    session.close()
