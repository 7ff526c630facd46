"""The controls of the page. Every one of them turns into a command to the session."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from softprint.runtime.errors import SoftprintError
from softprint.runtime.viewer.page.shape_choices import choices, renamed, table_of, table_of_upload
from softprint.runtime.viewer.session import commands as ask
from softprint.runtime.viewer.session.painting import QUANTITIES
from softprint.runtime.viewer.session.session import MOST_COLLIDERS

if TYPE_CHECKING:
    import viser

    from softprint.runtime.experiment import Experiment

_ALONE = "nothing"
_NO_HANDLE = "none"
_NO_COLLIDER = "-"
_DENSITY = 1000.0  # kg/m^3 of a collider that falls, at first


class Panel:
    """send: a command to the session; uploads: the folder for files that are dropped in; say: a sentence to the user;
    hold, lead: the collider and the handle that the gizmos are on."""

    def __init__(
        self,
        server: viser.ViserServer,
        experiment: Experiment,
        models: list[str],
        handles: list[str],
        uploads: Path,
        send: Callable[[ask.Command], None],
        say: Callable[[str, str], None],
        hold: Callable[[str | None], None],
        lead: Callable[[int | str | None], None],
    ) -> None:
        self._experiment, self._uploads, self._send, self._say = experiment, uploads, send, say
        self._hold, self._lead = hold, lead
        self.setting: ask.Setting | None = None
        gui = server.gui
        with gui.add_folder("Model"):
            self.model = gui.add_dropdown("plays", models, initial_value=models[0])
            self.beside = gui.add_dropdown("beside it", [_ALONE, *models], initial_value=_ALONE)
            self.quantity = gui.add_dropdown("colours", list(QUANTITIES), initial_value="displacement")
            self.points = gui.add_checkbox("contact points", True)
        with gui.add_folder("Time"):
            self.run = gui.add_button_group("", ["pause", "step", "reset"])
            self.speed = gui.add_slider("speed", 0.05, 1.0, 0.05, 1.0)
            self.newton = gui.add_number(
                "Newton, at most", experiment.dynamics.max_iterations, min=1, max=200, step=1
            )
            self.record = gui.add_button("record", color="red")
            self.film = gui.add_checkbox("and a GIF", False)
        with gui.add_folder("Collider"):
            self.held = gui.add_dropdown("held", [_NO_COLLIDER], initial_value=_NO_COLLIDER)
            shapes = choices(experiment)
            self.shape = gui.add_dropdown("shape", shapes, initial_value=shapes[0])
            self.size = gui.add_number("half size [mm]", 20.0, min=0.1, max=10_000.0, step=0.5)
            self.swap = gui.add_button_group("", ["replace", "add", "remove"])
            self.file = gui.add_upload_button("from a file (STL, OBJ, PLY)")
            self.density = gui.add_number("density [kg/m³]", _DENSITY, min=1.0, max=30_000.0, step=50.0)
            self.fall = gui.add_button("let it fall")
        with gui.add_folder("Handle", expand_by_default=False):
            self.handle = gui.add_dropdown("led", [_NO_HANDLE, *handles], initial_value=_NO_HANDLE)
            self.give_back = gui.add_button("give back")
        self._connect()

    def show(self, setting: ask.Setting) -> None:
        """What the session is made of now."""
        self.setting = setting
        names = [table.name for table in setting.tables] or [_NO_COLLIDER]
        if tuple(self.held.options) != tuple(names):
            before = self.held.value
            self.held.options = names
            self.held.value = before if before in names else names[0]
        self.record.label = "record" if setting.recording is None else "stop and save"
        if not setting.building:
            self.model.value = setting.models[0]
            self.beside.value = setting.models[1] if len(setting.models) > 1 else _ALONE

    def held_is(self, name: str | None) -> None:
        """A collider has been taken hold of with the mouse."""
        if name is not None and name in self.held.options:
            self.held.value = name
        free = () if self.setting is None else self.setting.free
        self.fall.label = "hold it" if self.held.value in free else "let it fall"

    def _record(self) -> None:
        on = self.setting is None or self.setting.recording is None
        self._send(ask.Record(on, self.film.value))

    def _connect(self) -> None:
        send = self._send
        _on(self.model, self._set_models)
        _on(self.beside, self._set_models)
        _on(self.quantity, lambda: send(ask.SetColour(self.quantity.value)))
        _on(self.speed, self._set_pace)
        _on(self.newton, self._set_pace)
        _click(self.run, self._run)
        _click(self.record, self._record)
        _on(self.held, lambda: self._hold(self.held.value))
        _click(self.swap, self._swap)
        _click(self.fall, self._fall)
        _on(self.handle, self._lead_handle)
        _click(self.give_back, self._give_back)

        @self.file.on_upload  # on a thread of viser's: reading and repairing a mesh takes seconds
        def _(event: Any) -> None:
            self._tried(lambda: self._upload(event.target.value))

    # ---- what the controls do ---------------------------------------------------------------------------------

    @property
    def paused(self) -> bool:
        """Whether the button offers to go on."""
        return bool(self.run.options[0] == "play")

    def _set_models(self) -> None:
        beside = self.beside.value
        self._send(ask.SetModels((self.model.value, *(() if beside == _ALONE else (beside,)))))

    def _set_pace(self) -> None:
        iterations = int(self.newton.value)
        self._send(ask.SetPace(self.paused, float(self.speed.value), iterations))

    def _run(self) -> None:
        match self.run.value:
            case "step":
                self._pause(True)
                self._send(ask.StepOnce())
            case "reset":
                self._send(ask.Reset())
            case pressed:
                self._pause(pressed == "pause")

    def _pause(self, paused: bool) -> None:
        if paused != self.paused:
            self.run.options = ("play" if paused else "pause", "step", "reset")
            self._set_pace()

    def _swap(self) -> None:
        self._tried(lambda: self._swapped(self.swap.value))

    def _swapped(self, what: str) -> None:
        if self.setting is None:
            return
        tables = {table.name: table for table in self.setting.tables}
        if what == "remove":
            if len(tables) <= 1:
                raise SoftprintError("the scene keeps its last collider: replace it")
            tables.pop(self.held.value, None)
            self._send(ask.SetShapes(tuple(tables.values())))
            return
        table = table_of(self._experiment, self.shape.value, 1e-3 * float(self.size.value))
        self._put(table, what == "replace")

    def _put(self, table: Any, replace: bool) -> None:
        """A new collider, in place of the one that is held or beside it."""
        assert self.setting is not None
        tables = {own.name: own for own in self.setting.tables}
        held = self.held.value
        taken = {name for name in tables if not (replace and name == held)}
        table = renamed(table, taken)
        if replace and tables:
            new = tuple(table if name == held else own for name, own in tables.items())
        elif len(tables) >= MOST_COLLIDERS:
            raise SoftprintError(f"a scene has at most {MOST_COLLIDERS} colliders here: remove one")
        else:
            new = (*tables.values(), table)
        self._send(ask.SetShapes(new))

    def _upload(self, file: Any) -> None:
        self._say(f"reading {file.name} …", "info")
        table = table_of_upload(self._uploads, file.name, file.content, 1e-3 * float(self.size.value))
        self._put(table, True)
        self._say(f"{file.name} is a collider of {2.0 * float(self.size.value):g} mm", "good")

    def _fall(self) -> None:
        if self.setting is not None and self.setting.tables:
            free = self.held.value in self.setting.free
            self._send(ask.DropCollider(self.held.value, None if free else float(self.density.value)))

    def _lead_handle(self) -> None:
        self._lead(_handle(self.handle.value))

    def _give_back(self) -> None:
        handle = _handle(self.handle.value)
        if handle is not None:
            self._send(ask.LeadHandle(handle, None))
            self._lead(None)
            self.handle.value = _NO_HANDLE

    def _tried(self, work: Callable[[], None]) -> None:
        try:
            work()
        except SoftprintError as error:
            self._say(str(error), "bad")


def handle_names(frames: list[str], n_points: int) -> list[str]:
    """Handles as the panel names them."""
    return [*frames, *(f"point {number}" for number in range(n_points))]


def _handle(name: str) -> int | str | None:
    """The handle of such a name."""
    if name == _NO_HANDLE:
        return None
    first, _, number = name.rpartition(" ")
    return int(number) if first == "point" else name


def _on(control: Any, work: Callable[[], None]) -> None:
    """When a user changes a control; not when this program does."""

    async def changed(event: Any) -> None:
        if event.client is not None:
            work()

    control.on_update(changed)


def _click(control: Any, work: Callable[[], None]) -> Callable[[Any], Awaitable[None]]:
    async def clicked(event: Any) -> None:
        work()

    control.on_click(clicked)
    return clicked
