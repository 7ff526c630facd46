"""The lines of OBJ files."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TextIO

import numpy as np

from softprint.runtime.arrays import Array, IntArray

_HEAD = b"# Softprint: "


def write_head(file: TextIO, text: str) -> None:
    """The first line, by which `is_ours` knows the file."""
    file.write(f"{_HEAD.decode()}{text}, metres\n")


def is_ours(path: Path) -> bool:
    """Whether a file was written here."""
    with path.open("rb") as file:
        return file.read(len(_HEAD)) == _HEAD


def write_object(file: TextIO, name: str, points: Array, facets: IntArray, start: int = 1) -> None:
    """One object: points (n, 3) [m], triangles (t, 3) or segments (t, 2) of them; start: the number of the first."""
    file.write(f"o {re.sub(r'[^A-Za-z0-9_.-]', '_', name)}\n")
    np.savetxt(file, points, fmt="v %.9g %.9g %.9g")
    kind = "f" if facets.shape[1] == 3 else "l"
    np.savetxt(file, facets + start, fmt=kind + " %d" * facets.shape[1])
