"""Pictures drawn with matplotlib alone: for two-dimensional bodies, and for three-dimensional ones if GL is
missing."""

import io

import matplotlib

matplotlib.use("Agg")  # before pyplot: reports are made where there is no display
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import LinearSegmentedColormap, to_rgb
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation
from PIL import Image

from softprint.fem_truth.report.drawing.picture import Picture, encode
from softprint.runtime.arrays import Array
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.drawing.colours import BODY, COLLIDER, ERROR_COLOURS
from softprint.runtime.mesh import Mesh

_INCHES, _DPI = (4.25, 3.25), 160
_PIXELS = 260  # across the picture, for the collider's outline
_GRID_LINES = 14
# View directions, from the body towards the camera: from above, and from below if the collider is below.
VIEWS = {True: np.array([0.32, -1.0, 0.66]), False: np.array([0.32, -1.0, -0.5])}
_HEAT = LinearSegmentedColormap.from_list("error", ERROR_COLOURS)


class FlatRenderer:
    """Drawings of one body and one collider from one direction, in orthographic projection; a `Renderer`."""

    def __init__(
        self,
        mesh: Mesh,
        collider: Collider,
        description: str,
        from_above: bool = True,
        corners: Array | None = None,
    ) -> None:
        """corners: (k, dim) places that have to be in the picture, besides the undeformed body."""
        self.mesh, self.collider, self.description = mesh, collider, description
        # Columns: right, up, and (in 3D) towards the camera. In 2D the drawing shows the plane itself.
        self._axes = np.eye(2) if mesh.dim == 2 else _camera_axes(VIEWS[from_above])
        places = mesh.points if corners is None else np.concatenate([mesh.points, corners])
        rest = places @ self._axes[:, :2]
        self._centre = 0.5 * (rest.min(axis=0) + rest.max(axis=0))
        self._half = (0.68 if mesh.dim == 2 else 0.9) * float(np.ptp(rest, axis=0).max())

    def outside(self, positions: Array, pose: RigidPose, alt: str) -> Picture:
        figure, axes = self._blank(self._centre, self._half)
        self._draw_body(axes, positions)
        self._draw_collider(axes, pose, self._centre, self._half)
        return _finish(figure, alt)

    def cut(self, positions: Array, pose: RigidPose, centre: Array, alt: str) -> Picture | None:
        if self.mesh.dim == 3:
            return None
        half = 0.5 * self._half
        figure, axes = self._blank(centre, half)
        self._draw_body(axes, positions)
        self._draw_collider(axes, pose, centre, half)
        return _finish(figure, alt)

    def heat(self, positions: Array, values: Array, limit: float, alt: str) -> Picture:
        figure, axes = self._blank(self._centre, self._half)
        if self.mesh.dim == 2:
            triangles = Triangulation(positions[:, 0], positions[:, 1], self.mesh.cells)
            axes.tripcolor(triangles, values, shading="gouraud", cmap=_HEAT, vmin=0.0, vmax=limit)
            self._draw_edge(axes, positions)
        else:
            shares = np.clip(values[self.mesh.facets].mean(axis=1) / limit, 0.0, 1.0)
            self._draw_skin(axes, positions, _HEAT(shares)[:, :3], ambient=0.6)
        return _finish(figure, alt)

    def _blank(self, centre: Array, half: float) -> tuple[Figure, Axes]:
        figure = plt.figure(figsize=_INCHES, dpi=_DPI)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        aspect = _INCHES[1] / _INCHES[0]
        axes.set(
            xlim=centre[0] + half * np.array([-1, 1]), ylim=centre[1] + aspect * half * np.array([-1, 1])
        )
        axes.set_axis_off()
        return figure, axes

    def _draw_body(self, axes: Axes, positions: Array) -> None:
        if self.mesh.dim == 3:
            self._draw_skin(axes, positions, np.tile(to_rgb(BODY), (len(self.mesh.facets), 1)), ambient=0.35)
            return
        corners = positions[self.mesh.cells]
        axes.add_collection(PolyCollection(list(corners), facecolors=BODY, edgecolors=BODY, linewidths=0.4))
        triangles = Triangulation(positions[:, 0], positions[:, 1], self.mesh.cells)
        for axis in range(2):  # lines of constant rest position show the strain
            rest = self.mesh.points[:, axis]
            levels = np.arange(rest.min(), rest.max(), self.mesh.size / _GRID_LINES)[1:]
            axes.tricontour(
                triangles, rest, levels, colors="#8f412a", linewidths=0.6, linestyles="solid", alpha=0.45
            )
        self._draw_edge(axes, positions)

    def _draw_edge(self, axes: Axes, positions: Array) -> None:
        axes.add_collection(
            LineCollection(list(positions[self.mesh.facets]), colors="#7a3420", linewidths=1.3)
        )

    def _draw_skin(self, axes: Axes, positions: Array, colours: Array, ambient: float) -> None:
        """Boundary triangles from back to front, with Lambert shading; colours: (n_facets, 3)."""
        corners = positions[self.mesh.facets]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        order = np.argsort((corners @ self._axes[:, 2]).mean(axis=1))
        order = order[normals[order] @ self._axes[:, 2] > 0]
        light = np.clip(normals @ (np.array([1.0, -2.0, 3.0]) / np.sqrt(14.0)), 0.0, 1.0)
        shaded = np.clip(colours * (ambient + (1.0 - ambient) * light)[:, None], 0.0, 1.0)[order]
        flat = corners[order] @ self._axes[:, :2]
        axes.add_collection(PolyCollection(list(flat), facecolors=shaded, edgecolors=shaded, linewidths=0.3))

    def _draw_collider(self, axes: Axes, pose: RigidPose, centre: Array, half: float) -> None:
        """The collider's silhouette: the region where the smallest signed distance along the line of sight is
        negative."""
        across = centre[0] + half * np.linspace(-1, 1, _PIXELS)
        up = centre[1] + half * np.linspace(-1, 1, _PIXELS)
        x, y = np.meshgrid(across, up)
        plane = np.column_stack([x.ravel(), y.ravel()])
        if self.mesh.dim == 2:
            least = self.collider.sdf(pose.apply_inverse(plane))
        else:
            reach = 1.8 * self.collider.size
            middle = float(
                pose.apply(0.5 * (self.collider.lower + self.collider.upper)[None])[0] @ self._axes[:, 2]
            )
            least = np.full(len(plane), np.inf)
            for depth in middle + np.linspace(-reach, reach, 40):
                points = plane @ self._axes[:, :2].T + depth * self._axes[:, 2]
                least = np.minimum(least, self.collider.sdf(pose.apply_inverse(points)))
        field = least.reshape(x.shape)
        if field.min() < 0:
            axes.contourf(x, y, field, levels=[-np.inf, 0.0], colors=[COLLIDER], alpha=0.42)
            axes.contour(x, y, field, levels=[0.0], colors=["#26324a"], linewidths=1.4)


def _camera_axes(view: Array) -> Array:
    """Columns right, up and towards the camera, for a camera in direction `view` and z up."""
    towards = view / np.linalg.norm(view)
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(towards, right), towards])


def _finish(figure: Figure, alt: str) -> Picture:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_DPI, transparent=True)
    plt.close(figure)
    buffer.seek(0)
    return encode(np.asarray(Image.open(buffer).convert("RGBA")), alt)
