"""Figures 6.3 to 6.7 of the thesis as plots, from what reproduction/ left in a run directory."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")  # before pyplot: reports are made where there is no display
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from softprint.fem_truth.report.drawing.style import INK
from softprint.fem_truth.report.measurements.learning import read_json
from softprint.runtime.errors import SoftprintError

TABLE, FIGURES, WAYS = "bench_thesis6_ablation.json", "thesis6_figures.json", "descriptor_ways.json"
#: The files, and the modules of reproduction/ that write them.
NEEDED = {TABLE: "thesis6_ablation", FIGURES: "thesis6_figures", WAYS: "descriptor_ways"}
DIRECT, RANDOM, CORNERS, MIXED, SHIPS = "#3b6ea5", "#c0504d", "#7f6084", "#d08a3e", "#4f8f5b"
SHORT = {"half of the samples": "half", "the centre alone": "centre"}


def thesis6_figure(run: Path) -> Figure | None:
    """The panels for which the run has the files, three a row; None where it has none of them. Raises SoftprintError
    for a file that does not hold what its module writes."""
    known = {file: read_json(run / file) for file in NEEDED if (run / file).is_file()}
    shown = [(file, panel) for file, panel in _PANELS if file in known]
    if not shown:
        return None
    columns = min(3, len(shown))
    rows = -(-len(shown) // columns)
    figure, axes = plt.subplots(
        rows, columns, figsize=(11 * columns / 3, 3 * rows), layout="constrained", squeeze=False
    )
    for unused in axes.flat[len(shown) :]:
        unused.set_axis_off()
    for axis, (file, panel) in zip(axes.flat, shown, strict=False):
        try:
            panel(axis, known[file])
        except (KeyError, IndexError, TypeError, ValueError) as error:
            plt.close(figure)
            raise SoftprintError(
                f"{run / file}: not what reproduction.{NEEDED[file]} writes ({error!r}): make it again"
            ) from error
    return figure


def _jumps(panel: Any, figures: dict[str, Any]) -> None:
    """Share of paths with more flicker than a threshold."""
    for name, values in figures["jump"].items():
        x = np.sort(values)
        panel.step(x, 1.0 - np.arange(len(x)) / len(x), where="post", label=name)
    panel.set_xlabel("flicker along a path")
    panel.set_ylabel("share of paths above")
    panel.set_title("6.3: raw or smoothed normal", fontsize=10)
    panel.legend(fontsize=7)


def _bars(panel: Any, table: dict[str, Any], names: tuple[str, ...], column: str, title: str) -> None:
    """Means over seeds, with half of their range as error bars."""
    rows = {row["variant"]: row for row in table["rows"]}
    heights = [100 * rows[name][column] for name in names]
    spread = [50 * rows[name][f"{column}, spread"] for name in names]
    panel.bar(range(len(names)), heights, yerr=spread, color=DIRECT, width=0.6, capsize=4, ecolor=INK)
    panel.set_xticks(range(len(names)), [SHORT.get(name, name) for name in names], fontsize=8)
    panel.set_title(title, fontsize=10)


def _void(panel: Any, figures: dict[str, Any]) -> None:
    """Both depths side by side; one point per seed."""
    void: dict[str, list[list[float]]] = figures["void"]
    names = list(void)
    for side, (depth, colour) in enumerate((("1 mm deep", DIRECT), ("3 mm", MIXED))):
        at = np.arange(len(names)) + 0.36 * side - 0.18
        panel.bar(
            at, [100 * np.mean(void[name], axis=0)[side] for name in names], 0.34, color=colour, label=depth
        )
        for x, name in zip(at, names, strict=True):
            panel.plot(
                [x] * len(void[name]), [100 * row[side] for row in void[name]], ".", color=INK, markersize=4
            )
    panel.set_xticks(range(len(names)), [SHORT.get(name, name) for name in names], fontsize=8)
    panel.set_title("6.6: change by a void behind [%]", fontsize=10)
    panel.legend(fontsize=7)


def _traces(panel: Any, rows: list[dict[str, Any]]) -> None:
    """The path of one node while the collider moves slowly past it."""
    ways = {row["way"]: row for row in rows}
    random, direct = ways["direct, random tangents"]["trace"], ways["direct, one bias (thesis)"]["trace"]
    steps = 0.02 * np.arange(len(direct))
    panel.plot(steps, random, color=RANDOM, linewidth=0.8, label="random tangents")
    panel.plot(steps, direct, color=DIRECT, label="biased")
    panel.set_xlabel("collider moved [mm]")
    panel.set_title("6.5: path of one node [mm]", fontsize=10)
    panel.legend(fontsize=7)


def _cost(panel: Any, rows: list[dict[str, Any]]) -> None:
    """Flicker over the cost of the network."""
    ways = {row["way"]: row for row in rows}
    drawn = {
        "direct, two biases blended": DIRECT,
        "eight corners (thesis)": CORNERS,
        "descriptors interpolated": MIXED,
        "fields on grids (ships)": SHIPS,
    }
    for name, colour in drawn.items():
        row = ways[name]
        panel.plot(row["MFLOP"], row["flicker"], "o", color=colour, label=name)
        panel.plot(row["MFLOP"], row["turned"], "^", color=colour)
    panel.set_xlim(0.0, 1.8)
    panel.set_ylim(0.0, 0.2)
    panel.set_xlabel("network, MFLOP per point")
    panel.set_title("6.7: flicker (triangles: where frames rotate)", fontsize=10)
    panel.legend(fontsize=7)


# In the order of the thesis: the file that a panel needs, and the function that draws it.
_PANELS: tuple[tuple[str, Callable[[Any, Any], None]], ...] = (
    (FIGURES, _jumps),
    (
        TABLE,
        partial(
            _bars,
            names=("thesis6", "no consistency"),
            column="tangents",
            title="6.4: tangent frames disagree [%]",
        ),
    ),
    (WAYS, _traces),
    (
        TABLE,
        partial(
            _bars,
            names=("thesis6", "half of the samples", "the centre alone"),
            column="testing",
            title="6.6: squared error, unseen shapes [%]",
        ),
    ),
    (FIGURES, _void),
    (WAYS, _cost),
)
