"""The kinds of files: those of the runtime, and those that other packages register.

A package registers a kind by an entry point of the group ``softprint.kinds`` that names a :class:`Kind`; it is skipped
if the package is not installed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING

from softprint.runtime.errors import SoftprintError
from softprint.runtime.inspect.file_head import FileHead, read_head
from softprint.runtime.inspect.summary import Summary

if TYPE_CHECKING:
    from softprint.runtime.drawing.scene import Scene

GROUP = "softprint.kinds"
# In this order: kinds with metadata first, kinds known only by their suffix last.
_OWN = (
    *(
        "body",
        "truth",
        "motion",
        "touch",
        "state",
        "mechanics",
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
    """The part of a file to describe in more detail: a sample of a truth file, a frame of a motion."""

    sample: int | None = None
    frame: int | None = None


@dataclass(frozen=True)
class Kind:
    """recognise: whether a file is of this kind, from its head; summarise: describes its content, and raises
    SoftprintError if it is damaged; part: `sample` or `frame`, if it has such parts, or ""; scene: how to draw it,
    given the experiment with its colliders, None if there is nothing to draw."""

    recognise: Callable[[FileHead], bool]
    summarise: Callable[[Path, Part], Summary]
    part: str = ""
    scene: Callable[[Path, Part, Path | None], Scene] | None = None


def find_kind(path: Path) -> Kind:
    """The kind of a file; SoftprintError if it is unknown."""
    head = read_head(path)
    for kind in _kinds():
        if kind.recognise(head):
            return kind
    if head.suffix == ".xdmf":
        raise SoftprintError(f"{path}: a side file for ParaView; inspect the .h5 file of the same name")
    what = "an HDF5 file, but not" if head.h5 is not None else "not a file of Softprint's, nor"
    ours = "one of Softprint's" if head.h5 is not None else "a mesh that it can read"
    raise SoftprintError(f"{path}: {what} {ours}")


def _kinds() -> Iterator[Kind]:
    for name in _OWN:
        yield import_module(f"softprint.runtime.inspect.kinds.{name}_kind").KIND
    for point in entry_points(group=GROUP):
        try:
            kind: Kind = point.load()
        except ModuleNotFoundError:
            continue  # of a package that is not installed here
        yield kind


def inspect_file(path: Path, part: Part = Part()) -> Summary:
    """The summary of a file. Raises SoftprintError if it is unknown, damaged, or has no such sample or frame."""
    kind = find_kind(path)
    for name in ("sample", "frame"):
        if getattr(part, name) is not None and kind.part != name:
            raise SoftprintError(f"{path}: this kind of file has no {name}s, so --{name} does not apply")
    return kind.summarise(path, part)
