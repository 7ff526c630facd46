"""The page of a session without a browser: what its controls do to the session, and what it shows."""

from __future__ import annotations

import time
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from softprint.runtime.colliders import RigidPose
from softprint.runtime.viewer.page.live import LivePage
from softprint.runtime.viewer.processes.simulation_process import SimulationProcess

PATIENCE = 60.0  # s for anything, on a machine that is busy


class Shown:
    """A page, and what it has said on the terminal."""

    def __init__(self, run):
        self.said: list[str] = []
        self.simulation = SimulationProcess(run.workshop())
        self.page = LivePage(run.workshop(), self.simulation, 0, self.said.append)
        self.panel = self.page._panel

    def until(self, what):
        end = time.monotonic() + PATIENCE
        while not (found := what()):
            assert time.monotonic() < end, "it did not come"
            self.page.tick()
            time.sleep(0.01)
        return found

    @property
    def names(self) -> list[str]:
        setting = self.page._setting
        return [] if setting is None or setting.building else [table.name for table in setting.tables]

    @property
    def status(self) -> str:
        return self.page._status.content


@pytest.fixture
def shown(toy):
    shown = Shown(toy)
    shown.until(lambda: shown.names and shown.page._pictures[0] is not None)
    yield shown
    shown.page.close()
    shown.simulation.close()


def test_shapes_are_replaced_added_and_removed(shown, toy):
    panel, flat = shown.panel, toy.collider == "disc"
    panel.shape.value = "circle" if flat else "sphere"
    panel._swapped("replace")
    shown.until(lambda: shown.names == [panel.shape.value])
    panel.shape.value = "capsule"
    panel._swapped("add")
    shown.until(lambda: len(shown.names) == 2)
    panel._swapped("add")
    shown.until(lambda: shown.names[-1:] == ["capsule_2"])
    assert set(shown.page._colliders._nodes) == set(shown.names)
    panel.held.value = "capsule"
    shown.page._colliders.hold("capsule")
    panel._swapped("remove")
    shown.until(lambda: shown.names and "capsule" not in shown.names)
    assert shown.page._colliders.held in shown.names


def test_a_second_model_stands_beside_the_first(shown):
    shown.panel.beside.value = "ours"
    shown.panel._set_models()
    shown.until(lambda: len(shown.page._views) == 2 and "ours" in shown.status)
    assert shown.page._views[1].offset[0] > 0.0
    shown.panel.beside.value = "nothing"
    shown.panel._set_models()
    shown.until(lambda: len(shown.page._views) == 1)
    assert all(len(nodes) == 1 for nodes in shown.page._colliders._nodes.values())


def test_it_falls_is_held_and_handles_are_led(shown, toy):
    panel = shown.panel
    panel._fall()
    shown.until(lambda: toy.collider in shown.page._setting.free)
    shown.until(lambda: panel.fall.label == "hold it")
    panel._fall()
    shown.until(lambda: not shown.page._setting.free)
    panel.handle.value = "base"
    panel._lead_handle()
    assert shown.page._handle._node is not None
    panel._give_back()
    assert shown.page._handle._node is None


def test_pause_and_step(shown):
    panel = shown.panel
    panel._pause(True)
    shown.until(lambda: "paused" in shown.status)
    time.sleep(0.3)
    shown.page.tick()
    before = shown.page._pictures[0].meta["info"].time
    from softprint.runtime.viewer.session.commands import StepOnce

    shown.simulation.send(StepOnce())
    shown.until(lambda: shown.page._pictures[0].meta["info"].time > before)
    panel._pause(False)
    shown.until(lambda: "paused" not in shown.status)


def test_uploads_become_colliders_and_bad_ones_are_told(toy3d):
    shown = Shown(toy3d)
    try:
        shown.until(lambda: shown.names)
        mesh = trimesh.creation.box(extents=[3.0, 1.0, 1.0]).export(file_type="stl")
        shown.panel._tried(lambda: shown.panel._upload(SimpleNamespace(name="a bar.stl", content=mesh)))
        shown.until(lambda: shown.names == ["a_bar"])
        shown.panel._tried(lambda: shown.panel._upload(SimpleNamespace(name="x.stl", content=b"none")))
        assert "x.stl" in shown.said[-1]
        shown.until(lambda: shown.names == ["a_bar"])
    finally:
        shown.page.close()
        shown.simulation.close()


def test_a_step_that_pierces_is_red(toy2d):
    from softprint.runtime.colliders.kinds.sphere import SphereSpec
    from softprint.runtime.viewer.session.commands import SetShapes

    shown = Shown(toy2d)
    try:
        shown.simulation.send(SetShapes((SphereSpec(shape="circle", name="pea", radius=2e-3),)))
        shown.until(lambda: shown.names == ["pea"])
        shown.page.lead("pea", RigidPose(np.eye(2), np.array([0.0, 0.01])))
        shown.until(lambda: "pierced" in shown.status and "deep inside the body" in shown.status)
    finally:
        shown.page.close()
        shown.simulation.close()


def test_a_page_that_comes_later_shows_the_session_too(shown):
    shown.page.close()
    shown.page = LivePage(shown.page._workshop, shown.simulation, 0, shown.said.append)
    shown.panel = shown.page._panel
    shown.until(lambda: shown.page._views and shown.page._pictures[0] is not None)
    assert shown.names


def test_a_simulation_that_ends_by_itself_ends_the_page(toy2d):
    from softprint.runtime.errors import SoftprintError

    shown = Shown(toy2d)
    try:
        shown.until(lambda: shown.names)
        shown.simulation._process.kill()
        with pytest.raises(SoftprintError, match="ended by itself"):
            shown.page.run()
    finally:
        shown.page.close()
        shown.simulation.close()
