"""The stage of the page: the server with its light, ground, camera and script, before anything stands on it."""

from __future__ import annotations

from importlib.resources import files
from typing import TYPE_CHECKING

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.viewer.page.server import start_server

if TYPE_CHECKING:
    import viser

_ORANGE = (214, 92, 58)


def open_stage(port: int, title: str, lower: Array, upper: Array, dim: int, count: int) -> viser.ViserServer:
    """A server whose scene fits `count` bodies with these bounds (dim,) [m] beside each other."""
    server = start_server(port, title)
    server.gui.configure_theme(
        control_layout="collapsible",
        control_width="medium",
        show_logo=False,
        show_share_button=False,
        brand_color=_ORANGE,
    )
    size = float((upper - lower).max())
    _light(server, size)
    run_script(server)
    centre = np.zeros(3)
    centre[:dim] = 0.5 * (lower + upper)
    centre[0] += 0.5 * (count - 1) * beside(lower, upper)[0]
    far = size * (2.6 + 1.1 * (count - 1))
    camera = server.initial_camera
    camera.near, camera.far = 0.01 * size, 100.0 * size
    camera.fov = float(np.radians(40.0))
    if dim == 2:
        server.scene.set_up_direction("+y")
        camera.position = tuple(centre + np.array([0.0, 0.15 * size, 1.1 * far]))
        camera.look_at = tuple(centre + np.array([0.0, 0.15 * size, 0.0]))
    else:
        server.scene.set_up_direction("+z")
        view = np.array([0.45, -1.0, 0.55])
        camera.position = tuple(centre + far * view / np.linalg.norm(view))
        camera.look_at = tuple(centre + np.array([0.0, 0.0, 0.22 * size]))
        server.scene.add_grid(
            "/ground",
            width=8 * size,
            height=8 * size,
            cell_size=0.25 * size,
            section_size=size,
            cell_color=(232, 228, 224),
            section_color=(214, 208, 202),
            position=(0.0, 0.0, float(lower[2]) - 1e-3 * size),
            shadow_opacity=0.15,
        )
    return server


def make_room(server: viser.ViserServer, step: Array, more: int) -> None:
    """Have every browser look at so many bodies more, or fewer, each a step (3,) [m] from the next; the direction
    of the view stays."""
    cameras = [server.initial_camera, *(client.camera for client in server.get_clients().values())]
    for camera in cameras:
        look_at = np.asarray(camera.look_at) + 0.5 * more * step
        position = look_at + 1.4**more * (np.asarray(camera.position) - np.asarray(camera.look_at))
        camera.position = tuple(position)
        camera.look_at = tuple(look_at)


def beside(lower: Array, upper: Array) -> Array:
    """(3,) [m] from one body to the next."""
    return np.array([1.45 * float(upper[0] - lower[0]), 0.0, 0.0])


def run_script(server: viser.ViserServer) -> None:
    """Have every browser that opens the page run `colours.js`."""
    from viser import _messages

    source = files("softprint.runtime.viewer.page").joinpath("colours.js").read_text(encoding="utf-8")
    server._websock_server.queue_message(_messages.RunJavascriptMessage(source=source))


def _light(server: viser.ViserServer, size: float) -> None:
    """As in the pictures of `runtime/drawing/solid.py`: one key light and two to fill."""
    scene = server.scene
    scene.configure_default_lights(False)
    for number, (place, intensity) in enumerate(
        (((1, -2, 3), 1.25), ((-3, -2, 1), 0.55), ((3, -1, 0.5), 0.4))
    ):
        scene.add_light_directional(
            f"/light_{number}",
            intensity=intensity,
            position=tuple(10.0 * size * np.array(place, dtype=float)),
        )
    scene.add_light_ambient("/light_all", intensity=0.55)
