"""Pictures of three-dimensional bodies with PyVista, off screen (by EGL, without a display or xvfb)."""

import os
import subprocess
import sys
from collections.abc import Callable
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from softprint.fem_truth.report.drawing.flat_renderings import VIEWS, FlatRenderer
from softprint.fem_truth.report.drawing.picture import Picture, Renderer, encode
from softprint.runtime.arrays import Array
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.drawing.colours import BODY, COLLIDER, ERROR_COLOURS, SECTION
from softprint.runtime.mesh import Mesh

if TYPE_CHECKING:
    import pyvista as pv

_SIZE = (680, 520)
_GRID_LINES = 11  # lines of rest position along the longest side of the body: they show the strain
_COLLIDER_CELLS = 72  # of the grid on which the collider's surface is extracted, along its longest side
_LOW = 0.25  # of the body's height: a collider whose middle is lower is seen from below
# Columns: to the right, level towards the camera, up.
_GRID_AXES = np.array([[1.0, 0.32, 0.0], [0.32, -1.0, 0.0], [0.0, 0.0, np.hypot(1.0, 0.32)]]) / np.hypot(
    1.0, 0.32
)
_ELSEWHERE = 0.2  # displacement from which the camera follows the body, in its extents
_PROBE = "import pyvista; pyvista.Plotter(off_screen=True, window_size=(8, 8)).screenshot(None)"


def make_renderer(mesh: Mesh, collider: Collider, pose: RigidPose, corners: Array | None = None) -> Renderer:
    """PyVista for 3D bodies if GL works, otherwise plain drawings, which 2D bodies always get. pose: typical pose of
    the collider, which determines the view direction; corners: see `FlatRenderer`."""
    if mesh.dim == 2:
        return FlatRenderer(mesh, collider, "Drawn with matplotlib.", corners=corners)
    from_above = _from_above(mesh, collider, pose)
    problem = gl_problem()
    if problem:
        return FlatRenderer(
            mesh,
            collider,
            f"Off-screen OpenGL does not work here ({problem}), so the pictures are plain drawings "
            "without cuts. Install libegl1 and libgl1-mesa-dri, then make the report again.",
            from_above,
        )
    return GlRenderer(mesh, collider, from_above)


def _from_above(mesh: Mesh, collider: Collider, pose: RigidPose) -> bool:
    """Whether the collider is viewed from above."""
    middle = pose.apply(0.5 * (collider.lower + collider.upper)[None])[0, 2]
    lower, upper = mesh.points[:, 2].min(), mesh.points[:, 2].max()
    return bool(middle > lower + _LOW * (upper - lower))


@cache
def gl_problem() -> str:
    """The reason why PyVista cannot draw off screen here; empty if it can.

    Tested in a separate process, because a missing GL driver ends the process instead of raising an exception, and once
    only, as that takes seconds.
    """
    environment = {**os.environ, "VTK_DEFAULT_OPENGL_WINDOW": "vtkEGLRenderWindow"}
    try:
        probe = subprocess.run(
            [sys.executable, "-c", _PROBE], env=environment, capture_output=True, text=True, timeout=120
        )
    except subprocess.TimeoutExpired:
        return "a first picture took more than two minutes"
    if probe.returncode == 0:
        return ""
    lines = probe.stderr.strip().splitlines()
    return lines[-1].strip() if lines else f"the trial ended with code {probe.returncode}"


class GlRenderer:
    """PyVista pictures of one body and one collider; a `Renderer`."""

    description = "Drawn with PyVista; thin lines are lines of constant rest position."

    def __init__(self, mesh: Mesh, collider: Collider, from_above: bool = True) -> None:
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
        self.mesh, self.collider = mesh, collider
        self._from_above, self._view = from_above, _unit(VIEWS[from_above])
        lower, upper = mesh.points.min(axis=0), mesh.points.max(axis=0)
        self._centre = 0.5 * (lower + upper)
        self._extent = float(np.linalg.norm(upper - lower))
        self._side = float((upper - lower).max())
        # Lines of constant rest position, as seen from the camera: across, along the line of sight, and up. They
        # are half a spacing away from the ends, where they would coincide with the body's own edges.
        self._rest = mesh.points @ _GRID_AXES
        spacing = self._side / _GRID_LINES
        ends = zip(self._rest.min(axis=0), self._rest.max(axis=0), strict=True)
        self._levels = [np.arange(low + 0.5 * spacing, high, spacing) for low, high in ends]

    def outside(self, positions: Array, pose: RigidPose, alt: str) -> Picture:
        def build(plotter: "pv.Plotter") -> None:
            self._add_body(plotter, self._surface(positions), self._view)
            if self.collider.size:
                plotter.add_mesh(
                    self._placed_collider(pose),
                    color=COLLIDER,
                    opacity=0.42,
                    smooth_shading=True,
                    specular=0.5,
                )
            self._whole_view(plotter, positions)

        return _shot(build, alt, self._from_above)

    def cut(self, positions: Array, pose: RigidPose, centre: Array, alt: str) -> Picture | None:
        import pyvista as pv

        towards = _GRID_AXES[:, 1]
        plane: dict[str, Any] = {"normal": towards, "origin": _moved_inside(centre, towards, positions)}
        volume = pv.UnstructuredGrid({pv.CellType.TETRA: self.mesh.cells}, positions)
        volume["rest"] = self._rest
        section = volume.slice(**plane)

        def build(plotter: "pv.Plotter") -> None:
            self._add_body(plotter, self._surface(positions).clip(**plane), towards)
            plotter.add_mesh(section, color=SECTION, lighting=False)
            self._add_lines(plotter, section, "#a9563b", towards, axes=(0, 2))
            solid = self._placed_collider(pose)
            behind, outline = solid.clip(**plane), solid.slice(**plane)
            if behind.n_points:
                plotter.add_mesh(behind, color=COLLIDER, opacity=0.35, smooth_shading=True)
            if outline.n_points:
                outline.points += self._lift(towards)
                plotter.add_mesh(outline, color="#26324a", line_width=3.0, lighting=False)
            direction = _unit(towards + np.array([0.0, 0.0, 0.3]))
            _look(plotter, centre, direction, 0.54 * self._side)

        return _shot(build, alt)

    def heat(self, positions: Array, values: Array, limit: float, alt: str) -> Picture:
        from matplotlib.colors import LinearSegmentedColormap

        surface = self._surface(positions, values)

        def build(plotter: "pv.Plotter") -> None:
            plotter.add_mesh(
                surface,
                scalars="values",
                cmap=LinearSegmentedColormap.from_list("error", ERROR_COLOURS),
                clim=(0.0, limit),
                show_scalar_bar=False,
                smooth_shading=True,
                ambient=0.5,
                diffuse=0.55,
                specular=0.12,
            )
            self._whole_view(plotter, positions)

        return _shot(build, alt, self._from_above)

    def _surface(self, positions: Array, values: Array | None = None) -> "pv.PolyData":
        """The body's surface with normals that are smooth except at sharp edges."""
        import pyvista as pv

        surface = pv.PolyData.from_regular_faces(positions, self.mesh.facets)
        surface["rest"] = self._rest
        if values is not None:
            surface["values"] = values
        return surface.compute_normals(feature_angle=50.0, split_vertices=True, cell_normals=False)

    def _add_body(self, plotter: "pv.Plotter", surface: "pv.PolyData", towards: Array) -> None:
        plotter.add_mesh(
            surface,
            color=BODY,
            smooth_shading=True,
            ambient=0.2,
            diffuse=0.85,
            specular=0.3,
            specular_power=25,
        )
        self._add_lines(plotter, surface, "#8f412a", towards)

    def _add_lines(
        self,
        plotter: "pv.Plotter",
        mesh: Any,
        colour: str,
        towards: Array,
        axes: tuple[int, ...] = (0, 1, 2),
    ) -> None:
        for axis in axes:
            levels = self._levels[axis]
            mesh["level"] = mesh["rest"][:, axis]
            lines = mesh.contour(list(levels), scalars="level")
            if lines.n_points:
                lines.points += self._lift(towards)
                plotter.add_mesh(lines, color=colour, line_width=1.3, opacity=0.5, lighting=False)

    def _lift(self, towards: Array) -> Array:
        """Offset of the lines towards the camera, which avoids z-fighting with the surface."""
        return 2e-3 * self._extent * towards

    @cached_property
    def _solid(self) -> "pv.PolyData":
        """The zero level of the collider's signed distance, in its own coordinates."""
        import pyvista as pv

        lower, upper = self.collider.lower, self.collider.upper
        spacing = float((upper - lower).max()) / _COLLIDER_CELLS
        lower, upper = lower - 2 * spacing, upper + 2 * spacing
        counts = np.ceil((upper - lower) / spacing).astype(int) + 1
        grid = pv.ImageData(dimensions=tuple(counts), spacing=(spacing,) * 3, origin=tuple(lower))
        grid["sdf"] = self.collider.sdf(np.asarray(grid.points))
        return grid.contour([0.0], scalars="sdf").compute_normals(cell_normals=False)

    def _placed_collider(self, pose: RigidPose) -> "pv.PolyData":
        placed = self._solid.copy()
        placed.points = pose.apply(np.asarray(self._solid.points, dtype=float))
        placed.point_data["Normals"] = pose.rotate(np.asarray(self._solid["Normals"], dtype=float))
        return placed

    def _whole_view(self, plotter: "pv.Plotter", positions: Array) -> None:
        room = np.array([0.0, 0.0, 0.05 * self._extent * np.sign(self._view[2])])  # for the collider
        moved = 0.5 * (positions.min(axis=0) + positions.max(axis=0)) - self._centre
        # One camera for all frames; it follows the body only if that moves far away.
        along = moved if np.linalg.norm(moved) > _ELSEWHERE * self._extent else np.zeros(3)
        _look(plotter, self._centre + along + room, self._view, 0.82 * self._extent)


def _look(plotter: "pv.Plotter", at: Array, direction: Array, height: float) -> None:
    """Aim the camera at a point from a direction so that the picture is `height` metres high there."""
    angle = 20.0
    plotter.camera.focal_point = tuple(at)
    plotter.camera.position = tuple(at + direction * 0.5 * height / np.tan(np.radians(0.5 * angle)))
    plotter.camera.up = (0.0, 0.0, 1.0)
    plotter.camera.view_angle = angle
    plotter.reset_camera_clipping_range()


def _moved_inside(centre: Array, normal: Array, positions: Array) -> Array:
    """The origin (dim,) of a plane through `centre`, moved along its normal where it would touch or miss the body: a
    contact may lie at the rim, where only some of the models to compare reach."""
    along = positions @ normal
    low, high = along.min(), along.max()
    margin = 0.02 * (high - low)
    return np.asarray(
        centre + (np.clip(centre @ normal, low + margin, high - margin) - centre @ normal) * normal
    )


def _shot(build: Callable[["pv.Plotter"], None], alt: str, from_above: bool = True) -> Picture:
    import pyvista as pv

    plotter = _plotter()
    plotter.suppress_rendering = True  # until all is added
    plotter.clear_actors()
    plotter.remove_all_lights()
    for position, intensity in (((1, -2, 3), 0.7), ((-3, -2, 1), 0.42), ((3, -1, 0.5), 0.3)):
        right, back, up = position
        light = pv.Light(
            position=(right, back, up if from_above else -up), intensity=intensity, light_type="scene light"
        )
        light.positional = False
        plotter.add_light(light)
    build(plotter)
    plotter.suppress_rendering = False
    plotter.render()
    pixels = plotter.screenshot(None, transparent_background=True, return_img=True)
    return encode(np.asarray(pixels, dtype=np.uint8), alt)


@cache
def _plotter() -> "pv.Plotter":
    """The same for all pictures: a new one costs as much as the drawing."""
    import pyvista as pv

    plotter = pv.Plotter(off_screen=True, window_size=list(_SIZE), lighting="none")
    plotter.enable_anti_aliasing("ssaa")
    return plotter


def _unit(vector: Array) -> Array:
    return vector / np.linalg.norm(vector)
