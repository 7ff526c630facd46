"""Time series of what a tactile camera sees: arrays (HDF5) and a picture (PNG).

For F frames, in SI units (attribute ``unit`` of each), in the frame of the side that is seen (`pad_side.py`):

    times (F,)   markers (F, n, dim)   depth (F, rows, columns), in 2D (F, columns)
    force (F, dim)   torque (F, 3), in 2D (F, 1)
    places (n, dim-1)   field (dim-1,)   axes (dim, dim)   origin (dim,)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import atomic_path, create_softprint_h5, fixed_text
from softprint.runtime.touch.tactile_camera import TactileCamera, TactileImage

KIND = "tactile"
VERSION = 1
_MILLIMETRES = 1e3
_UNITS = {"markers": "m", "depth": "m", "force": "N", "torque": "N m"}
# Displacements of markers are drawn longer, so that the longest is about as long as this share of their distance.
_LONGEST = 1.0


def write_images(path: Path, camera: TactileCamera, series: Sequence[TactileImage], **texts: str) -> None:
    """Write the HDF5 file, atomically, in float32; texts: for its attributes."""
    with create_softprint_h5(path, KIND, VERSION) as file:
        for name, text in texts.items():
            file.attrs[name] = fixed_text(text)
        seen = {name: np.array([getattr(image, name) for image in series], np.float32) for name in _UNITS}
        fixed = {"places": camera.places, "field": camera.field, "origin": camera.side.origin}
        axes = {"axes": camera.side.axes}
        times = {"times": np.array([image.time for image in series])}
        for values, unit in ((times, "s"), (seen, ""), (fixed, "m"), (axes, "1")):
            for name, array in values.items():
                dataset = file.create_dataset(
                    name, data=array, compression="gzip", shuffle=True, fletcher32=True
                )
                dataset.attrs["unit"] = fixed_text(_UNITS.get(name, unit))


def draw_images(
    path: Path, title: str, camera: TactileCamera, series: Mapping[str, Sequence[TactileImage]]
) -> None:
    """Draw the frame of the largest force, of the first model, as every model sees it, side by side: the depth image,
    with the displacement of the markers in the plane as arrows; below, force over time. series: by the names of models,
    of the same frames. Raises SoftprintError without matplotlib."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise SoftprintError("a picture needs matplotlib: pip install 'softprint[report]'") from error
    first = next(iter(series.values()))
    frame = int(np.argmax([np.linalg.norm(image.force) for image in first]))
    seen = {name: images[frame] for name, images in series.items()}
    deepest = max(float(np.nanmax(image.depth)) for image in seen.values())
    figure = Figure(figsize=(0.8 + 4.6 * len(seen), 6.4), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    parts: Any = figure.subfigures(2, 1, height_ratios=[2.2, 1.0])
    above, below = parts
    panels = above.subplots(1, len(seen), squeeze=False)[0]
    scale = _arrow_scale(camera, list(seen.values()))
    for axes, (name, image) in zip(panels, seen.items(), strict=True):
        drawn = _draw_image(axes, camera, image, max(deepest, 1e-6), scale)
        axes.set_title(f"{name}: {np.linalg.norm(image.force):.3f} N", fontsize=10)
    above.colorbar(drawn, ax=panels.tolist(), label="depth [mm]", shrink=0.8)
    _draw_forces(below.subplots(), series, first[frame].time)
    figure.suptitle(
        f"{title}, {first[frame].time:.2f} s; displacement of markers, {scale:.3g} times as long", fontsize=11
    )
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png", facecolor="white")


def _arrow_scale(camera: TactileCamera, images: Sequence[TactileImage]) -> float:
    """How many times as long arrows are drawn."""
    plane = camera.places.shape[1]
    spacing = float(np.prod(camera.field) / len(camera.places)) ** (1.0 / plane)
    longest = max(float(np.linalg.norm(image.markers[:, :plane], axis=1).max()) for image in images)
    return _LONGEST * spacing / longest if longest > 1e-9 else 1.0


def _draw_image(axes: Any, camera: TactileCamera, image: TactileImage, deepest: float, scale: float) -> Any:
    """One panel; returns what a scale of colours belongs to."""
    places = _MILLIMETRES * camera.places
    width, height = _MILLIMETRES * np.append(camera.field, camera.field)[:2]
    if image.depth.ndim == 1:  # in 2D, a strip
        height, places = 0.1 * width, np.column_stack([places, np.zeros(len(places))])
    arrows = _MILLIMETRES * scale * _in_plane(image.markers)
    drawn = axes.imshow(
        _MILLIMETRES * np.atleast_2d(image.depth),
        extent=(-0.5 * width, 0.5 * width, -0.5 * height, 0.5 * height),
        cmap="magma",
        vmin=-0.1 * _MILLIMETRES * deepest,
        vmax=_MILLIMETRES * deepest,
        interpolation="nearest",
    )
    axes.plot(*places.T, ".", color="#9fd8ff", markersize=2.5)
    axes.quiver(*places.T, *arrows.T, angles="xy", scale_units="xy", scale=1.0, color="#4fc3f7", width=0.004)
    axes.set_xlabel("mm")
    return drawn


def _in_plane(markers: Array) -> Array:
    """(n, 2) displacements to draw."""
    return np.column_stack(
        [markers[:, 0], markers[:, 1] if markers.shape[1] == 3 else np.zeros(len(markers))]
    )


def _draw_forces(axes: Any, series: Mapping[str, Sequence[TactileImage]], at: float) -> None:
    for name, images in series.items():
        forces = [float(np.linalg.norm(image.force)) for image in images]
        axes.plot([image.time for image in images], forces, linewidth=1.5, label=name)
    axes.axvline(at, color="grey", linewidth=0.8, linestyle=":")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("force [N]")
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
