"""What tactile cameras saw with several models, against full space: files of `softprint touch --markers`.

    python -m benchmarks.tactile_views RUN/touch/SCENE_full_camera.h5 RUN/touch/SCENE_ours_camera.h5 ...

Printed for each file but the first is sqrt(sum |a - b|^2 / sum |b|^2) over all frames, with b of the first: of the
displacement of the markers, in the plane of the pad and with the part along its normal; of the depth image; and of the
force.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.cli.script import run_script
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import open_softprint_h5, read_text
from softprint.runtime.touch.camera_series import KIND, VERSION


def views(path: Path) -> tuple[str, dict[str, Array]]:
    """The name of the model, and what it saw."""
    with open_softprint_h5(path, KIND, VERSION) as file:
        seen = {name: file[name][()].astype(float) for name in ("markers", "depth", "force")}
        return read_text(file.attrs, "model"), {"plane": seen["markers"][..., :-1], **seen}


def off(found: Array, true: Array) -> float:
    """See the module; pixels without a surface in either are left out."""
    both = np.isfinite(found) & np.isfinite(true)
    return float(np.linalg.norm((found - true)[both]) / np.linalg.norm(true[both]))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("full", type=Path, metavar="FULL", help="the file that the others are compared with")
    parser.add_argument("others", type=Path, nargs="+", metavar="FILE")
    given = parser.parse_args()
    _, true = views(given.full)
    print("| model | markers in the plane | markers | depth image | force |\n| --- | --- | --- | --- | --- |")
    for path in given.others:
        name, found = views(path)
        if any(found[key].shape != true[key].shape for key in true):
            raise SoftprintError(f"{path}: has other frames, markers or pixels than {given.full}")
        columns = (f"{off(found[key], true[key]):.1%}" for key in ("plane", "markers", "depth", "force"))
        print(f"| {name} | {' | '.join(columns)} |")


if __name__ == "__main__":
    run_script(main)
