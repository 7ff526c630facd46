"""One page of figures 6.3 to 6.7 of the thesis as plots, from what the benchmarks left in a run directory.

python -m benchmarks.thesis6_plots RUN FILE.png
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from fem_truth.report.learning import read_json
from runtime.errors import SoftprintError
from runtime.files import atomic_path

NEEDED = {
    "bench_thesis6_ablation.json": "thesis6_ablation",
    "thesis6_figures.json": "thesis6_figures",
    "descriptor_ways.json": "descriptor_ways",
}
DIRECT, RANDOM, CORNERS, MIXED, SHIPS = "#3b6ea5", "#c0504d", "#7f6084", "#d08a3e", "#4f8f5b"
SHORT = {"half of the samples": "half", "the centre alone": "centre"}


def draw(run: Path, picture: Path) -> None:
    """Five panels, one a figure of the thesis."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    for file, maker in NEEDED.items():
        if not (run / file).is_file():
            raise SoftprintError(f"{run / file} is not there: run benchmarks.{maker} first")
    table, figures, ways = (read_json(run / file) for file in NEEDED)
    rows = {row["variant"]: row for row in table["rows"]}
    by_way = {row["way"]: row for row in ways}
    figure, axes = plt.subplots(2, 3, figsize=(11, 6), layout="constrained")
    panels = axes.ravel()
    _jumps(panels[0], figures["jump"])
    _bars(panels[1], rows, ("thesis6", "no consistency"), "tangents", "6.4: tangent frames disagree [%]")
    _traces(panels[2], by_way)
    _bars(
        panels[3],
        rows,
        ("thesis6", "half of the samples", "the centre alone"),
        "testing",
        "6.6: squared error, unseen shapes [%]",
    )
    _void(panels[4], figures["void"])
    _cost(panels[5], by_way)
    with atomic_path(picture) as temporary:
        figure.savefig(temporary, dpi=90, format="png")


def _jumps(panel: Any, jump: dict[str, list[float]]) -> None:
    """Share of paths that flicker more than so much."""
    for name, values in jump.items():
        x = np.sort(values)
        panel.step(x, 1.0 - np.arange(len(x)) / len(x), where="post", label=name)
    panel.set_xlabel("flicker along a path")
    panel.set_ylabel("share of paths above")
    panel.set_title("6.3: raw or smoothed normal", fontsize=10)
    panel.legend(fontsize=7)


def _bars(
    panel: Any, rows: dict[str, dict[str, float]], names: tuple[str, ...], column: str, title: str
) -> None:
    """Means, and half of what seeds are apart."""
    heights = [100 * rows[name][column] for name in names]
    spread = [50 * rows[name][f"{column}, spread"] for name in names]
    panel.bar(range(len(names)), heights, yerr=spread, color=DIRECT, width=0.6, capsize=4)
    panel.set_xticks(range(len(names)), [SHORT.get(name, name) for name in names], fontsize=8)
    panel.set_title(title, fontsize=10)


def _void(panel: Any, void: dict[str, list[list[float]]]) -> None:
    """At both depths, side by side; a point a seed."""
    names = list(void)
    for side, (depth, colour) in enumerate((("1 mm deep", DIRECT), ("3 mm", MIXED))):
        at = np.arange(len(names)) + 0.36 * side - 0.18
        panel.bar(
            at, [100 * np.mean(void[name], axis=0)[side] for name in names], 0.34, color=colour, label=depth
        )
        for x, name in zip(at, names, strict=True):
            panel.plot([x] * len(void[name]), [100 * row[side] for row in void[name]], "k.", markersize=4)
    panel.set_xticks(range(len(names)), [SHORT.get(name, name) for name in names], fontsize=8)
    panel.set_title("6.6: what a void behind changes [%]", fontsize=10)
    panel.legend(fontsize=7)


def _traces(panel: Any, ways: dict[str, dict[str, Any]]) -> None:
    """How one node moves while the collider goes slowly by."""
    random, direct = ways["direct, random tangents"]["trace"], ways["direct, one bias (thesis)"]["trace"]
    steps = 0.02 * np.arange(len(direct))
    panel.plot(steps, random, color=RANDOM, linewidth=0.8, label="random tangents")
    panel.plot(steps, direct, color=DIRECT, label="biased")
    panel.set_xlabel("collider moved [mm]")
    panel.set_title("6.5: one node's way [mm]", fontsize=10)
    panel.legend(fontsize=7)


def _cost(panel: Any, ways: dict[str, dict[str, Any]]) -> None:
    """Flicker over the network's work."""
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
    panel.set_xlabel("network, MFLOP a point")
    panel.set_title("6.7: flicker (triangles: where frames turn)", fontsize=10)
    panel.legend(fontsize=7)


if __name__ == "__main__":
    draw(Path(sys.argv[1]), Path(sys.argv[2]))
