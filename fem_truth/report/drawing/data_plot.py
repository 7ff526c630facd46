"""The data plot: error on unseen shapes, against the number of contacts and of shapes in training."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")  # before pyplot: reports are made where there is no display
import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from softprint.fem_truth.report.measurements.learning import read_table
from softprint.runtime.errors import SoftprintError

#: What `reproduction/how_much_truth.py` leaves in a run directory.
DATA = "bench_how_much_truth.json"


def data_figure_of(run: Path) -> Figure | None:
    """The figure of a run directory; None if the benchmark was not run. Raises SoftprintError for an unrelated file."""
    path = run / DATA
    if not path.is_file():
        return None
    try:
        return data_figure(read_table(path)["rows"])
    except (KeyError, TypeError) as error:
        raise SoftprintError(
            f"{path}: not what reproduction.how_much_truth writes ({error!r}): make it again"
        ) from error


def data_figure(found: Sequence[Mapping[str, Any]]) -> Figure:
    """Two panels: error against contacts per shape, and against shapes. found: rows of the benchmark's table."""
    all_shapes, all_contacts = (max(row[key] for row in found) for key in ("shapes", "contacts"))
    panels = {
        ("contacts", "contacts of a shape in a state"): [row for row in found if row["shapes"] == all_shapes],
        ("shapes", "training shapes"): [row for row in found if row["contacts"] == all_contacts],
    }
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.4), sharey=True, layout="constrained")
    for panel, ((key, label), rows) in zip(axes, panels.items(), strict=True):
        rows = sorted(rows, key=lambda row: row[key])
        x = [row[key] for row in rows]
        error = {side: [100 * row[f"{side}_error"] for row in rows] for side in ("testing", "validation")}
        spread = [50 * row["testing_spread"] for row in rows]
        panel.errorbar(x, error["testing"], spread, fmt="o-", label="testing shapes")
        panel.plot(x, error["validation"], "s--", label="validation shapes")
        panel.set_xscale("log", base=2)
        panel.set_xticks(x, [str(at) for at in x])
        panel.set_xlabel(label)
        panel.grid(alpha=0.3)
    axes[0].set_ylabel("relative RMS error [%]")
    axes[0].set_ylim(bottom=0)  # of both panels: here, after everything is drawn
    axes[0].legend()
    return figure
