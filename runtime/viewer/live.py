"""`softprint view EXPERIMENT`: the body of the run directory, a session, and its page."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING

from softprint.runtime.errors import SoftprintError
from softprint.runtime.scenes.playing import BARE
from softprint.runtime.scenes.scene import find_scene

if TYPE_CHECKING:
    from softprint.runtime.cli.context import Context
    from softprint.runtime.experiment import Experiment, SceneSpec

# The models that the window begins with, if there are any of that name.
_PREFERRED = ("ours", "mechanics", BARE)


def press_by_hand(
    context: Context, scene: str | None, models: Sequence[str] | None, port: int, open_browser: bool
) -> None:
    """Serve the page until Ctrl-C. Raises SoftprintError where there is nothing to press, or no page can be served."""
    from softprint.runtime.cli.run_body import body_of_run
    from softprint.runtime.viewer.page.browser import announce
    from softprint.runtime.viewer.page.live import LivePage
    from softprint.runtime.viewer.page.server import check_port
    from softprint.runtime.viewer.processes.simulation_process import SimulationProcess
    from softprint.runtime.viewer.session.workshop import Workshop

    spec = the_scene(context.experiment, scene)
    check_port(port)
    body = body_of_run(context)
    with context.stage(f"preparing {spec.name}"):
        workshop = Workshop(context.experiment, body, spec, context.out_dir)
        first = tuple(models) if models else (_first(workshop.names),)
        for name in first:
            if name not in workshop.names:
                raise SoftprintError(
                    f"there is no model {name!r} in {context.out_dir / 'corrections'}; there are "
                    f"{', '.join(workshop.names)}"
                )
    with interrupted() as stop, SimulationProcess(workshop, first) as simulation:
        page = LivePage(workshop, simulation, port, context.say)
        try:
            announce(page.address, open_browser, context.say)
            page.run(stop)
        finally:
            page.close()
            simulation.close()
            for event in simulation.events():
                if hasattr(event, "text"):
                    context.say(event.text)


def the_scene(experiment: Experiment, name: str | None) -> SceneSpec:
    """The scene of that name, by default the first one that tests, with colliders if there is one."""
    if name is not None:
        scene = find_scene(experiment, name)
    else:
        scenes = [*experiment.scenes_of_role("test"), *experiment.scenes]
        scenes = [own for own in scenes if own.colliders] or scenes
        if not scenes:
            raise SoftprintError(
                f"{experiment.path}: it has no [[scenes]], which say how the body is held and what presses it"
            )
        scene = scenes[0]
    return scene


def _first(names: Sequence[str]) -> str:
    return next((name for name in _PREFERRED if name in names), names[0])


@contextmanager
def interrupted() -> Iterator[Callable[[], bool]]:
    """Inside the block, Ctrl-C and SIGTERM do not interrupt but are remembered: what is yielded tells whether one came.
    A second Ctrl-C interrupts."""
    came: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        if came:
            raise KeyboardInterrupt
        came.append(number)

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: bool(came)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
