"""The window in which one chooses what holds a body."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import numpy as np
import pytest

from softprint.runtime.body.placement import in_box
from softprint.runtime.errors import SoftprintError
from softprint.runtime.viewer import hold_picker
from softprint.runtime.viewer.hold_picker import HoldPage, pick_hold


@pytest.fixture
def page(jelly_body):
    mesh = jelly_body.mesh
    own = HoldPage(mesh, np.array([mesh.points.min(axis=0), mesh.points.max(axis=0)]), 0)
    yield own
    own.close()


def test_a_box_that_cannot_be_a_frame_cannot_be_chosen(page, jelly_body):
    points, dim = jelly_body.mesh.points, jelly_body.dim
    assert "every node" in page.refusal()  # it began with all of the body
    page._choose()
    assert not page.chosen.is_set()
    far = points.max(axis=0)
    page.place(np.array([far, far]))  # a corner: one node
    assert page.refusal()
    bottom = np.array([[-1.0] * dim, [1.0] * (dim - 1) + [0.02]])
    page.place(bottom)
    assert page.refusal() == ""
    assert np.array_equal(in_box(points, page.box), in_box(points, bottom))
    page._choose()
    assert page.chosen.is_set()


def test_a_click_puts_the_box_where_the_ray_meets_the_body_first(page, jelly_body):
    """From above, through a node of the top; the bottom has a node on the same ray."""
    points, dim = jelly_body.mesh.points, jelly_body.dim
    down = np.zeros(3)
    down[dim - 1] = -1.0
    top = points[np.argmax(points[:, -1])]
    start = np.zeros(3)
    start[:dim] = top
    page._click(SimpleNamespace(ray_origin=tuple(start - down), ray_direction=tuple(down)))
    assert in_box(top[None], page.box).all()
    assert page.box[0, -1] > 0.0  # not about the bottom, at height 0
    # As wide as was asked for, within the room around the body.
    assert np.all(page.box[1] - page.box[0] <= 0.3 * jelly_body.mesh.size + 1e-9)


def test_the_choice_is_the_box(jelly_body, monkeypatch):
    mesh, dim = jelly_body.mesh, jelly_body.dim
    bottom = np.array([[-0.05] * dim, [0.05] * (dim - 1) + [0.02]])
    said = []

    class Chosen(HoldPage):
        def __init__(self, *given):
            super().__init__(*given)
            threading.Timer(0.2, self._choose).start()

    monkeypatch.setattr(hold_picker, "HoldPage", Chosen)
    box = pick_hold(mesh, bottom, 0, False, said.append)
    assert np.array_equal(in_box(mesh.points, box), in_box(mesh.points, bottom))
    assert "127.0.0.1" in said[0]


def test_ended_without_a_choice(jelly_body, monkeypatch):
    class Ended:
        def __enter__(self):
            return lambda: True

        def __exit__(self, *exception):
            return None

    monkeypatch.setattr(hold_picker, "interrupted", Ended)
    mesh = jelly_body.mesh
    with pytest.raises(SoftprintError, match="ended before a box was chosen"):
        pick_hold(mesh, np.array([mesh.points.min(axis=0), mesh.points.mean(axis=0)]), 0, False, str)
