"""The motion file (HDF5): a scene played by one model, frame by frame. SI units.

    times (F,) s, rows (F, n_rows, dim), positions (F, n_nodes, dim) float32 m       mesh/points, mesh/cells
    status, iterations, residual, penetration, min_det_F (F,)       energies/<name> (F,) J, timings/<phase> (F,) s
    colliders/<name>/{rotation (F, dim, dim), translation (F, dim), force (F, dim) N, torque N m, penetration m,
    intrusion m}

Frame 0 is the start of the scene; frame f is the end of step f, and its values are those of that step.
Attributes: softprint_kind "motion", softprint_version, provenance, model, scene, body_hash, inputs_hash,
experiment (text), collider_tables (JSON, see `motion_colliders.py`), status_names (JSON: number -> name). A side file
(.xdmf) opens the motion in ParaView.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics.state import StepResult
from softprint.runtime.elasticity.invariants import determinant
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.stored_text import contact_table
from softprint.runtime.io.files import create_softprint_h5, fixed_text, open_softprint_h5, read_text
from softprint.runtime.io.xdmf import Step, Values, write_xdmf
from softprint.runtime.lazy import lazy
from softprint.runtime.mesh import Mesh
from softprint.runtime.scenes.motion_colliders import build_colliders

if TYPE_CHECKING:
    from softprint.runtime.drawing.picture import Animation

KIND = "motion"
VERSION = 4


@dataclass(frozen=True, eq=False)
class ColliderTrack:
    """One collider over the F frames: poses, the force on it (F, dim) [N] and torque [N m]; penetration (F,) [m], what
    the contact law sees; intrusion (F,) [m], how deep it is inside the deformed body, NaN if
    it has no bounds."""

    poses: tuple[RigidPose, ...]
    force: Array
    torque: Array
    penetration: Array
    intrusion: Array


@dataclass(frozen=True, eq=False, repr=False)
class Motion:
    """A motion read from its file, all in memory except the positions. See the module for shapes and units."""

    path: Path
    model: str
    scene: str
    body_hash: str
    inputs_hash: str
    times: Array
    rows: Array
    status: IntArray
    status_names: Mapping[int, str]
    iterations: IntArray
    residual: Array
    penetration: Array
    min_det_F: Array
    energies: Mapping[str, Array]
    timings: Mapping[str, Array]
    colliders: Mapping[str, ColliderTrack]
    collider_tables: str
    experiment: str

    def __repr__(self) -> str:
        return (
            f"Motion({str(self.path)!r}: {self.scene} with {self.model}, {self.n_frames} frames from "
            f"{self.times[0]:g} to {self.times[-1]:g} s)"
        )

    @property
    def n_frames(self) -> int:
        return len(self.times)

    @property
    def converged(self) -> BoolArray:
        """(F,)"""
        return np.equal(self.status, 0)

    @property
    def in_contact(self) -> BoolArray:
        """(F,) the frames in which the body pushes any collider."""
        return np.asarray(np.any([track.force.any(axis=1) for track in self.colliders.values()], axis=0))

    def invalid(self, pierced_from: float) -> BoolArray:
        """(F,) the frames in which a collider has pierced the body, deeper than `pierced_from` [m], or a cell is
        inverted."""
        deepest = [track.intrusion > pierced_from for track in self.colliders.values()]
        return np.asarray(np.any([self.min_det_F <= 0.0, *deepest], axis=0))

    def positions(self, frame: int) -> Array:
        """(n_nodes, dim) [m] of one frame, read from the file on demand."""
        if not 0 <= frame < self.n_frames:
            raise SoftprintError(f"{self.path}: no frame {frame}; they are numbered 0 to {self.n_frames - 1}")
        with open_softprint_h5(self.path, KIND, VERSION) as file:
            return np.asarray(file["positions"][frame], dtype=np.float64)

    @property
    def label(self) -> str:
        """Its file, for messages."""
        return str(self.path)

    @lazy
    def rest(self) -> Mesh:
        """The body at rest, read from the file on first use."""
        with open_softprint_h5(self.path, KIND, VERSION) as file:
            return Mesh(file["mesh/points"][()], file["mesh/cells"][()])

    @property
    def contact(self) -> PenaltyContact:
        """The contact law of the experiment."""
        return PenaltyContact.of(contact_table(self.experiment, self.path))

    def poses(self) -> dict[str, tuple[RigidPose, ...]]:
        """The F poses of every collider, by name."""
        return {name: track.poses for name, track in self.colliders.items()}

    def build_colliders(self) -> dict[str, Collider]:
        """The colliders by name, from the tables in the file. Raises SoftprintError if a file that they name is
        missing."""
        return build_colliders(self.collider_tables, self.path)

    def show(self, colour: str = "displacement", width: int = 480) -> Animation:
        """Moving pictures, which a notebook shows. colour: displacement, pressure or none; width [pixels].

        Raises SoftprintError if pictures cannot be drawn here."""
        from softprint.runtime.convert.show import animation_of

        return animation_of(self, colour, width)


@dataclass(frozen=True)
class MotionHeader:
    """The origin of a motion; ``inputs_hash`` identifies everything that it was computed from."""

    model: str
    scene: str
    inputs_hash: str
    experiment: str
    collider_tables: str


@dataclass
class _Column:
    """The values of one dataset, frame after frame."""

    values: list[Any] = field(default_factory=list)


class MotionWriter:
    """Takes frames one by one; positions are written at once, everything else when the file is closed."""

    def __init__(self, file: h5py.File, body: ReducedBody, n_frames: int) -> None:
        self._file, self._mesh = file, body.mesh
        self._columns: dict[str, _Column] = {}
        self._status_names: dict[int, str] = {}
        self._frames = 0
        # One frame in each chunk, because readers take a frame at a time; checksums detect damage.
        shape = (n_frames, body.n_nodes, body.dim)
        self._positions = file.create_dataset(
            "positions", shape, dtype="f4", chunks=(1, *shape[1:]), fletcher32=True
        )
        file.create_dataset("mesh/points", data=body.mesh.points, fletcher32=True)
        file.create_dataset("mesh/cells", data=body.mesh.cells, fletcher32=True)

    def add(
        self,
        result: StepResult[Any],
        rows: Array,
        positions: Array,
        intrusions: Mapping[str, float],
    ) -> None:
        """Append a frame: rows (n_rows, dim), positions (n_nodes, dim) at ``result.state``; intrusions: by collider."""
        self._positions[self._frames] = positions
        self._frames += 1
        self._note_status(result.status)
        self._put("times", result.state.time)
        self._put("rows", rows)
        self._put("status", int(result.status))
        for name in ("iterations", "residual", "penetration"):
            self._put(name, getattr(result, name))
        self._put("min_det_F", float(determinant(self._mesh.deformation_gradients(positions)).min()))
        for group, values in (("energies", result.energies), ("timings", result.timings)):
            for name, value in values.items():
                self._put(f"{group}/{name}", value)
        for name, contact in result.contacts.items():
            pose = result.state.poses[name]
            self._put(f"colliders/{name}/rotation", pose.rotation)
            self._put(f"colliders/{name}/translation", pose.translation)
            for key in ("force", "torque", "penetration"):
                self._put(f"colliders/{name}/{key}", getattr(contact, key))
            self._put(f"colliders/{name}/intrusion", intrusions[name])

    def _put(self, name: str, value: Any) -> None:
        self._columns.setdefault(name, _Column()).values.append(value)

    def _note_status(self, status: IntEnum) -> None:
        self._status_names |= {int(member): member.name for member in type(status)}

    def finish(self) -> None:
        """Write the columns. Every frame must have the same ones."""
        for name, column in self._columns.items():
            if len(column.values) != self._frames:
                raise ValueError(f"{name} was given for {len(column.values)} of {self._frames} frames")
            self._file.create_dataset(name, data=np.array(column.values), fletcher32=True)
        self._file.attrs["status_names"] = fixed_text(json.dumps(self._status_names))


@contextmanager
def write_motion(
    path: Path, header: MotionHeader, body: ReducedBody, n_frames: int
) -> Iterator[MotionWriter]:
    """Write a motion file and its side file, atomically."""
    with create_softprint_h5(path, KIND, VERSION) as file:
        for name in ("model", "scene", "inputs_hash", "experiment", "collider_tables"):
            file.attrs[name] = fixed_text(getattr(header, name))
        file.attrs["body_hash"] = fixed_text(body.content_hash)
        writer = MotionWriter(file, body, n_frames)
        yield writer
        writer.finish()
    write_side_file(path)


def side_file(path: Path) -> Path:
    """The XDMF file beside a motion file."""
    return path.with_suffix(".xdmf")


def write_side_file(path: Path) -> None:
    """Describe the motion to ParaView: the deformed mesh at every frame."""
    with open_softprint_h5(path, KIND, VERSION) as file:
        cells = Values.of(file["mesh/cells"])
        steps = [
            Step(float(time), Values(path.name, "/positions", *_layout(file["positions"]), frame), cells)
            for frame, time in enumerate(file["times"][()])
        ]
    write_xdmf(side_file(path), steps)


def _layout(dataset: h5py.Dataset) -> tuple[tuple[int, ...], np.dtype[Any]]:
    return tuple(dataset.shape), dataset.dtype


def motion_inputs_hash(path: Path) -> str:
    """What the motion in a file was computed from. Raises SoftprintError if the file is missing or damaged."""
    with open_softprint_h5(path, KIND, VERSION) as file:
        return read_text(file.attrs, "inputs_hash")


def load_motion(path: Path | str) -> Motion:
    """Read a motion. Raises SoftprintError if the file is missing, not a motion file, truncated or incomplete."""
    with open_softprint_h5(path, KIND, VERSION) as file:
        colliders = {name: _track(group) for name, group in file.get("colliders", {}).items()}
        return Motion(
            path=Path(path),
            model=read_text(file.attrs, "model"),
            scene=read_text(file.attrs, "scene"),
            body_hash=read_text(file.attrs, "body_hash"),
            inputs_hash=read_text(file.attrs, "inputs_hash"),
            times=file["times"][()],
            rows=file["rows"][()],
            status=file["status"][()],
            status_names={int(key): name for key, name in json.loads(file.attrs["status_names"]).items()},
            iterations=file["iterations"][()],
            residual=file["residual"][()],
            penetration=file["penetration"][()],
            min_det_F=file["min_det_F"][()],
            energies={name: values[()] for name, values in file["energies"].items()},
            timings={name: values[()] for name, values in file["timings"].items()},
            colliders=colliders,
            collider_tables=read_text(file.attrs, "collider_tables"),
            experiment=read_text(file.attrs, "experiment"),
        )


def _track(group: h5py.Group) -> ColliderTrack:
    poses = tuple(
        RigidPose(R, t) for R, t in zip(group["rotation"][()], group["translation"][()], strict=True)
    )
    columns = (group[name][()] for name in ("force", "torque", "penetration", "intrusion"))
    return ColliderTrack(poses, *columns)
