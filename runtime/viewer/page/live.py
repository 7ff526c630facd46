"""The page of an interactive session: it takes the newest pictures, and hands on what the user does.

The loop runs in the main thread of the window's process. Nothing of it is waited for by the simulation, which runs in
a process of its own (`processes/simulation_process.py`).
"""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.colliders import RigidPose
from softprint.runtime.colliders.kinds.table import ColliderTable
from softprint.runtime.errors import SoftprintError
from softprint.runtime.viewer.page.body_view import BodyView
from softprint.runtime.viewer.page.collider_views import ColliderViews, Shown
from softprint.runtime.viewer.page.force_plot import ForcePlot
from softprint.runtime.viewer.page.handle_gizmo import HandleGizmo
from softprint.runtime.viewer.page.palette import Scale
from softprint.runtime.viewer.page.panel import Panel, handle_names
from softprint.runtime.viewer.page.readout import legend_html, notice_html, status_html
from softprint.runtime.viewer.page.server import stop_server
from softprint.runtime.viewer.page.stage import beside, make_room, open_stage
from softprint.runtime.viewer.processes.frame_board import Picture
from softprint.runtime.viewer.processes.frame_info import FrameInfo
from softprint.runtime.viewer.processes.simulation_process import SimulationProcess
from softprint.runtime.viewer.session import commands as ask
from softprint.runtime.viewer.session.painting import QUANTITIES, drawn_faces, drawn_nodes, in_space
from softprint.runtime.viewer.session.workshop import Workshop

log = logging.getLogger(__name__)

# Pictures are looked for so often [s]; what is written beside them changes less often.
_TICK, _TEXT, _PLOT = 1.0 / 120.0, 0.12, 0.25


class LivePage:
    """A page at 127.0.0.1 for a session that has been started. say: to the user on the terminal."""

    def __init__(
        self, workshop: Workshop, simulation: SimulationProcess, port: int, say: Callable[[str], None]
    ) -> None:
        self._workshop, self._simulation, self._say = workshop, simulation, say
        body = workshop.body
        mesh = body.mesh
        lower, upper = mesh.points.min(axis=0), mesh.points.max(axis=0)
        self.server = open_stage(port, f"Softprint · {workshop.experiment.name}", lower, upper, body.dim, 1)
        self._rest = in_space(mesh.points[drawn_nodes(mesh)])
        self._faces = drawn_faces(mesh)
        step = beside(lower, upper)
        self._offsets = [np.zeros(3), step]
        self._room = 1  # bodies that the view has room for
        self._views: list[BodyView] = []
        self._colliders = ColliderViews(self.server, body.dim, mesh.size, self._offsets, self._lead)
        self._handle = HandleGizmo(self.server, body, simulation.send)
        self._seen = [0] * len(simulation.boards)
        self._pictures: list[Picture | None] = [None] * len(simulation.boards)
        self._setting: ask.Setting | None = None
        self._scale, self._scaled = Scale(), time.monotonic()
        self._drawn: deque[float] = deque(maxlen=120)
        self._texts = self._plots = 0.0
        self._top, self._time = 1.0, 0.0
        self._from: float | None = None
        self.ended = False
        self._build_panel()
        simulation.send(ask.Tell())

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://127.0.0.1:{self.server.get_port()}"

    def run(self, until: Callable[[], bool] = lambda: False) -> None:
        """Show pictures until the session has ended, or `until`. Raises SoftprintError if the session ended by
        itself."""
        while not until():
            began = time.monotonic()
            self.tick()
            if self.ended:
                time.sleep(0.3)  # until its last words have come through
                self._hear()
                raise SoftprintError("the simulation has ended by itself; what it said last is above")
            time.sleep(max(0.001, _TICK - (time.monotonic() - began)))

    def tick(self) -> None:
        """Show what is new."""
        self._hear()
        self._show_pictures()
        now = time.monotonic()
        if now > self._texts + _TEXT:
            self._texts = now
            self._write()
        if now > self._plots + _PLOT:
            self._plots = now
            self._plot.show()
        self.ended = not self._simulation.alive

    def _hear(self) -> None:
        for event in self._simulation.events():
            if isinstance(event, ask.Notice):
                self._notice(event.text, event.kind)
            else:
                self._set(event)

    def lead(self, name: str, pose: RigidPose) -> None:
        """As if a user had led a collider there."""
        self._lead(name, pose.translation, pose.rotation)
        self._colliders.wish(name, pose)

    def choose_colours(self, quantity: str) -> None:
        """As if a user had chosen them in the panel."""
        self._panel.quantity.value = quantity
        self._simulation.send(ask.SetColour(quantity))

    def close(self) -> None:
        """End the server of the page."""
        stop_server(self.server)

    def _build_panel(self) -> None:
        gui, body = self.server.gui, self._workshop.body
        self._status = gui.add_html(status_html([], False, "", None, 0.0, []))
        self._notices = gui.add_html("")
        self._legend = gui.add_html("")
        self._plot = ForcePlot(self.server)
        frames = [frame.name for frame in body.handles.frames]
        self._panel = Panel(
            self.server,
            self._workshop.experiment,
            self._workshop.names,
            handle_names(frames, body.handles.n_points),
            self._workshop.out / "recordings" / "uploads",
            self._simulation.send,
            self._notice,
            self._colliders.hold,
            self._lead_handle,
        )
        if len(self._workshop.names) == 1:
            self._notice(
                "No model has been trained in this run directory yet: the body is bare. `softprint generate` and "
                "`softprint train` make models.",
                "info",
            )

    def _notice(self, text: str, kind: str) -> None:
        self._notices.content = notice_html(text, kind)
        self._say(text)

    def _lead(self, name: str, position: Array, rotation: Array | None) -> None:
        self._simulation.send(ask.LeadCollider(name, position, rotation))

    def _lead_handle(self, handle: int | str | None) -> None:
        """Put the gizmo of handles where a handle of the first body is."""
        picture = self._pictures[0]
        rest = self._workshop.body.rest_rows
        self._handle.lead(handle, rest if picture is None else picture.meta["info"].rows)

    def _set(self, setting: ask.Setting) -> None:
        """Have as many bodies as models, and the colliders of the scene."""
        count = len(setting.models)
        if count != self._room:
            make_room(self.server, self._offsets[1], count - self._room)
            self._room = count
        while len(self._views) > count:
            self._views.pop().remove()
        mesh = self._workshop.body.mesh
        for number in range(len(self._views), count):
            view = BodyView(
                self.server,
                f"body_{number}",
                self._rest,
                self._faces,
                self._offsets[number],
                mesh.size,
                mesh.dim == 2,
            )
            self._pull_with_the_mouse(view)
            self._views.append(view)
        if (
            self._setting is None
            or self._setting.tables != setting.tables
            or len(self._setting.models) != count
        ):
            self._colliders.have([self._shown(table) for table in setting.tables], count)
        self._setting = setting
        self._panel.show(setting)

    def _shown(self, table: ColliderTable) -> Shown:
        return Shown(table.name, table.model_dump_json(), self._workshop.collider(table))

    def _pull_with_the_mouse(self, view: BodyView) -> None:
        """A drag on the body pulls the point where it began."""
        dim, send = self._workshop.body.dim, self._simulation.send

        @view.mesh.on_drag
        async def _(event: Any) -> None:
            end = (np.asarray(event.end_position, dtype=float) - view.offset)[:dim]
            if event.phase == "start":
                start = np.asarray(event.start_position, dtype=float)
                send(ask.GrabBody((start - view.offset)[:dim]))
                send(ask.PullBody(end))
            elif event.phase == "end":
                send(ask.LetGo())
            else:
                send(ask.PullBody(end))

    def _show_pictures(self) -> None:
        count = 0 if self._setting is None else min(len(self._setting.models), len(self._views))
        quantity = self._panel.quantity.value
        new = False
        for number in range(count):
            picture = self._simulation.boards[number].newest(self._seen[number])
            if picture is not None:
                self._pictures[number], self._seen[number], new = picture, picture.number, True
        shown = [picture for picture in self._pictures[:count] if picture is not None]
        if not new or not shown:
            return
        if shown[0].meta["info"].time < self._time:  # after a reset
            self._colliders.renew()
        self._time = shown[0].meta["info"].time
        now = time.monotonic()
        values = np.concatenate([picture.values for picture in shown])
        top = self._scale.fit(quantity, values, now - self._scaled)
        self._scaled = now
        self._drawn.append(now)
        with self.server.atomic():
            for number, picture in enumerate(shown):
                info: FrameInfo = picture.meta["info"]
                view = self._views[number]
                view.show(picture.vertices, picture.values, top)
                view.show_contact(in_space(info.points), info.sizes, bool(self._panel.points.value))
                pull = info.pull
                view.show_pull(None if pull is None else (_space(pull[0]), _space(pull[1])))
                self._colliders.place(number, info.poses)
            assert self._setting is not None
            self._colliders.follow(self._colliders.held in self._setting.free)
        self.server.flush()
        forces = [_total(picture.meta["info"]) for picture in shown]
        self._plot.add(shown[0].meta["info"].time, forces)
        self._top = top

    def _write(self) -> None:
        setting = self._setting
        if setting is None:
            return
        pictures = [picture for picture in self._pictures[: len(setting.models)] if picture is not None]
        infos = [picture.meta["info"] for picture in pictures]
        recording = setting.recording
        if recording is not None and infos:
            recording = max(0.0, infos[0].time - self._recorded_from(infos[0].time))
        else:
            self._from = None
        span = self._drawn[-1] - self._drawn[0] if len(self._drawn) > 1 else 0.0
        fresh = bool(self._drawn) and time.monotonic() - self._drawn[-1] < 1.0
        rate = (len(self._drawn) - 1) / span if span > 0 and fresh else 0.0
        self._status.content = status_html(
            infos,
            self._panel.paused,
            setting.building,
            recording,
            rate,
            [picture.meta["confidence"] for picture in pictures],
        )
        self._panel.held_is(self._colliders.held)
        quantity = self._panel.quantity.value
        self._legend.content = legend_html(
            quantity, self._top, QUANTITIES.get(quantity, ""), self._scale.above
        )

    def _recorded_from(self, now: float) -> float:
        if self._from is None:
            self._from = now
        return self._from


def _space(point: Array) -> Array:
    return np.pad(point, (0, 3 - len(point)))


def _total(info: FrameInfo) -> float:
    return sum(float(np.linalg.norm(force)) for force in info.forces.values())
