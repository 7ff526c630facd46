"""A body that nothing presses: the window plays it by its handles, also with an internal correction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from softprint.runtime.body import load_body
from softprint.runtime.experiment import load_experiment
from softprint.runtime.learned.internal.file import save_internal
from softprint.runtime.viewer.session import commands as ask
from softprint.runtime.viewer.session.session import Session
from softprint.runtime.viewer.session.workshop import Workshop
from tests.runtime.learned.test_internal_correction import made_model
from tests.runtime.viewer.test_page import Shown


@dataclass(frozen=True)
class Alone:
    """The toy's block with two internal corrections of random weights, and no collider in its scene."""

    experiment: object
    body: object
    out: object

    def workshop(self) -> Workshop:
        scene = self.experiment.scenes[0].model_copy(update={"colliders": ()})
        return Workshop(self.experiment, self.body, scene, self.out)


@pytest.fixture
def alone(toy, tmp_path) -> Alone:
    body = load_body(toy.out / "body.h5")
    (tmp_path / "internal").mkdir()
    for name, on_condensation in (("ours", True), ("thesis4", False)):
        model = made_model(body, on_condensation, 1e-4)
        save_internal(tmp_path / "internal" / f"{name}.safetensors", model, body, "", 0.5)
    return Alone(load_experiment(toy.experiment), body, tmp_path)


@pytest.mark.parametrize("model", ["bare", "condensed", "ours", "thesis4"])
def test_a_handle_is_led_and_the_body_follows(alone, model):
    session = Session(alone.workshop(), (model,))
    try:
        session.fetch(wait=True)
        assert session.players[0].model.name == model
        for _ in range(3):
            (before,) = session.advance()
        session.handle(ask.LeadHandle(0, np.full(alone.body.dim, 2e-3)))
        for _ in range(40):
            (after,) = session.advance()
        assert after.converged
        moved = after.state.rows[0] - before.state.rows[0]
        assert np.linalg.norm(moved) > 1e-3
    finally:
        session.close()


def test_every_model_of_the_run_directory_is_offered(alone):
    assert alone.workshop().names == ["bare", "condensed", "ours", "thesis4"]


def test_the_page_shows_a_scene_without_colliders_and_takes_one(alone):
    shown = Shown(alone)
    try:
        shown.until(lambda: shown.page._setting is not None and shown.page._pictures[0] is not None)
        assert shown.names == []
        assert shown.panel.held.value == "-"
        shown.panel._fall()  # there is nothing to let go of
        shown.panel.shape.value = "circle" if alone.body.dim == 2 else "sphere"
        shown.panel._swapped("replace")
        shown.until(lambda: shown.names == [shown.panel.shape.value])
        assert shown.panel.held.value == shown.panel.shape.value
    finally:
        shown.page.close()
        shown.simulation.close()
