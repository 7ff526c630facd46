"""2D pictures with matplotlib."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from softprint.runtime.drawing.colours import BODY, COLLIDER, EDGES
from softprint.runtime.drawing.scale import error_map
from softprint.runtime.drawing.scene import Scene
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import atomic_path

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH, _DPI = 7.0, 160  # inches, dots an inch


def draw_flat(path: Path, scene: Scene) -> None:
    """Draw a 2D scene; SoftprintError if matplotlib is not installed."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.collections import LineCollection
        from matplotlib.figure import Figure
    except ImportError as error:
        raise SoftprintError("a picture needs matplotlib: pip install 'softprint[report]'") from error
    figure = Figure(figsize=(_WIDTH, 0.75 * _WIDTH), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    _fill(figure, axes, scene)
    axes.add_collection(LineCollection(list(scene.points[scene.facets]), colors=EDGES, linewidths=1.2))
    for vertices, segments in scene.solids:
        axes.add_collection(LineCollection(list(vertices[segments]), colors=COLLIDER, linewidths=1.8))
    for mark in scene.marks:
        few = len(mark.nodes) < 60
        across, up = scene.points[mark.nodes].T
        axes.scatter(across, up, s=34 if few else 9, color=mark.colour, label=mark.name, zorder=3)
    if scene.marks:
        figure.legend(loc="outside lower center", ncols=4, frameon=False, markerscale=1.5)
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.margins(0.05)
    axes.set_title(scene.title, fontsize=11)
    axes.set_xlabel("m")
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png", facecolor="white")


def _fill(figure: Figure, axes: Axes, scene: Scene) -> None:
    """The inside: coloured by the values, or plain with the mesh's edges."""
    from matplotlib.collections import PolyCollection
    from matplotlib.tri import Triangulation

    if scene.cells is None:
        return
    if scene.values is None:
        width = 0.25 if scene.edges else 0.0
        corners = list(scene.points[scene.cells])
        axes.add_collection(PolyCollection(corners, facecolors=BODY, edgecolors=EDGES, linewidths=width))
        return
    triangles = Triangulation(scene.points[:, 0], scene.points[:, 1], scene.cells)
    colours = error_map()
    top = max(float(np.max(scene.values)), np.finfo(float).tiny)
    filled = axes.tripcolor(triangles, scene.values, shading="gouraud", cmap=colours, vmin=0.0, vmax=top)
    bar = figure.colorbar(filled, ax=axes, shrink=0.8, label=scene.label)
    bar.ax.tick_params(labelsize=8)
