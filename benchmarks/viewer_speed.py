"""What the window costs the simulation, and how long a dent takes: `softprint view` without a mouse.

    python -m benchmarks.viewer_speed examples/jelly3d.toml [--out RUN] [--model ours] [--seconds 10] [--rounds 3]
                                      [--browser]

A session is driven through a press, in turns alone, with the server of the page but no browser, and with a client that
takes everything the server sends (--browser: a real one, drawn in software, which needs much of a core itself). The
collider goes up and down at the top of the body, so that the contact changes in every step. 60 steps a second are real
time. Latency is measured from a new target of the collider in this process to the picture in which the body has given
way, as it is handed to the server; with --browser also from a mouse event to a changed mesh in the browser, drawn in
software, and with the triangles left out, as if a graphics card drew them in no time. Without a trained model of form
force an untrained one is used, marked *, which costs as much.
"""

from __future__ import annotations

import argparse
import contextlib
import statistics
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bodies_speed import correction_file
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.scenes.playing import BARE, correction_path
from softprint.runtime.scenes.speed import machine
from softprint.runtime.viewer.live import the_scene
from softprint.runtime.viewer.page.body_view import BodyView
from softprint.runtime.viewer.page.live import LivePage
from softprint.runtime.viewer.page.server import stop_server
from softprint.runtime.viewer.page.stage import open_stage
from softprint.runtime.viewer.processes.frame_board import FrameBoard
from softprint.runtime.viewer.processes.simulation_process import SimulationProcess
from softprint.runtime.viewer.session import commands as ask
from softprint.runtime.viewer.session.painting import drawn_nodes
from softprint.runtime.viewer.session.workshop import Workshop
from tools.chromium import WITHOUT_TRIANGLES
from tools.view_screenshot import pressed

_WAYS = ("alone", "page", "client")
_MANY = 30_000
# Notes, after the next mouse event, how long it takes until a mesh has changed by so much [ms]. It is looked at between
# frames of the browser: a callback of frames may come before the one that changes the mesh.
_WATCH = """([name, moved]) => {
    let mesh = null;
    window.__viserMutable.nodeRefFromName[name].traverse(own => { if (mesh === null && own.isMesh) mesh = own; });
    const before = Float32Array.from(mesh.geometry.attributes.position.array);
    window.__dent = null;
    window.addEventListener("pointermove", () => {
        const began = performance.now();
        const look = () => {
            const now = mesh.geometry.attributes.position.array;
            const changed = before.some((x, at) => Math.abs(now[at] - x) > moved);
            if (changed) window.__dent = performance.now() - began; else setTimeout(look, 4);
        };
        look();
    }, { once: true, capture: true });
}"""


def main() -> None:
    """Measure in turns, and print medians."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="run directory (default: runs/NAME)")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="of the experiment")
    parser.add_argument("--model", default="ours", help="(default: ours)")
    parser.add_argument("--seconds", type=float, default=10.0, help="of each turn (default: 10)")
    parser.add_argument("--rounds", type=int, default=3, help="turns of each kind (default: 3)")
    parser.add_argument("--browser", action="store_true", help="a real browser as the client (default: off)")
    options = parser.parse_args()
    context = Context(options.experiment, tuple(options.set), out=options.out, quiet=True)
    body = body_of_run(context)
    model, mark = options.model, ""
    if model != BARE and not correction_path(context.out_dir, model).is_file():
        path, trained = correction_file(context, body, None)
        if not trained:
            target = correction_path(context.out_dir, model)
            target.parent.mkdir(exist_ok=True)
            target.write_bytes(path.read_bytes())
            mark = "*"
    workshop = Workshop(context.experiment, body, the_scene(context.experiment, None), context.out_dir)
    here = machine()
    print(
        f"{here['processor']}, {here['cores']} cores; {context.experiment.name}: {body.mesh.n_cells} elements, "
        f"{len(drawn_nodes(body.mesh))} drawn vertices; {model}{mark}"
    )
    rates: dict[str, list[float]] = {way: [] for way in _WAYS}
    costs: dict[str, list[float]] = {way: [] for way in _WAYS}
    late: list[float] = []
    seen: dict[str, list[float]] = {}
    try:
        with SimulationProcess(workshop, (model,)) as simulation:
            _first(simulation)
            _drive(workshop, simulation, options.seconds)  # compiled, and settled
            for _ in range(options.rounds):
                for way in _WAYS:
                    with _watched(workshop, simulation, way, options.browser):
                        rate, cost = _drive(workshop, simulation, options.seconds)
                    rates[way].append(rate)
                    costs[way].append(cost)
            late = _latencies(workshop, simulation, 20)
            if options.browser:
                for how, first in (("drawn in software", ""), ("triangles left out", WITHOUT_TRIANGLES)):
                    seen[how] = _seen_in_the_browser(workshop, simulation, 20, first)
    finally:
        if mark:
            correction_path(context.out_dir, model).unlink()
    alone = statistics.median(rates["alone"])
    for way in _WAYS:
        rate, cost = statistics.median(rates[way]), statistics.median(costs[way])
        print(
            f"{way:<8}{rate:7.1f} steps/s  {1e3 * cost:6.2f} ms a step  {rate / alone:5.2f} of alone  "
            f"(turns: {', '.join(f'{own:.1f}' for own in rates[way])})"
        )
    print(_summary("from target to picture", late))
    for how, times in seen.items():
        print(_summary(f"from mouse event to changed mesh in the browser, {how}", times))
    print(f"CPU time of the page for a picture of {_MANY} vertices: {1e3 * _page_cost():.2f} ms")


def _summary(what: str, times: list[float]) -> str:
    median, most = 1e3 * statistics.median(times), 1e3 * max(times)
    return f"latency {what}: median {median:.0f} ms, largest of {len(times)} {most:.0f} ms"


def _page_cost() -> float:
    """CPU seconds to pin a picture, take it, and hand it with its colours to the server."""
    rng = np.random.default_rng(0)
    rest = rng.uniform(size=(_MANY, 3)).astype(np.float32)
    values = rng.uniform(size=_MANY).astype(np.float32)
    server, board = open_stage(0, "cost", np.zeros(3), np.ones(3), 3, 1), FrameBoard(_MANY)
    view = BodyView(server, "body", rest, rng.integers(0, _MANY, (2 * _MANY, 3)), np.zeros(3), 1.0, False)
    costs = []
    for number in range(60):
        began = time.process_time()
        board.publish(rest + np.float32(1e-3 * number), values, number)
        picture = board.newest(number)
        assert picture is not None
        view.show(picture.vertices, picture.values, 1.0)
        server.flush()
        costs.append(time.process_time() - began)
    stop_server(server)
    return statistics.median(costs)


def _seen_in_the_browser(
    workshop: Workshop, simulation: SimulationProcess, count: int, first: str
) -> list[float]:
    """[s] from a mouse event, with a collider held in contact, to the next frame of the browser with a changed mesh."""
    from tools.chromium import PLACE, browser, open_window

    name = workshop.tables[0].name
    with _page(workshop, simulation) as page, browser() as own:
        window = open_window(own, page.address, 640, 480, 120.0, first=first)
        page.lead(name, pressed(workshop, 1.0))
        time.sleep(3.0)
        x, y = window.evaluate(PLACE, f"/colliders/{name}_0")
        page.lead(name, pressed(workshop, 0.8))
        time.sleep(1.0)
        way = window.evaluate(PLACE, f"/colliders/{name}_0")[1] - y
        window.mouse.move(x - 4, y + way)
        window.mouse.down()
        for taken in range(1, 6):  # a drag begins with the first few pixels
            window.mouse.move(x - 4, y + way + taken)
            time.sleep(0.1)
        times = []
        for number in range(count):
            window.evaluate(_WATCH, ["/body_0", 0.002 * workshop.body.mesh.size])
            window.mouse.move(x - 4, y + (5 if number % 2 == 0 else way + 5))
            window.wait_for_function("() => window.__dent !== null")
            times.append(1e-3 * float(window.evaluate("() => window.__dent")))
            time.sleep(1.0)
        window.mouse.up()
    return times


def _first(simulation: SimulationProcess) -> None:
    while simulation.boards[0].newest(0) is None:
        time.sleep(0.05)


def _drive(workshop: Workshop, simulation: SimulationProcess, seconds: float) -> tuple[float, float]:
    """Press up and down; steps a second and seconds a step, as the simulation itself counts them."""
    name, began = workshop.tables[0].name, time.monotonic()
    paces: list[Any] = []
    while (since := time.monotonic() - began) < seconds:
        pose = pressed(workshop, 0.8 + 0.2 * np.sin(4.0 * since))
        simulation.send(ask.LeadCollider(name, pose.translation, pose.rotation))
        time.sleep(0.02)
        picture = simulation.boards[0].newest(0)
        if picture is not None and since > 1.5:
            paces.append(picture.meta["info"].pace)
    return (
        statistics.mean(pace.steps for pace in paces),
        statistics.mean(pace.cost for pace in paces),
    )


def _latencies(workshop: Workshop, simulation: SimulationProcess, count: int) -> list[float]:
    """[s] from a push of the collider by a fiftieth of the body to a picture that shows it."""
    name, board = workshop.tables[0].name, simulation.boards[0]
    moved = 0.002 * workshop.body.mesh.size
    times = []
    for number in range(count):
        pose = pressed(workshop, 0.8 if number % 2 else 1.0)
        before = board.newest(0)
        assert before is not None
        began = time.monotonic()
        simulation.send(ask.LeadCollider(name, pose.translation, pose.rotation))
        while time.monotonic() < began + 5.0:
            picture = board.newest(before.number)
            if picture is not None and np.abs(picture.vertices - before.vertices).max() > moved:
                times.append(time.monotonic() - began)
                break
            time.sleep(0.001)
        time.sleep(1.0)
    return times


@contextlib.contextmanager
def _watched(workshop: Workshop, simulation: SimulationProcess, way: str, real: bool) -> Iterator[None]:
    """Inside the block, a page shows the session, with or without a client."""
    if way == "alone":
        yield
        return
    with (
        _page(workshop, simulation) as page,
        _client(page, real) if way == "client" else contextlib.nullcontext(),
    ):
        yield


@contextlib.contextmanager
def _page(workshop: Workshop, simulation: SimulationProcess) -> Iterator[LivePage]:
    page, ended = LivePage(workshop, simulation, 0, lambda text: None), threading.Event()
    running = threading.Thread(target=page.run, args=(ended.is_set,))
    running.start()
    try:
        yield page
    finally:
        ended.set()
        running.join()
        page.close()


@contextlib.contextmanager
def _client(page: LivePage, real: bool) -> Iterator[None]:
    if real:
        from tools.chromium import browser, open_window

        with browser() as own:
            open_window(own, page.address, 800, 600, 120.0)
            yield
        return
    import viser
    from websockets.sync.client import connect

    address = page.address.replace("http", "ws", 1)
    with connect(
        address, origin=page.address, subprotocols=[f"viser-v{viser.__version__}"], max_size=None
    ) as connection:
        ended = threading.Event()

        def take() -> None:
            while not ended.is_set():
                with contextlib.suppress(TimeoutError):
                    connection.recv(timeout=0.2)

        taking = threading.Thread(target=take)
        taking.start()
        try:
            yield
        finally:
            ended.set()
            taking.join()


if __name__ == "__main__":
    run_script(main)
