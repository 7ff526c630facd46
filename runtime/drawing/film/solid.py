"""Frames of a body in 3D with PyVista."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.drawing.colours import BODY, COLLIDER, EDGES
from softprint.runtime.drawing.film.rest_grid import RestGrid
from softprint.runtime.drawing.film.section import Section
from softprint.runtime.drawing.film.subject import Subject
from softprint.runtime.drawing.scale import add_scale, error_map
from softprint.runtime.drawing.shading import Shading
from softprint.runtime.drawing.solid import frame_all, lit_plotter, view_direction

if TYPE_CHECKING:
    import pyvista as pv

_LIFT = 2e-3  # of the body's size: lines lie this far in front of the surface


class SolidStage:
    """A window that draws one frame after the other. Close it: it is a context manager."""

    def __init__(self, subject: Subject, size: tuple[int, int]) -> None:
        rest = subject.mesh.points[subject.nodes]
        self._nodes = subject.nodes
        self._shading = Shading.of(rest, subject.triangles)
        self._grid = RestGrid.of(rest, subject.triangles)
        direction = view_direction(rest, [middle for middle, _, _ in subject.solids.values()])
        self._towards = _LIFT * subject.mesh.size * direction
        self._plotter = lit_plotter(size, direction)
        self._scale = None if subject.label is None else (subject.label, subject.top)
        self._skin = _surface(rest[self._shading.vertex], self._shading.triangles)
        skin = self._add_skin(subject)
        self._lines = _segments(self._grid.points(rest))
        lines = self._plotter.add_mesh(self._lines, color=EDGES, line_width=1.2, opacity=0.35, lighting=False)
        self._solids = {
            name: self._add_solid(vertices, facets) for name, (_, vertices, facets) in subject.solids.items()
        }
        self._section: Section | None = None
        if subject.cut is not None:
            self._section = Section(self._plotter, subject.mesh, subject.cut, direction)
            for actor in (skin, lines):  # colliders are half transparent, and stay whole
                self._section.clip(actor)
        frame_all(self._plotter, subject.seen, direction, has_scale=subject.label is not None)
        self._plotter.enable_anti_aliasing("ssaa")

    def _add_solid(self, vertices: Array, facets: IntArray) -> Any:
        shading = Shading.of(vertices, facets)
        solid = _surface(vertices[shading.vertex], shading.triangles)
        solid.point_data.active_normals = shading.normals(vertices)
        return self._plotter.add_mesh(
            solid,
            color=COLLIDER,
            opacity=0.5,
            smooth_shading=True,
            specular=0.5,
            specular_power=25,
            culling="back",
        )

    def _add_skin(self, subject: Subject) -> Any:
        if subject.label is None:
            return self._plotter.add_mesh(
                self._skin,
                color=BODY,
                smooth_shading=True,
                ambient=0.3,
                diffuse=0.85,
                specular=0.3,
                specular_power=25,
            )
        self._skin["values"] = np.zeros(self._skin.n_points)
        return self._plotter.add_mesh(
            self._skin,
            scalars="values",
            cmap=error_map(),
            clim=(0.0, max(subject.top, np.finfo(float).tiny)),
            smooth_shading=True,
            ambient=0.45,
            diffuse=0.6,
            show_scalar_bar=False,
        )

    def draw(
        self, positions: Array, poses: Mapping[str, RigidPose], values: Array | None = None
    ) -> NDArray[np.uint8]:
        """(height, width, 3) pixels: the body at positions (n_nodes, 3), its surface coloured by values (s,)."""
        points = positions[self._nodes]
        self._skin.points = points[self._shading.vertex]
        self._skin.point_data.active_normals = self._shading.normals(points)
        if values is not None:
            self._skin["values"] = values[self._shading.vertex]
        self._lines.points = self._grid.points(points) + self._towards
        for name, pose in poses.items():
            self._solids[name].user_matrix = pose.matrix
        if self._section is not None:
            self._section.move(positions)
        self._plotter.render()
        pixels = np.asarray(self._plotter.screenshot(return_img=True))[..., :3]
        return pixels if self._scale is None else add_scale(pixels, *self._scale)

    def __enter__(self) -> SolidStage:
        return self

    def __exit__(self, *exception: object) -> None:
        self._plotter.close()


def _surface(points: Array, triangles: IntArray) -> pv.PolyData:
    import pyvista as pv

    return pv.PolyData.from_regular_faces(np.array(points, dtype=float), triangles)


def _segments(ends: Array) -> pv.PolyData:
    """Lines between each two of the ends (2m, 3)."""
    import pyvista as pv

    index = np.arange(len(ends)).reshape(-1, 2)
    return pv.PolyData(ends, lines=np.insert(index, 0, 2, axis=1).ravel())
