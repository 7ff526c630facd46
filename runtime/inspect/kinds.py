"""Which kind a file is of: those of the runtime, and those that other packages announce.

A package announces a kind of its own files by an entry point of the group ``softprint.kinds`` that names a
:class:`Kind`; it is left out where the package is not installed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.errors import SoftprintError
from runtime.inspect.file_head import FileHead, read_head
from runtime.inspect.summary import Summary

if TYPE_CHECKING:
    from runtime.drawing.scene import Scene

GROUP = "softprint.kinds"
# In this order: what metadata names first, what only a suffix tells last.
_OWN = (
    *(
        "body",
        "truth",
        "motion",
        "touch",
        "correction",
        "report",
        "bench",
        "verification",
        "curves",
        "published",
    ),
    *("experiment", "mesh", "surface", "polygon"),
)


@dataclass(frozen=True)
class Part:
    """What of a file to say more about: a sample of a truth file, a frame of a motion."""

    sample: int | None = None
    frame: int | None = None


@dataclass(frozen=True)
class Kind:
    """recognise: whether a file is of this kind, from its head; summarise: says what is in it, and raises
    SoftprintError where it is damaged; part: which of `sample` and `frame` it has, "" if none; scene: how to
    draw it, given the experiment whose colliders belong to it, None if there is nothing to draw."""

    recognise: Callable[[FileHead], bool]
    summarise: Callable[[Path, Part], Summary]
    part: str = ""
    scene: Callable[[Path, Part, Path | None], Scene] | None = None


def find_kind(path: Path) -> Kind:
    """The kind of a file; SoftprintError where it is none that is known here."""
    head = read_head(path)
    for kind in _kinds():
        if kind.recognise(head):
            return kind
    if head.suffix == ".xdmf":
        raise SoftprintError(f"{path}: a side file for ParaView; inspect the .h5 file of the same name")
    what = "an HDF5 file, but not" if head.h5 is not None else "not a file of Softprint's, nor"
    ours = "one of Softprint's" if head.h5 is not None else "a mesh that it reads"
    raise SoftprintError(f"{path}: {what} {ours}")


def _kinds() -> Iterator[Kind]:
    for name in _OWN:
        yield import_module(f"runtime.inspect.{name}_kind").KIND
    for point in entry_points(group=GROUP):
        try:
            kind: Kind = point.load()
        except ModuleNotFoundError:
            continue  # of a package that is not installed here
        yield kind


def inspect_file(path: Path, part: Part = Part()) -> Summary:
    """Say what a file is. SoftprintError where it is not one of ours, damaged, or has no such sample or frame."""
    kind = find_kind(path)
    for name in ("sample", "frame"):
        if getattr(part, name) is not None and kind.part != name:
            raise SoftprintError(f"{path}: --{name} asks for a {name}, which this kind of file does not have")
    return kind.summarise(path, part)
