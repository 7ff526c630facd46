"""`softprint view FILE ...`: motions beside each other, or the samples of a truth file, with a slider."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from softprint.runtime.errors import SoftprintError
from softprint.runtime.inspect.kind import find_kind
from softprint.runtime.viewer.page.body_view import BodyView
from softprint.runtime.viewer.page.browser import announce
from softprint.runtime.viewer.page.collider_views import ColliderViews, Shown
from softprint.runtime.viewer.page.force_plot import force_lines, force_scales, swatch
from softprint.runtime.viewer.page.palette import Scale
from softprint.runtime.viewer.page.readout import BAD, GOOD, legend_html
from softprint.runtime.viewer.page.server import check_port, stop_server
from softprint.runtime.viewer.page.stage import beside, open_stage
from softprint.runtime.viewer.playback.motion_reel import MotionReel
from softprint.runtime.viewer.playback.reel import DIFFERENCE, UNITS, Reel, Still
from softprint.runtime.viewer.playback.truth_reel import TruthReel
from softprint.runtime.viewer.session.painting import drawn_faces, drawn_nodes, in_space

if TYPE_CHECKING:
    from softprint.runtime.cli.context import Context

MOST = 6  # motions beside each other
_TICK = 1.0 / 120.0
_SAMPLES = 3.0  # samples of a truth file a second


def play_files(
    paths: Sequence[Path], colliders: Path | None, port: int, open_browser: bool, context: Context
) -> None:
    """Serve the page until Ctrl-C. Raises SoftprintError for files that cannot be played, or not together."""
    from softprint.runtime.viewer.live import interrupted

    check_port(port)
    with context.stage("reading"):
        reels = read_reels(paths, colliders)
    with interrupted() as stop:
        page = PlaybackPage(reels, port)
        try:
            announce(page.address, open_browser, context.say)
            page.run(stop)
        finally:
            page.close()


def read_reels(paths: Sequence[Path], colliders: Path | None = None) -> list[Reel]:
    """The files as reels. colliders: an experiment that defines those of a truth file."""
    if len(paths) > MOST:
        raise SoftprintError(f"at most {MOST} motions play beside each other, not {len(paths)}")
    reels: list[Reel] = []
    for path in paths:
        kind = find_kind(path)
        if kind.part == "frame":
            reels.append(MotionReel(path))
        elif kind.part == "sample":
            reels.append(TruthReel(path, colliders))
        else:
            raise SoftprintError(
                f"{path}: the window plays motion files and truth files, and presses the bodies of experiment files "
                "(.toml)"
            )
    dims = {reel.rest.dim for reel in reels}
    timed = {reel.times is not None for reel in reels}
    if len(dims) > 1 or len(timed) > 1 or (len(reels) > 1 and not timed.pop()):
        raise SoftprintError(
            "only motions of one dimension play beside each other; a truth file has its own window"
        )
    return reels


class PlaybackPage:
    """A page at 127.0.0.1 that plays reels."""

    def __init__(self, reels: Sequence[Reel], port: int) -> None:
        self.reels = list(reels)
        first = self.reels[0].rest
        lower = np.min([reel.rest.points.min(axis=0) for reel in reels], axis=0)
        upper = np.max([reel.rest.points.max(axis=0) for reel in reels], axis=0)
        title = f"Softprint · {self.reels[0].name}" if len(reels) == 1 else "Softprint · motions"
        self.server = open_stage(port, title, lower, upper, first.dim, len(reels))
        step = beside(lower, upper)
        self._views: list[BodyView] = []
        self._colliders: list[ColliderViews] = []
        for number, reel in enumerate(self.reels):
            mesh = reel.rest
            rest, offset = in_space(mesh.points[drawn_nodes(mesh)]), number * step
            self._views.append(
                BodyView(
                    self.server,
                    f"body_{number}",
                    rest,
                    drawn_faces(mesh),
                    offset,
                    mesh.size,
                    mesh.dim == 2,
                )
            )
            views = ColliderViews(self.server, mesh.dim, mesh.size, [offset], None, f"colliders_{number}")
            views.have([Shown(name, name, own) for name, own in reel.colliders.items()], 1)
            self._colliders.append(views)
        self._timed = self.reels[0].times is not None
        self._scale = Scale()
        self.at = 0.0  # s, or samples
        self._shown: tuple[Any, ...] = ()
        self._build_panel()

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://127.0.0.1:{self.server.get_port()}"

    @property
    def end(self) -> float:
        """The last moment [s], or the last sample."""
        if not self._timed:
            return float(self.reels[0].count - 1)
        return max(float(reel.times[-1]) for reel in self.reels if reel.times is not None)

    def run(self, until: Callable[[], bool] = lambda: False) -> None:
        """Play until told."""
        before = time.monotonic()
        while not until():
            now = time.monotonic()
            self.tick(now - before)
            before = now
            time.sleep(max(0.001, _TICK - (time.monotonic() - now)))

    def tick(self, seconds: float) -> None:
        """Go on by so many seconds of the wall clock, and show what has changed."""
        if self._playing:
            rate = float(self._speed.value) * (1.0 if self._timed else _SAMPLES)
            self.at += seconds * rate
            if self.at > self.end:
                self.at = 0.0 if self._again.value else self.end
                if not self._again.value:
                    self._play(False)
            self._slider.value = round(self.at, 4)
        indices = tuple(self._index(reel) for reel in self.reels)
        wanted = (*indices, self._quantity.value)
        if wanted != self._shown:
            self._shown = wanted
            self._show(indices)

    def close(self) -> None:
        """End the server of the page."""
        stop_server(self.server)

    def _build_panel(self) -> None:
        gui = self.server.gui
        self._status = gui.add_html("")
        self._legend = gui.add_html("")
        if self._timed:
            self._forces()
        quantities = [own for own in self.reels[0].quantities if own != DIFFERENCE or len(self.reels) > 1]
        self._quantity = gui.add_dropdown("colours", quantities, initial_value=quantities[0])
        label, step = ("time [s]", 1e-3) if self._timed else ("sample", 1.0)
        self._slider = gui.add_slider(label, 0.0, max(self.end, step), step, 0.0)
        self._speed = gui.add_slider("speed", 0.05, 2.0, 0.05, 1.0)
        self._again = gui.add_checkbox("again and again", True)
        self._button = gui.add_button("play")
        self._playing = False

        @self._slider.on_update
        async def _(event: Any) -> None:
            if event.client is not None and np.isfinite(event.target.value):
                self.at = float(np.clip(event.target.value, 0.0, self.end))

        @self._button.on_click
        async def _(event: Any) -> None:
            self._play(not self._playing)

        self._play(self._timed)

    def _play(self, on: bool) -> None:
        if on and self.at >= self.end:
            self.at = 0.0
        self._playing, self._button.label = on, "pause" if on else "play"

    def _forces(self) -> None:
        """The forces of all motions over time, at the times of the longest; a shorter one stays where it ends."""
        times = max((reel.times for reel in self.reels if reel.times is not None), key=lambda own: own[-1])
        lines = [
            np.interp(times, reel.times, reel.forces)
            for reel in self.reels
            if reel.times is not None and reel.forces is not None
        ]
        self.server.gui.add_uplot(
            data=(times, *lines),
            series=force_lines(len(lines)),
            title="contact force [N]",
            scales=force_scales(),
            legend={"show": False},
            height=150,
        )

    def _index(self, reel: Reel) -> int:
        if reel.times is None:
            return int(np.clip(round(self.at), 0, reel.count - 1))
        return int(np.clip(np.searchsorted(reel.times, self.at + 1e-9, side="right") - 1, 0, reel.count - 1))

    def _show(self, indices: Sequence[int]) -> None:
        quantity = self._quantity.value
        stills = [reel.still(index) for reel, index in zip(self.reels, indices, strict=True)]
        values = [
            self._difference(reel, still, stills[0])
            if quantity == DIFFERENCE
            else reel.values(index, still, quantity)
            for reel, index, still in zip(self.reels, indices, stills, strict=True)
        ]
        top = self._scale.fit(quantity, np.concatenate(values), 0.0)
        with self.server.atomic():
            for number, still in enumerate(stills):
                nodes = drawn_nodes(self.reels[number].rest)
                self._views[number].show(in_space(still.positions[nodes]), values[number], top)
                self._colliders[number].place(0, still.poses)
        lines = [
            f'{swatch(number) if len(stills) > 1 else ""}<span style="color:{BAD if still.bad else GOOD}">●</span> '
            f"{escape(still.title)}"
            for number, still in enumerate(stills)
        ]
        when = f"{self.at:.3f} s" if self._timed else ""
        self._status.content = (
            f'<div id="softprint-status" style="font-size:0.82em;padding:0.15em 0.5em">{"<br>".join(lines)}<br>{when}'
            "</div>"
        )
        self._legend.content = legend_html(quantity, top, UNITS.get(quantity, "mm"), self._scale.above)
        self.server.flush()

    def _difference(self, reel: Reel, still: Still, first: Still) -> Any:
        """(n,) [mm] from the first motion, if it is of the same mesh."""
        nodes = drawn_nodes(reel.rest)
        if still.positions.shape != first.positions.shape:
            return np.full(len(nodes), np.nan)
        return 1e3 * np.linalg.norm(still.positions[nodes] - first.positions[nodes], axis=1)
