"""The truth file: the results of full-space solves, for training and for reports.

HDF5, one group for each table of :mod:`runtime.truth.truth_schema` (``states``, ``refused``, ``contacts``,
``samples``, ``repeat``), the mesh in ``mesh``, and in the attributes the body's hash, the experiment (JSON),
its seed, software versions, and whether every planned contact is in it. A small XDMF file beside it opens in
ParaView: one step a sample, the body at its internal equilibrium with the contact displacement as a node
field ("Warp By Vector" shows it).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact.intrusion import pierced_from
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import create_softprint_h5, fixed_text, open_softprint_h5, read_text
from softprint.runtime.io.xdmf import Step, Values, write_xdmf
from softprint.runtime.mesh.mesh import Mesh
from softprint.runtime.truth.truth_schema import (
    CONVERGED,
    KIND,
    STATUS_NAMES,
    TABLES,
    TEXT_BYTES,
    VERSION,
    checked_table,
)

# Steps of the approach path to the deepest sample of a contact: with eight, every contact node of the library's
# contacts ended on the same side of the collider as with many more.
_STEPS_IN = 8


@dataclass(frozen=True)
class TruthHeader:
    """The metadata of a truth file.

    colliders: names, in the order of ``contacts/collider``; planned_contacts: size of the whole plan, of which a
    partial file contains the first finished ones; experiment: JSON text of the experiment as it was run; made_from: a
    flat table of everything that determines the numbers, to decide whether another run would give the same.
    """

    body_hash: str
    experiment: str
    seed: int
    colliders: tuple[str, ...]
    planned_contacts: int
    made_from: Mapping[str, str] = field(default_factory=dict)


class TruthWriter:
    """Appends rows to the tables of a truth file that is being written; made by :func:`create_truth`."""

    def __init__(self, file: h5py.File, header: TruthHeader, body: ReducedBody) -> None:
        self._file = file
        self._sizes = {"nodes": body.n_nodes, "rows": body.n_rows, "dim": body.dim}
        self._body = body
        self._header = header
        self._digest = hashlib.sha256()
        for name, columns in TABLES.items():
            group = file.create_group(name)
            for key, column in columns.items():
                shape = column.row_shape(self._sizes)
                # One row of a field is one chunk, so that a training batch only reads its own samples.
                chunk = (1, *shape) if "nodes" in column.shape else (256, *shape)
                dataset = group.create_dataset(
                    key,
                    (0, *shape),
                    column.stored_dtype,
                    maxshape=(None, *shape),
                    chunks=chunk,
                    fletcher32=True,
                    compression="gzip" if column.dtype == "str" else None,
                )
                dataset.attrs["unit"] = fixed_text(column.unit)
                dataset.attrs["meaning"] = fixed_text(column.meaning)
        file.create_dataset("mesh/points", data=body.mesh.points, fletcher32=True)
        file.create_dataset("mesh/cells", data=body.mesh.cells, fletcher32=True)

    def length(self, table: str) -> int:
        """Rows that the table has so far."""
        return len(self._file[table][next(iter(TABLES[table]))])

    def append(self, table: str, values: Mapping[str, object]) -> None:
        """Append rows to a table; every column must be given, and indices refer to rows of the whole file."""
        arrays = checked_table(table, values, self._sizes)
        start = self.length(table)
        for key, array in arrays.items():
            dataset = self._file[table][key]
            dataset.resize(start + len(array), axis=0)
            dataset[start:] = _fixed(array, f"{table}/{key}") if array.dtype == object else array
            if not TABLES[table][key].measured:
                self._digest.update(f"{table}/{key}:{len(array)}:".encode())
                data = "\0".join(array).encode() if array.dtype == object else array.tobytes()
                self._digest.update(data)

    def _finish(self) -> None:
        attrs = self._file.attrs
        attrs["body_hash"] = fixed_text(self._header.body_hash)
        attrs["experiment"] = fixed_text(self._header.experiment)
        attrs["seed"] = self._header.seed
        attrs["colliders"] = fixed_text(json.dumps(self._header.colliders))
        attrs["planned_contacts"] = self._header.planned_contacts
        made_from = json.dumps(dict(self._header.made_from), sort_keys=True)
        attrs["made_from"] = fixed_text(made_from)
        attrs["status_codes"] = fixed_text(json.dumps(STATUS_NAMES))
        attrs["complete"] = self.length("contacts") == self._header.planned_contacts
        attrs["content_hash"] = fixed_text(self._digest.hexdigest())
        # ParaView needs points as whole datasets: one for each state.
        basis = self._body.basis
        for state, rows in enumerate(self._file["states/rows"][()]):
            points = basis @ rows + self._file["states/internal"][state]
            self._file.create_dataset(f"view/points_{state}", data=points, fletcher32=True)


def _fixed(texts: NDArray[Any], column: str) -> NDArray[np.bytes_]:
    """Text in the fixed length of its column: text of variable length would have no checksum."""
    encoded = [str(text).encode() for text in texts]
    longest = max(map(len, encoded), default=0)
    if longest > TEXT_BYTES:
        raise ValueError(f"{column}: a text of {longest} bytes; a truth file stores at most {TEXT_BYTES}")
    return np.array(encoded, dtype=f"S{TEXT_BYTES}")


@contextmanager
def create_truth(path: Path, header: TruthHeader, body: ReducedBody) -> Iterator[TruthWriter]:
    """Write a truth file and its XDMF side file, atomically: ``with create_truth(...) as truth:
    truth.append(...)``.

    Nothing appears under ``path`` unless the block ends without an exception. ``complete`` is set if the file has as
    many contacts as planned; ``content_hash`` covers every column except measured times.
    """
    if header.body_hash != body.content_hash:
        raise SoftprintError(f"{path}: the header names another body than {body.name!r}")
    with create_softprint_h5(path, KIND, VERSION) as file:
        writer = TruthWriter(file, header, body)
        yield writer
        writer._finish()
    write_side_file(Path(path))


def side_file(path: Path) -> Path:
    """The XDMF file beside a truth file."""
    return path.with_suffix(".xdmf")


def write_side_file(path: Path) -> None:
    """Describe the truth to ParaView: one step a sample."""
    with open_softprint_h5(path, KIND, VERSION) as file:
        state_of = file["contacts/state"][()]
        cells, displacement = Values.of(file["mesh/cells"]), file["samples/displacement"]
        steps = [
            Step(
                time=float(sample),
                points=Values.of(file[f"view/points_{state_of[contact]}"]),
                cells=cells,
                node_fields={"contact_displacement": Values.of(displacement, sample)},
                name=f"sample_{sample}",
            )
            for sample, contact in enumerate(file["samples/contact"][()])
        ]
    write_xdmf(side_file(path), steps)


class Table:
    """The columns of one table by name; small ones are read once and cached, fields are read row by row on demand."""

    def __init__(self, group: h5py.Group, name: str) -> None:
        self._group = group
        self._columns = TABLES[name]
        self._kept: dict[str, NDArray[Any]] = {}

    def __len__(self) -> int:
        return len(self._group[next(iter(self._columns))])

    def __getitem__(self, column: str) -> NDArray[Any]:
        """The whole column as an array (text columns: an object array of str)."""
        if column not in self._kept:
            dataset = self._group[column]
            with self._reporting_damage(column):
                values = dataset.asstr("utf-8")[()] if self._columns[column].dtype == "str" else dataset[()]
            if "nodes" in self._columns[column].shape:
                return values
            self._kept[column] = values
        return self._kept[column]

    def field(self, column: str, rows: int | Sequence[int] | IntArray) -> NDArray[Any]:
        """Only the given rows of a column, in the order given: (n, ...), or (...) for one number."""
        dataset = self._group[column]
        with self._reporting_damage(column):
            if isinstance(rows, int | np.integer):
                return dataset[int(rows)]
            wanted = np.asarray(rows, dtype=np.int64)
            values = np.empty((len(wanted), *dataset.shape[1:]), dataset.dtype)
            for place, row in enumerate(wanted):
                dataset.read_direct(values, np.s_[int(row)], np.s_[place])
            return values

    @contextmanager
    def _reporting_damage(self, column: str) -> Iterator[None]:
        try:
            yield
        except (OSError, ValueError) as error:
            name = Path(self._group.file.filename)
            raise SoftprintError(
                f"{name}: column {column!r} is damaged ({error}): make the file again"
            ) from error


class TruthData:
    """A truth file open for reading; use it as a context manager, or close it. Fields are read on demand.

    ``states``, ``refused``, ``contacts``, ``samples``, ``repeat`` are :class:`Table` objects with the columns
    of :mod:`runtime.truth.truth_schema`.
    """

    def __init__(self, path: Path | str, body: ReducedBody | None = None) -> None:
        self.path = Path(path)
        self._stack = ExitStack()
        with ExitStack() as stack:
            file = stack.enter_context(open_softprint_h5(self.path, KIND, VERSION))
            attrs = file.attrs
            self.header = TruthHeader(
                body_hash=read_text(attrs, "body_hash"),
                experiment=read_text(attrs, "experiment"),
                seed=int(attrs["seed"]),
                colliders=tuple(json.loads(attrs["colliders"])),
                planned_contacts=int(attrs["planned_contacts"]),
                made_from=json.loads(attrs["made_from"]),
            )
            self.complete = bool(attrs["complete"])
            self.content_hash = read_text(attrs, "content_hash")
            self.provenance: dict[str, str] = json.loads(attrs["provenance"])
            self._check_tables(file)
            self._check_body(body)
            self.states, self.refused, self.contacts, self.samples, self.repeat = (
                Table(file[name], name) for name in TABLES
            )
            self.dim = int(file["mesh/points"].shape[1])
            self.n_nodes = int(file["mesh/points"].shape[0])
            self._pierced_from = pierced_from(Mesh(file["mesh/points"][()], file["mesh/cells"][()]))
            self._stack = stack.pop_all()  # valid: keep the file open

    def _check_tables(self, file: h5py.File) -> None:
        basis_rows = file["states/rows"].shape[1:2]
        sizes = dict(zip(("nodes", "dim", "rows"), (*file["mesh/points"].shape, *basis_rows), strict=True))
        for name, columns in TABLES.items():
            lengths = {}
            for key, column in columns.items():
                found = file[name][key]
                wanted, dtype = column.row_shape(sizes), column.stored_dtype
                if found.shape[1:] != wanted or found.dtype != dtype:
                    raise SoftprintError(
                        f"{self.path}: column {name}/{key} holds {found.dtype} of shape {found.shape[1:]}, not "
                        f"{dtype} of shape {wanted}: make the file again"
                    )
                lengths[key] = len(found)
            if len(set(lengths.values())) != 1:
                raise SoftprintError(
                    f"{self.path}: columns of {name!r} differ in length ({lengths}): make it again"
                )

    def _check_body(self, body: ReducedBody | None) -> None:
        if body is not None and body.content_hash != self.header.body_hash:
            raise SoftprintError(
                f"{self.path}: made for another body (hash {self.header.body_hash[:12]}) than {body.name!r} "
                f"({body.content_hash[:12]}): generate it again for this body, or give the right body"
            )

    def close(self) -> None:
        self._stack.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def n_samples(self) -> int:
        return len(self.samples)

    @property
    def usable(self) -> BoolArray:
        """(n_samples,) which samples are usable for training: converged, not after a jump to another branch, with no
        collider through the surface and no cell inverted."""
        return self.answered & ~self.after_jump & ~self.pierced & ~self.inverted

    @property
    def answered(self) -> BoolArray:
        """(n_samples,) which samples have an answer of full space: those that converged."""
        return np.asarray(self.samples["status"] == CONVERGED)

    @property
    def after_jump(self) -> BoolArray:
        """(n_samples,) which samples are on another branch than the first of their contact: one that jumped, and those
        that are deeper."""
        contact, depth = self.samples["contact"], self.samples["depth_index"]
        jumped = np.zeros(len(contact), dtype=bool)
        for sample in np.flatnonzero(self.samples["branch_flag"]):
            jumped |= (contact == contact[sample]) & (depth >= depth[sample])
        return jumped

    @property
    def pierced(self) -> BoolArray:
        """(n_samples,) in which converged samples the collider has pierced the body, see `pierced_from`."""
        return np.asarray(self.samples["intrusion"] > self._pierced_from)

    @property
    def inverted(self) -> BoolArray:
        """(n_samples,) in which converged samples a cell is inverted."""
        return np.asarray(self.samples["min_det_F"] <= 0.0)

    @property
    def deep_in_thin(self) -> BoolArray:
        """(n_samples,) which samples are deeper than three quarters of how thick the collider is there: edges, rims and
        limbs that are pressed in as far as they go."""
        thickness = self.contacts["thickness"][self.samples["contact"]]
        return np.asarray(self.samples["depth"] > 0.75 * thickness)

    @property
    def sample_state(self) -> IntArray:
        """(n_samples,) row of states/ of every sample."""
        return self.contacts["state"][self.samples["contact"]]

    def displacement(self, samples: int | Sequence[int] | IntArray) -> NDArray[np.float32]:
        """Contact displacement of one sample (n_nodes, dim) or of several (n, n_nodes, dim) [m], read from the file."""
        return self.samples.field("displacement", samples)

    def internal(self, state: int) -> Array:
        """(n_nodes, dim) internal correction of a state: internal equilibrium minus U rows [m]."""
        return self.states.field("internal", state)

    def contact_energy(self, sample: int) -> float:
        """[J] what the contact of a sample adds to the energy of its state: of contact, elasticity and gravity."""
        energy = self.samples["energy"][sample] - self.states["energy"][self.sample_state[sample]]
        return float(energy)

    def contact_handle_force(self, sample: int) -> Array:
        """(n_rows, dim) [N] the generalised contact force of a sample: the derivative of `contact_energy` by the handle
        rows, with the collider fixed. As the subspace reproduces translations, its sum over point handles and origins
        of frames is minus the force on the collider."""
        force = self.samples["handle_force"][sample] - self.states["handle_force"][self.sample_state[sample]]
        return np.asarray(force)

    def pose(self, sample: int) -> RigidPose:
        """The collider's pose in a sample."""
        return RigidPose(self.samples["pose_rotation"][sample], self.samples["pose_translation"][sample])

    def approach_path(self, sample: int) -> list[RigidPose]:
        """Poses of the collider from first contact to the sample's pose, in steps of at most an eighth of the contact's
        largest depth. If there are several equilibria, the sample is the one that this path leads to. Only the pose of
        the sample if its contact has no direction of approach or no depth."""
        contact, end = self.samples["contact"][sample], self.pose(sample)
        direction = self.contacts["direction"][contact]
        if not np.isfinite(direction).all() or self.samples["depth"][sample] <= 0.0:
            return [end]
        of_contact = np.flatnonzero(self.samples["contact"] == contact)
        depths = self.samples["depth"][of_contact]
        before = of_contact[depths <= self.samples["depth"][sample]]
        before = before[np.argsort(self.samples["depth"][before])]
        advanced = (self.samples["pose_translation"][before] - end.translation) @ direction
        reached = np.concatenate([[0.0], self.samples["depth"][before]])
        advanced = np.concatenate([[advanced[0] - reached[1]], advanced])
        steps = max(1, int(np.ceil(_STEPS_IN * reached[-1] / depths.max())))
        short = np.interp(reached[-1] * np.arange(1, steps) / steps, reached, advanced)
        return [RigidPose(end.rotation, end.translation + s * direction) for s in short] + [end]

    @property
    def noise_floor(self) -> float:
        """Median label noise |u2 - u1| / |u1| of the samples solved twice; NaN if there are none."""
        spread = self.repeat["spread"]
        finite = spread[np.isfinite(spread)]
        return float(np.median(finite)) if len(finite) else float("nan")


def load_truth(path: Path | str, body: ReducedBody | None = None) -> TruthData:
    """Open a truth file; raises SoftprintError if it is missing, damaged, of another version or of another
    body."""
    return TruthData(path, body)
