"""Time series of tactile measurements: a table (CSV), arrays (HDF5) and a picture (PNG).

The table has a header with the names and units of its columns, and one line for each frame. The arrays for k places and
F frames, in SI units (attribute ``unit`` of each):

    times (F,)   position, traction (F, k, dim)   pressure, strain_norm (F, k)   green_strain (F, k, dim, dim)
    names (k,)   rest (k, dim)   areas (k,)
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import atomic_path, create_softprint_h5, fixed_text
from softprint.runtime.touch.places import TouchPlaces
from softprint.runtime.touch.sensor import Touch

KIND = "touch"
VERSION = 1
_UNITS = {"position": "m", "pressure": "Pa", "traction": "Pa", "green_strain": "1", "strain_norm": "1"}
_AXES = "xyz"


def columns(places: TouchPlaces, series: Sequence[Touch]) -> dict[str, Array]:
    """The table, column by column: (F,) by "place.quantity [unit]", time first."""
    table = {"time [s]": np.array([touch.time for touch in series])}
    for k, name in enumerate(places.names):
        for quantity, unit in _UNITS.items():
            values = np.array([getattr(touch, quantity)[k] for touch in series])
            flat = values.reshape(len(series), -1)
            for number, index in enumerate(np.ndindex(values.shape[1:])):
                if list(index) != sorted(index):  # the lower half of a symmetric tensor
                    continue
                component = "".join(_AXES[axis] for axis in index)
                table[f"{name}.{quantity}{component and '_'}{component} [{unit}]"] = flat[:, number]
    return table


def write_table(path: Path, places: TouchPlaces, series: Sequence[Touch]) -> None:
    """Write the CSV, atomically, with numbers in full precision."""
    table = columns(places, series)
    with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(table)
        writer.writerows(zip(*(column.tolist() for column in table.values()), strict=True))


def write_arrays(path: Path, places: TouchPlaces, series: Sequence[Touch], **texts: str) -> None:
    """Write the HDF5 file, atomically, in float32; texts: for its attributes."""
    with create_softprint_h5(path, KIND, VERSION) as file:
        for name, text in texts.items():
            file.attrs[name] = fixed_text(text)
        measured = {quantity: np.array([getattr(touch, quantity) for touch in series]) for quantity in _UNITS}
        for quantity, values in measured.items():
            _put(file, quantity, values.astype(np.float32), _UNITS[quantity])
        _put(file, "times", np.array([touch.time for touch in series]), "s")
        _put(file, "rest", places.rest, "m")
        _put(file, "areas", places.areas, "m" if places.rest.shape[1] == 2 else "m^2")
        file.create_dataset("names", data=np.array([name.encode() for name in places.names]), fletcher32=True)


def _put(file: h5py.File, name: str, values: NDArray[Any], unit: str) -> None:
    dataset = file.create_dataset(name, data=values, compression="gzip", shuffle=True, fletcher32=True)
    dataset.attrs["unit"] = fixed_text(unit)


def draw_series(path: Path, title: str, places: TouchPlaces, series: Sequence[Touch]) -> None:
    """Draw pressure, shear traction and strain of each place over time; SoftprintError without matplotlib."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise SoftprintError("a picture needs matplotlib: pip install 'softprint[report]'") from error
    figure = Figure(figsize=(8.0, 7.0), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    times = [touch.time for touch in series]
    pressure = np.array([touch.pressure for touch in series])
    traction = np.array([np.linalg.norm(touch.traction, axis=1) for touch in series])
    norm = np.array([touch.strain_norm for touch in series])
    panels = {"contact pressure [Pa]": pressure, "traction [Pa]": traction, "|Green strain| [1]": norm}
    for axes, (label, values) in zip(
        figure.subplots(len(panels), 1, sharex=True), panels.items(), strict=True
    ):
        axes.plot(times, values, linewidth=1.5)
        axes.set_ylabel(label)
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    axes.set_xlabel("time [s]")
    figure.legend(places.names, loc="outside lower center", ncols=6, frameon=False)
    figure.suptitle(title, fontsize=11)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png", facecolor="white")
