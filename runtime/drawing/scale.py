"""The scale of colours below a 3D picture, drawn by matplotlib.

Not by VTK's own scalar bar: it formats its numbers with std::regex, whose code clashes with that of the libraries that
DOLFINx loads, and ends the process.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.drawing.colours import ERROR_COLOURS

Pixels = NDArray[np.uint8]

_HEIGHT = 0.14  # of the picture
_DPI = 100
_TICKS = 5
_INK = "#1b1b1f"


def error_map() -> Any:
    """The colour map of values on surfaces, for matplotlib and PyVista."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("error", ERROR_COLOURS)


def add_scale(pixels: Pixels, label: str, top: float) -> Pixels:
    """A picture (height, width, 3) with the scale from 0 to top at its lower edge."""
    height, width = pixels.shape[:2]
    strip = _strip(label, max(top, float(np.finfo(float).tiny)), width, max(1, round(_HEIGHT * height)), height)
    return np.concatenate([pixels[: height - len(strip)], strip])


@lru_cache(maxsize=4)  # the same for all frames of a film
def _strip(label: str, top: float, width: int, height: int, picture: int) -> Pixels:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width / _DPI, height / _DPI), dpi=_DPI, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    points = 72.0 / _DPI * picture  # the height of the picture, in units of type
    axes = figure.add_axes((0.25, 0.34, 0.5, 0.2))
    bar = figure.colorbar(ScalarMappable(Normalize(0.0, top), error_map()), cax=axes, orientation="horizontal")
    ticks = np.linspace(0.0, top, _TICKS)
    bar.set_ticks(list(ticks), labels=[f"{tick:.2g}" for tick in ticks])
    bar.outline.set_visible(False)
    axes.tick_params(labelsize=0.028 * points, length=0, pad=0.006 * points, labelcolor=_INK)
    axes.set_title(label, fontsize=0.031 * points, color=_INK, pad=0.012 * points)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[:height, :width, :3].copy()
