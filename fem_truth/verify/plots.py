"""The plots of a case: one drawing with its curves side by side, in the style of the report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from softprint.fem_truth.report.drawing.figures import RC, to_svg
from softprint.fem_truth.report.drawing.style import INK, paint
from softprint.fem_truth.verify.case import Curve

# Okabe and Ito's colours and lighter tints of them for dark pages, as in `fem_truth.report.drawing.style`.
_COLOURS = (
    ("#d2500a", "#ff8b4d"),
    ("#0072b2", "#56b4e9"),
    ("#00805d", "#2fc79a"),
    ("#a3487f", "#e39ac6"),
    ("#b57b00", "#f0b93a"),
    ("#5b4bb5", "#a79cf0"),
)
_MARKERS = "osD^vP"
_COLUMNS = 2


def colour_variables() -> str:
    """The CSS that defines the colours of `draw` on light and dark pages and in print."""
    light = "".join(f"--v-{i}:{pair[0]};" for i, pair in enumerate(_COLOURS))
    dark = "".join(f"--v-{i}:{pair[1]};" for i, pair in enumerate(_COLOURS))
    return (
        f":root {{ {light} }}\n@media (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}\n"
        f"@media print {{ :root {{ {light} }} }}"
    )


def draw(name: str, curves: Sequence[Curve]) -> str:
    """SVG text of the curves, two per row."""
    columns = min(_COLUMNS, len(curves))
    rows = -(-len(curves) // columns)
    with plt.rc_context({**RC, "axes.grid.axis": "both", "font.size": 8.5}):
        size = (4.3 * columns if columns > 1 else 5.2, 3.3 * rows)
        figure, grid = plt.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False)
        for axes in grid.flat[len(curves) :]:
            axes.set_axis_off()
        for axes, curve in zip(grid.flat, curves):
            _draw_curve(axes, curve)
        return to_svg(figure, name, {paint(i): f"--v-{i}" for i in range(len(_COLOURS))})


def _draw_curve(axes: Axes, curve: Curve) -> None:
    colour = 0
    for line in curve.lines:
        if line.style == "reference":
            axes.plot(line.x, line.y, color=INK, linestyle=(0, (4, 3)), linewidth=1.0, label=line.label)
            continue
        look: dict[str, Any] = {"color": paint(colour % len(_COLOURS)), "label": line.label}
        marker = _MARKERS[colour % len(_MARKERS)]
        if line.style == "curve":
            axes.plot(line.x, line.y, **look)
        else:
            joined = "-" if line.style == "measured" else "none"
            axes.plot(line.x, line.y, linestyle=joined, marker=marker, markersize=4.5, **look)
        colour += 1
    if curve.log:
        axes.set_xscale("log")
        axes.set_yscale("log")
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            if high < 100 * low:  # less than two decades: also label some digits between powers of ten
                axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
                axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
    axes.set_title(curve.title)
    axes.set_xlabel(curve.x_label)
    axes.set_ylabel(curve.y_label)
    axes.legend(frameon=False, fontsize=7.5, labelcolor=INK)
