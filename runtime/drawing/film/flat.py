"""Frames of a body in 2D with matplotlib."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.drawing.colours import BODY, COLLIDER, EDGES, rgb
from softprint.runtime.drawing.film.subject import Subject
from softprint.runtime.drawing.scale import error_map
from softprint.runtime.errors import SoftprintError

if TYPE_CHECKING:
    from matplotlib.collections import Collection

_TINY = float(np.finfo(float).tiny)
_DPI = 100
_MARGIN = 0.04  # of the picture's extent, around all that is seen


class FlatStage:
    """A figure that draws one frame after the other. A context manager, as `SolidStage`."""

    def __init__(self, subject: Subject, size: tuple[int, int]) -> None:
        try:
            from matplotlib.backends.backend_agg import FigureCanvasAgg
            from matplotlib.cm import ScalarMappable
            from matplotlib.collections import LineCollection, PolyCollection
            from matplotlib.colors import Normalize
            from matplotlib.figure import Figure
        except ImportError as error:
            raise SoftprintError("a picture needs matplotlib: pip install 'softprint[report]'") from error
        self._subject = subject
        figure = Figure(figsize=(size[0] / _DPI, size[1] / _DPI), dpi=_DPI, layout="constrained")
        self._canvas = FigureCanvasAgg(figure)
        axes = figure.add_subplot()
        self._axes = axes
        self._fill: Collection | None = None
        if subject.label is not None:
            self._shades = error_map()
            self._scale = Normalize(0.0, max(subject.top, _TINY))
            bar = figure.colorbar(
                ScalarMappable(self._scale, self._shades), ax=axes, shrink=0.8, label=subject.label
            )
            bar.ax.tick_params(labelsize=8)
        self._outline = LineCollection([], colors=EDGES, linewidths=1.3)
        self._solids = {
            name: PolyCollection([], facecolors=COLLIDER, edgecolors=COLLIDER, linewidths=1.6, alpha=0.55)
            for name in subject.solids
        }
        for collection in (self._outline, *self._solids.values()):
            axes.add_collection(collection)
        lower, upper = subject.seen.min(axis=0), subject.seen.max(axis=0)
        room = _MARGIN * float((upper - lower).max())
        axes.set_xlim(lower[0] - room, upper[0] + room)
        axes.set_ylim(lower[1] - room, upper[1] + room)
        axes.set_aspect("equal")
        axes.set_axis_off()

    def draw(
        self, positions: Array, poses: Mapping[str, RigidPose], values: Array | None = None
    ) -> NDArray[np.uint8]:
        """(height, width, 3) pixels: the body at positions (n_nodes, 2), coloured by values (n_nodes,)."""
        points = positions[self._subject.nodes]
        if self._fill is not None:
            self._fill.remove()
        self._fill = self._filling(points, values)
        self._outline.set_segments(list(points[self._subject.outline]))
        for name, pose in poses.items():
            _, vertices, segments = self._subject.solids[name]
            self._solids[name].set_verts(_loops(pose.apply(vertices), segments))
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def _filling(self, points: Array, values: Array | None) -> Collection:
        """The inside: coloured by the values, or plain with the mesh's edges."""
        from matplotlib.collections import PolyCollection

        triangles = self._subject.triangles
        if values is None:
            edges = (*rgb(EDGES), 0.25)
            plain = PolyCollection(
                list(points[triangles]), linewidths=0.3, facecolors=BODY, edgecolors=[edges]
            )
            self._axes.add_collection(plain)
            return plain
        return self._axes.tripcolor(
            points[:, 0],
            points[:, 1],
            triangles,
            values,
            shading="gouraud",
            cmap=self._shades,
            norm=self._scale,
            zorder=0.5,
        )

    def __enter__(self) -> FlatStage:
        return self

    def __exit__(self, *exception: object) -> None:
        """A figure that is not shown holds nothing that has to be closed."""


def _loops(points: Array, segments: NDArray[np.int64]) -> list[Array]:
    """The closed outlines (n, 2) that the segments (m, 2) form, each followed from one of its vertices."""
    after = dict(segments.tolist())
    loops = []
    while after:
        start, at = after.popitem()
        loop = [start]
        while at != start and at in after:
            loop.append(at)
            at = after.pop(at)
        loops.append(points[loop])
    return loops
