"""One page of figures 6.3 to 6.7 of the thesis as plots, from what reproduction/ left in a run directory.

python -m reproduction.thesis6_plots RUN FILE.png
"""

from __future__ import annotations

import sys
from pathlib import Path

from softprint.fem_truth.report.drawing.thesis6_plots import NEEDED, thesis6_figure
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import atomic_path


def draw(run: Path, picture: Path) -> None:
    """All panels; raises SoftprintError where a file is missing."""
    for file, maker in NEEDED.items():
        if not (run / file).is_file():
            raise SoftprintError(f"{run / file} is not there: run reproduction.{maker} first")
    figure = thesis6_figure(run)
    assert figure is not None
    with atomic_path(picture) as temporary:
        figure.savefig(temporary, dpi=90, format="png")


if __name__ == "__main__":
    draw(Path(sys.argv[1]), Path(sys.argv[2]))
