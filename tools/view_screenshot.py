"""A picture of the window of `softprint view`: the collider of an experiment pressed into its body.

    python -m tools.view_screenshot examples/jelly3d_small.toml docs/view.png [--out RUN] [--model ours] [--beside bare]

The run directory needs what `softprint view` needs; without trained models the body is bare. Chromium draws the page,
without a display.
"""

from __future__ import annotations

import argparse
import threading
import time
from pathlib import Path

import numpy as np

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders import RigidPose
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import atomic_path
from softprint.runtime.viewer.live import the_scene
from softprint.runtime.viewer.page.live import LivePage
from softprint.runtime.viewer.processes.simulation_process import SimulationProcess
from softprint.runtime.viewer.session.workshop import Workshop
from tools.chromium import browser, open_window

_SIZE = (1280, 760)
# How far the collider is pressed in, by the time the picture is taken, as a share of the body's size.
_DEPTH = 0.1
_PATIENCE = 120.0  # s


def main() -> None:
    """Press, and take the picture."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("--out", type=Path, help="run directory (default: runs/NAME)")
    parser.add_argument(
        "--model", help="that plays (default: ours, mechanics, bare: the first that there is)"
    )
    parser.add_argument("--beside", help="a second model beside it (default: none)")
    parser.add_argument("--colours", default="displacement", help="(default: displacement)")
    options = parser.parse_args()
    context = Context(options.experiment, out=options.out)
    body = body_of_run(context)
    workshop = Workshop(context.experiment, body, the_scene(context.experiment, None), context.out_dir)
    preferred = [options.model] if options.model else ["ours", "mechanics", "bare"]
    model = next(name for name in preferred if name in workshop.names)
    models = (model, options.beside) if options.beside else (model,)
    with SimulationProcess(workshop, models) as simulation:
        page = LivePage(workshop, simulation, 0, print)
        ended = threading.Event()
        running = threading.Thread(target=page.run, args=(ended.is_set,))
        running.start()
        try:
            _take(workshop, page, options.picture, options.colours)
        finally:
            ended.set()
            running.join()
            page.close()


def _take(workshop: Workshop, page: LivePage, picture: Path, quantity: str) -> None:
    with browser() as own:
        window = open_window(own, page.address, *_SIZE, patience=_PATIENCE)
        page.choose_colours(quantity)
        table = workshop.tables[0]
        for height in np.linspace(0.0, 1.0, 12):
            page.lead(table.name, pressed(workshop, height))
            time.sleep(0.3)
        # Until the line of the force is long enough to be seen, and the page shows the pressed body.
        end = time.monotonic() + _PATIENCE
        while " 0.00 N" in window.inner_text("#softprint-status"):
            if time.monotonic() > end:
                raise SoftprintError("the collider has not reached the body in time")
            time.sleep(0.5)
        time.sleep(4.0)
        with atomic_path(picture) as temporary:
            window.screenshot(path=str(temporary))
    print(f"{picture} written.")


def pressed(workshop: Workshop, share: float) -> RigidPose:
    """The pose of the collider on its way from above the body into its top."""
    body, table = workshop.body, workshop.tables[0]
    collider, start = workshop.collider(table), workshop.start_poses()[table.name]
    up = np.eye(body.dim)[-1]
    top = float(body.mesh.points[:, -1].max())
    # The lowest point of the collider as it is turned.
    from softprint.runtime.colliders.surface_points import surface_points

    lowest = float((surface_points(collider) @ start.rotation.T)[:, -1].min())
    middle = 0.5 * (body.mesh.points.min(axis=0) + body.mesh.points.max(axis=0))
    above, inside = 0.1 * body.mesh.size, -_DEPTH * body.mesh.size
    height = top - lowest + (1.0 - share) * above + share * inside
    return RigidPose(start.rotation, middle - (middle @ up) * up + height * up)


if __name__ == "__main__":
    run_script(main)
