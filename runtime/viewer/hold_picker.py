"""`softprint new --hold pick`: a window in which one chooses the part of a body that a rigid frame holds.

A click on the body puts a box there; sliders move its sides. The nodes inside are marked, and what could not be a frame
is said and cannot be chosen.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from html import escape
from typing import Any

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.placement import frame_in_box, in_box
from softprint.runtime.drawing.colours import BODY, rgb
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import Mesh
from softprint.runtime.viewer.live import interrupted
from softprint.runtime.viewer.page.browser import announce
from softprint.runtime.viewer.page.readout import BAD, GOOD
from softprint.runtime.viewer.page.server import stop_server
from softprint.runtime.viewer.page.stage import open_stage
from softprint.runtime.viewer.session.painting import drawn_faces, drawn_nodes, in_space

# Half the side of the box that a click places, and its room around the body, in sizes of the body.
_AROUND, _ROOM = 0.15, 0.05
_ORANGE = (214, 92, 58)


def pick_hold(mesh: Mesh, first: Array, port: int, open_browser: bool, say: Callable[[str], None]) -> Array:
    """The box (2, dim) [m] that is chosen in the window, which begins with `first`. Raises SoftprintError where the
    window is ended without a choice."""
    with interrupted() as stop:
        page = HoldPage(mesh, first, port)
        try:
            announce(page.address, open_browser, say)
            while not page.chosen.wait(0.1):
                if stop():
                    raise SoftprintError("--hold pick: the window was ended before a box was chosen")
        finally:
            page.close()
    return page.box


class HoldPage:
    """A page at 127.0.0.1 with a body, a box, and a button that chooses it."""

    def __init__(self, mesh: Mesh, first: Array, port: int) -> None:
        self._mesh, self.chosen = mesh, threading.Event()
        lower, upper = mesh.points.min(axis=0), mesh.points.max(axis=0)
        room = _ROOM * mesh.size
        self._bounds: Array = np.array([lower - room, upper + room])
        self._server = open_stage(port, "Softprint · what holds the body", lower, upper, mesh.dim, 1)
        self._shown = in_space(mesh.points[drawn_nodes(mesh)])
        body = self._server.scene.add_mesh_simple(
            "/body",
            self._shown,
            drawn_faces(mesh),
            color=rgb(BODY),
            side="double" if mesh.dim == 2 else "front",
        )
        body.on_click(self._click)
        gui = self._server.gui
        gui.add_markdown(
            "Click on the body, or move the sides of the box. The nodes inside are held rigidly."
        )
        ends = [[float(f"{1e3 * end:.4g}") for end in axis] for axis in self._bounds.T]
        step = float(f"{10.0 * mesh.size:.1g}")
        self._sides = [
            gui.add_multi_slider(f"{axis} [mm]", *ends[k], step, (0.0, 0.0))
            for k, axis in enumerate("xyz"[: mesh.dim])
        ]
        self._said = gui.add_html("")
        self._hold = gui.add_button("hold this")
        self._hold.on_click(lambda _: self._choose())
        for side in self._sides:
            side.on_update(lambda _: self._show())
        self.place(first)

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://127.0.0.1:{self._server.get_port()}"

    @property
    def box(self) -> Array:
        """(2, dim) [m]."""
        return 1e-3 * np.array([side.value for side in self._sides]).T

    def place(self, box: Array) -> None:
        """Put the box (2, dim) [m] there, as far as the sliders reach."""
        inside = 1e3 * np.clip(box, *self._bounds)
        for side, ends in zip(self._sides, inside.T, strict=True):
            side.value = tuple(ends.tolist())
        self._show()

    def close(self) -> None:
        """End the page."""
        stop_server(self._server)

    def refusal(self) -> str:
        """Why what is in the box cannot be a frame; empty if it can."""
        try:
            frame_in_box(self._mesh, "base", self.box)
        except SoftprintError as error:
            return str(error)
        return ""

    def _choose(self) -> None:
        if not self.refusal():
            self.chosen.set()

    def _click(self, event: Any) -> None:
        """The node nearest to the ray among those that face it: the first that it passes by."""
        start, along = np.asarray(event.ray_origin), np.asarray(event.ray_direction)
        way = (self._shown - start) @ along
        beside = np.linalg.norm(self._shown - start - way[:, None] * along, axis=1)
        near = beside <= beside.min() + 0.02 * self._mesh.size
        node = self._shown[near][np.argmin(way[near])][: self._mesh.dim]
        half = _AROUND * self._mesh.size
        self.place(np.array([node - half, node + half]))

    def _show(self) -> None:
        dim, box = self._mesh.dim, self.box
        centre, extent = np.zeros(3), np.full(3, 1e-3 * self._mesh.size)
        centre[:dim], extent[:dim] = box.mean(axis=0), np.maximum(box[1] - box[0], 1e-3 * self._mesh.size)
        self._server.scene.add_box(
            "/box",
            color=_ORANGE,
            dimensions=tuple(extent),
            position=tuple(centre),
            opacity=0.25,
            cast_shadow=False,
        )
        inside = in_box(self._mesh.points, box)
        held = in_space(self._mesh.points[inside])
        self._server.scene.add_point_cloud(
            "/held",
            held.astype(np.float32),
            _ORANGE,
            point_size=0.012 * self._mesh.size,
            precision="float32",
            visible=len(held) > 0,
        )
        refusal = self.refusal()
        colour, text = (
            (BAD, refusal) if refusal else (GOOD, f"{len(held)} of {self._mesh.n_nodes} nodes are held")
        )
        self._said.content = f'<div style="margin:0.5em;color:{colour}">{escape(text)}</div>'
        self._hold.disabled = bool(refusal)
