"""3D pictures with PyVista, off screen (by EGL: no display or xvfb is needed)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.doctor.finding import Level
from softprint.runtime.doctor.graphics import check_rendering
from softprint.runtime.drawing.colours import BODY, COLLIDER, EDGES
from softprint.runtime.drawing.scale import add_scale, error_map
from softprint.runtime.drawing.scene import Scene
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import atomic_path

if TYPE_CHECKING:
    import pyvista as pv

_SIZE = (1000, 800)
_VIEW = np.array([0.45, -1.0, 0.55])  # from the body towards the camera
_ANGLE = 22.0  # of the camera [degrees]
_SCALE_HEIGHT = 0.24  # of the picture, below what is seen
_ROOM_AROUND = 1.06  # the half picture to what is seen in it


def draw_solid(path: Path, scene: Scene) -> None:
    """Draw a 3D scene; SoftprintError if PyVista is missing or cannot draw off screen."""
    middles = [vertices.mean(axis=0) for vertices, _ in scene.solids[:1]]
    direction = view_direction(scene.points, middles)
    plotter = lit_plotter(_SIZE, direction)
    _add_body(plotter, scene)
    for vertices, facets in scene.solids:
        plotter.add_mesh(_skin(vertices, facets), color=COLLIDER, opacity=0.4, smooth_shading=True)
    _add_marks(plotter, scene)
    plotter.add_text(scene.title, position="upper_left", font_size=11, color="#1b1b1f")
    seen = np.concatenate([scene.points, *(vertices for vertices, _ in scene.solids)])
    look_at(plotter, seen.min(axis=0), seen.max(axis=0), direction, has_scale=scene.values is not None)
    plotter.enable_anti_aliasing("ssaa")
    pixels = np.asarray(plotter.screenshot(return_img=True))[..., :3]
    plotter.close()
    if scene.values is not None:
        pixels = add_scale(pixels, scene.label, _top(scene))
    # Imported here, because PyVista brings it, which may be missing.
    from PIL import Image

    with atomic_path(path) as temporary:
        Image.fromarray(pixels).save(temporary, format="PNG")


def lit_plotter(size: tuple[int, int], direction: Array) -> pv.Plotter:
    """A white picture of that size [pixels] with three lights that suit a camera in direction (3,).

    Raises SoftprintError if PyVista is missing or cannot draw off screen."""
    # A missing GL driver ends the process instead of raising, so rendering is tried in a child process first.
    finding = _rendering()
    if finding.level is not Level.OK:
        raise SoftprintError(
            f"no picture can be drawn here: {finding.subject} {finding.detail}; remedy: {finding.remedy}"
        )
    os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    import pyvista as pv

    plotter = pv.Plotter(off_screen=True, window_size=list(size), lighting="none")
    plotter.set_background("white")
    rotation = _rotation_to(direction)
    for position, intensity in (((1, -2, 3), 0.7), ((-3, -2, 1), 0.42), ((3, -1, 0.5), 0.3)):
        light = pv.Light(position=tuple(rotation @ position), intensity=intensity, light_type="scene light")
        light.positional = False
        plotter.add_light(light)
    return plotter


# The answer is the same for every picture of a process.
_rendering = cache(check_rendering)


def _top(scene: Scene) -> float:
    """The largest value on the surface of a scene that has values."""
    assert scene.values is not None
    return max(float(scene.values[np.unique(scene.facets)].max()), float(np.finfo(float).tiny))


def _add_body(plotter: pv.Plotter, scene: Scene) -> None:
    skin = _skin(scene.points, scene.facets, scene.values)
    if scene.values is None:
        plotter.add_mesh(
            skin, color=scene.colour or BODY, smooth_shading=True, ambient=0.35, diffuse=0.75, specular=0.2
        )
    else:
        plotter.add_mesh(
            skin,
            scalars="values",
            cmap=error_map(),
            clim=(0.0, _top(scene)),
            smooth_shading=True,
            ambient=0.45,
            diffuse=0.6,
            show_scalar_bar=False,
        )
    if scene.edges:
        wire = _surface(scene.points, scene.facets).extract_all_edges()
        plotter.add_mesh(wire, color=EDGES, line_width=0.6, opacity=0.45, lighting=False)


def _add_marks(plotter: pv.Plotter, scene: Scene) -> None:
    import pyvista as pv

    if not scene.marks:
        return
    size = float(np.ptp(scene.points, axis=0).max())
    for mark in scene.marks:
        few = len(mark.nodes) < 60
        ball = pv.Sphere(radius=size * (0.016 if few else 0.006), theta_resolution=14, phi_resolution=14)
        balls = pv.PolyData(scene.points[mark.nodes]).glyph(geom=ball, scale=False, orient=False)
        plotter.add_mesh(balls, color=mark.colour, smooth_shading=True, ambient=0.25)
    for number, mark in enumerate(scene.marks):
        plotter.add_text(mark.name, position=(14, 14 + 28 * number), font_size=11, color=mark.colour)


def _skin(points: Array, facets: IntArray, values: Array | None = None) -> pv.PolyData:
    """The surface with normals that are smooth except at true edges."""
    skin = _surface(points, facets)
    if values is not None:
        skin["values"] = values
    return skin.compute_normals(feature_angle=50.0, split_vertices=True, cell_normals=False)


def _surface(points: Array, facets: IntArray) -> pv.PolyData:
    """The triangles as they are."""
    import pyvista as pv

    return pv.PolyData.from_regular_faces(np.asarray(points, dtype=float), facets)


def look_at(plotter: pv.Plotter, lower: Array, upper: Array, direction: Array, has_scale: bool) -> None:
    """Set the camera so that everything between lower and upper (3,) fits in the picture, above the scale if there is
    one. direction: (3,) unit vector towards the camera."""
    centre, radius = 0.5 * (lower + upper), 0.5 * float(np.linalg.norm(upper - lower))
    if has_scale:
        radius *= 1.12
        centre = centre - np.array([0.0, 0.0, 0.14 * radius])
    plotter.camera.focal_point = tuple(centre)
    plotter.camera.position = tuple(centre + direction * 0.88 * radius / np.sin(np.radians(0.5 * _ANGLE)))
    plotter.camera.up = (0.0, 0.0, 1.0)
    plotter.camera.view_angle = _ANGLE
    plotter.reset_camera_clipping_range()


def frame_all(plotter: pv.Plotter, points: Array, direction: Array, has_scale: bool) -> None:
    """Set the camera as close as it can be with all points (m, 3) in the picture, above the scale if there is one.
    direction: (3,) unit vector towards the camera."""
    right = np.cross([0.0, 0.0, 1.0], direction)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(direction, right), direction])
    seen = points @ axes.T  # to the right, up, towards the camera
    width, height = plotter.window_size
    slope = np.tan(np.radians(0.5 * _ANGLE)) * np.array([width / height, 1.0]) / _ROOM_AROUND
    if has_scale:
        slope[1] *= 1.0 - _SCALE_HEIGHT
    centre = 0.5 * (seen.min(axis=0) + seen.max(axis=0))
    for _ in range(3):  # what is nearer looks larger, so the middle of the picture depends on the distance
        distance = float(np.max(np.abs(seen[:, :2] - centre[:2]) / slope + seen[:, 2:] - centre[2]))
        shown = (seen[:, :2] - centre[:2]) / (distance - seen[:, 2:] + centre[2])
        centre[:2] += 0.5 * (shown.min(axis=0) + shown.max(axis=0)) * distance
    if has_scale:
        centre[1] -= _SCALE_HEIGHT * distance * slope[1] / (1.0 - _SCALE_HEIGHT)
    focus = centre @ axes
    plotter.camera.focal_point = tuple(focus)
    plotter.camera.position = tuple(focus + distance * direction)
    plotter.camera.up = (0.0, 0.0, 1.0)
    plotter.camera.view_angle = _ANGLE
    plotter.renderer.reset_camera_clipping_range()


def view_direction(points: Array, middles: Sequence[Array]) -> Array:
    """(3,) unit vector towards the camera: from the front, right and above, or from a side where a collider beside the
    body is visible. points: (n, 3) of the body; middles: (3,) of colliders, of which the first counts."""
    view = _VIEW
    if middles:
        offset = middles[0][:2] - points.mean(axis=0)[:2]
        distance = float(np.linalg.norm(offset))
        if distance > 0.15 * float(np.ptp(points, axis=0).max()):
            across = np.array([offset[1], -offset[0]])  # shows the collider on the right
            view = np.append((across + 0.6 * offset) / (1.17 * distance), _VIEW[2] / 1.1)
    return view / np.linalg.norm(view)


def _rotation_to(direction: Array) -> Array:
    """(3, 3) rotation about the vertical from the default view to this one, so that the lights follow the camera."""
    angle = np.arctan2(direction[1], direction[0]) - np.arctan2(_VIEW[1], _VIEW[0])
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
