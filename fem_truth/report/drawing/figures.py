"""The report's plots: matplotlib drawings as SVG text with the colours and fonts of the page."""

import io
import re
from collections.abc import Mapping, Sequence

import matplotlib

matplotlib.use("Agg")  # before pyplot: reports are made where there is no display
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from softprint.fem_truth.report.drawing.style import INK, PAPER, RULE, ModelStyle, paint
from softprint.runtime.arrays import Array

Values = Sequence[float] | Array

#: Style of all plots.
RC = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 9.0,
    "text.color": INK,
    "axes.edgecolor": RULE,
    "axes.labelcolor": INK,
    "axes.titlesize": 9.0,
    "axes.titlecolor": INK,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.spines.left": False,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "axes.axisbelow": True,
    "grid.color": RULE,
    "grid.linewidth": 0.6,
    "xtick.color": RULE,
    "ytick.color": RULE,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "ytick.major.size": 0.0,
    "lines.linewidth": 1.6,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
}


def to_svg(figure: Figure, name: str, colours: Mapping[str, str]) -> str:
    """The figure as inline SVG: no fixed size, ids made unique by `name`, placeholder colours as CSS variables.

    colours: placeholder hex colour -> CSS variable name (with its dashes).
    """
    buffer = io.StringIO()
    # A fixed date and salt: the same numbers give the same page, byte for byte.
    with plt.rc_context({"svg.hashsalt": name}):
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    plt.close(figure)
    svg = buffer.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r' xmlns(:\w+)?="[^"]*"', "", svg).replace("xlink:href", "href")
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = re.sub(r"url\(#", f"url(#{name}-", svg)
    svg = re.sub(r'href="#', f'href="#{name}-', svg)
    page_colours = {INK: "--ink-2", RULE: "--rule", PAPER: "--paper", **colours}
    for stand_in, variable in page_colours.items():
        svg = svg.replace(stand_in, f"var({variable})")
    return svg


def _model_colours(styles: Sequence[ModelStyle]) -> dict[str, str]:
    return {paint(i): style.variable for i, style in enumerate(styles)}


def over_time(
    name: str,
    times: Values,
    series: Mapping[str, Values],
    styles: Mapping[str, ModelStyle],
    ylabel: str,
    depth: Values | None = None,
    marks: Mapping[str, tuple[Values, Values]] | None = None,
) -> str:
    """Curves over time [s], one per model, with the depth of the contact [mm] as a thin strip below.

    series: model -> one value per time; marks: model -> (times, values) known at some times only (dots).
    """
    shown = [styles[key] for key in styles if key in series or key in (marks or {})]
    with plt.rc_context(RC):
        if depth is None:
            figure, axes = plt.subplots(figsize=(8.6, 3.0), layout="constrained")
            bottom = axes
        else:
            figure, (axes, bottom) = plt.subplots(
                2, 1, figsize=(8.6, 3.9), sharex=True, height_ratios=(4, 1), layout="constrained"
            )
            bottom.fill_between(times, depth, color=INK, alpha=0.35, linewidth=0)
            bottom.set_ylim(0, 1.15 * max(max(depth), 1e-9))
            bottom.set_ylabel("depth [mm]")
        for i, style in enumerate(shown):
            if style.key in series:
                axes.plot(times, series[style.key], color=paint(i), linestyle=style.dash)
            if marks and style.key in marks:
                axes.plot(*marks[style.key], "o", markersize=3.2, color=paint(i), markeredgewidth=0)
        axes.set_ylim(bottom=0)
        axes.set_ylabel(ylabel)
        bottom.set_xlabel("time [s]")
        axes.margins(x=0.01)
        return to_svg(figure, name, _model_colours(shown))


def phases(
    name: str, milliseconds: Mapping[str, Mapping[str, float]], styles: Mapping[str, ModelStyle]
) -> str:
    """Time of a step by phase: one horizontal bar per model, one tint per phase [ms]."""
    models = [key for key in styles if key in milliseconds]
    names = list(dict.fromkeys(phase for key in models for phase in milliseconds[key]))
    tints = np.linspace(1.0, 0.25, len(names))
    with plt.rc_context({**RC, "axes.grid.axis": "x"}):
        figure, axes = plt.subplots(figsize=(8.6, 0.75 + 0.48 * len(models)), layout="constrained")
        for row, key in enumerate(models):
            left = 0.0
            for phase, tint in zip(names, tints, strict=True):
                width = milliseconds[key].get(phase, 0.0)
                axes.barh(row, width, left=left, height=0.62, color=paint(row), alpha=tint, linewidth=0)
                left += width
            axes.text(left, row, f"  {left:.{3 if left < 1000 else 4}g} ms", va="center", ha="left")
        axes.set_yticks(range(len(models)), [styles[key].label for key in models])
        axes.invert_yaxis()
        axes.set_xlabel("milliseconds per step, mean")
        axes.margins(x=0.12)
        axes.set_xlim(left=0)
        return to_svg(figure, name, _model_colours([styles[key] for key in models]))


def loss_curves(
    name: str, histories: Mapping[str, Mapping[str, Sequence[float]]], styles: Mapping[str, ModelStyle]
) -> str:
    """Training loss (left, logarithmic) and error on held-out states (right) by optimiser step.

    histories: model -> columns `step`, `loss`, `validation_rms`.
    """
    shown = [styles[key] for key in styles if key in histories]
    with plt.rc_context(RC):
        figure, (left, right) = plt.subplots(1, 2, figsize=(8.6, 3.0), layout="constrained")
        for i, style in enumerate(shown):
            history = histories[style.key]
            look = {"color": paint(i), "linestyle": style.dash}
            left.plot(history["step"], history["loss"], **look)
            right.plot(history["step"], [100.0 * value for value in history["validation_rms"]], **look)
        left.set_yscale("log")
        left.set_title("training loss")
        right.set_title("error on held-out states [%]")
        right.set_ylim(bottom=0)
        for axes in (left, right):
            axes.set_xlabel("optimiser steps")
        return to_svg(figure, name, _model_colours(shown))


def by_shape(
    name: str,
    errors: Mapping[str, Mapping[str, float]],
    order: Sequence[str],
    styles: Mapping[str, ModelStyle],
) -> str:
    """Error of each shape, one dot per model, shapes from left to right in `order`; errors: model -> shape -> value."""
    shown = [styles[key] for key in styles if key in errors]
    with plt.rc_context(RC):
        figure, axes = plt.subplots(figsize=(8.6, 3.6), layout="constrained")
        for i, style in enumerate(shown):
            values = [100.0 * errors[style.key].get(shape, np.nan) for shape in order]
            axes.plot(range(len(order)), values, "o", markersize=5.0, color=paint(i), markeredgewidth=0)
        axes.set_xticks(range(len(order)), [shape.replace("_", " ") for shape in order], rotation=90)
        axes.set_ylabel("error [%]")
        axes.set_ylim(bottom=0)
        axes.margins(x=0.02)
        return to_svg(figure, name, _model_colours(shown))


def histograms(name: str, columns: Mapping[str, Values]) -> str:
    """Small histograms side by side, one per quality column (title -> values).

    Positive columns that span more than two decades are binned logarithmically.
    """
    with plt.rc_context(RC):
        rows = -(-len(columns) // 3)
        figure, grid = plt.subplots(
            rows, 3, figsize=(8.6, 1.95 * rows), layout="constrained", squeeze=False, sharey=False
        )
        for axes in grid.flat[len(columns) :]:
            axes.set_axis_off()
        for axes, (title, values) in zip(grid.flat, columns.items(), strict=False):
            _histogram(axes, title, np.asarray(values, dtype=float))
        return to_svg(figure, name, {})


def _histogram(axes: Axes, title: str, values: Array) -> None:
    finite = values[np.isfinite(values)]
    axes.set_title(title)
    axes.yaxis.set_major_locator(matplotlib.ticker.MaxNLocator(3, integer=True))
    if not finite.size:
        axes.text(0.5, 0.5, "no finite value", ha="center", va="center", transform=axes.transAxes)
        return
    if finite.min() > 0 and finite.max() > 100 * finite.min():
        edges = np.geomspace(finite.min(), finite.max(), 33)
        axes.set_xscale("log")
    elif np.all(finite == np.round(finite)) and np.ptp(finite) <= 60:
        edges = np.arange(finite.min() - 0.5, finite.max() + 1.5)
    else:
        edges = np.histogram_bin_edges(finite, bins=32)
    if axes.get_xscale() == "linear":  # few ticks, small numbers with a power of ten: labels must not touch
        axes.xaxis.set_major_locator(matplotlib.ticker.MaxNLocator(4))
        axes.ticklabel_format(axis="x", style="sci", scilimits=(-2, 4), useMathText=True)
    axes.hist(finite, bins=list(edges), color=INK, alpha=0.6, linewidth=0)
