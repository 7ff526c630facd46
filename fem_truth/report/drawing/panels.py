"""Pictures side by side in one small file."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from softprint.fem_truth.report.drawing.picture import Picture
from softprint.runtime.io.files import atomic_path


def save_panels(path: Path, rows: Sequence[Sequence[tuple[str, Picture]]]) -> None:
    """Writes rows of pictures with their titles, all rows of the same length, as a PNG of few colours."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from PIL import Image

    count = len(rows[0])
    size = 2.4 * count, 2.1 * len(rows)
    figure, axes = plt.subplots(len(rows), count, figsize=size, layout="constrained", squeeze=False)
    for panels, row in zip(axes, rows, strict=True):
        for panel, (title, shot) in zip(panels, row, strict=True):
            panel.imshow(np.asarray(Image.open(io.BytesIO(shot.data)).convert("RGBA")))
            panel.set_title(title, fontsize=10)
            panel.set_axis_off()
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=130)
    plt.close(figure)
    few_colours = Image.open(drawn).convert("RGB").quantize(256, dither=Image.Dither.NONE)
    with atomic_path(path) as temporary:
        few_colours.save(temporary, format="PNG", optimize=True)
