"""A recorded motion of bones: a table of poses over time, as written by a tracker.

A file of comma-separated values (CSV) with the heading `frame,time,x,y,z,rx,ry,rz` in 3D and `frame,time,x,y,angle` in
2D: the name of a rigid frame, the time [s], the position of a point of the bone, such as its joint [m], and the bone's
orientation as axis times angle [rad]. The first row of a frame is its rest pose: it gives the tracked point of the rest
body, and the reference for later orientations.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.colliders import KeyframedPath, RigidPose
from softprint.runtime.errors import SoftprintError

COLUMNS = {2: ("frame", "time", "x", "y", "angle"), 3: ("frame", "time", "x", "y", "z", "rx", "ry", "rz")}


@dataclass(frozen=True, eq=False)
class TrackedFrame:
    """frame: its name; anchor: (dim,) the tracked point in the rest body [m]; path: the position of the anchor and the
    frame's rotation from rest, over time."""

    frame: str
    anchor: Array
    path: KeyframedPath


def read_recorded_motion(path: Path, dim: int) -> list[TrackedFrame]:
    """The tracks of a file, in its order. Raises SoftprintError if the file is not such a table."""
    columns = COLUMNS[dim]
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SoftprintError(f"{path}: cannot be read as a recorded motion: {error}") from error
    rows = list(csv.reader(io.StringIO(text)))
    if not rows or tuple(rows[0]) != columns:
        raise SoftprintError(f"{path}: a recorded motion in {dim}D begins with the line {','.join(columns)}")
    tracks: dict[str, list[list[float]]] = {}
    for number, row in enumerate(rows[1:], start=2):
        try:
            values = [float(value) for value in row[1:]]
        except ValueError:
            values = []
        if len(values) != len(columns) - 1 or not np.isfinite(values).all():
            raise SoftprintError(
                f"{path}, line {number}: needs a frame's name and {len(columns) - 1} numbers, not {','.join(row)!r}"
            )
        tracks.setdefault(row[0], []).append(values)
    if not tracks:
        raise SoftprintError(f"{path}: has no frames; each row after the first is a frame at one time")
    return [_tracked(path, name, np.array(track), dim) for name, track in tracks.items()]


def _tracked(path: Path, name: str, track: Array, dim: int) -> TrackedFrame:
    times, positions, turns = track[:, 0], track[:, 1 : 1 + dim], track[:, 1 + dim :]
    if (np.diff(times) <= 0).any():
        raise SoftprintError(f"{path}: the times of frame {name!r} must increase from row to row")
    if dim == 3:
        poses = [RigidPose.from_rotation_vector(turn, np.zeros(3)) for turn in turns]
        turns = np.array([pose.compose(poses[0].inverse()).rotation_vector for pose in poses])
    else:
        turns = turns - turns[0]
    return TrackedFrame(name, positions[0], KeyframedPath(times, positions, turns))
