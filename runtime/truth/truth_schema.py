"""The schema of a truth file: every column with its type, unit and meaning, in one table.

Reader, writer and shards all use this table, so columns are added only here. Shapes are those of one row; the words
``nodes``, ``rows`` and ``dim`` denote the sizes of the body.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.errors import SoftprintError
from softprint.runtime.optimise.status import Status

KIND = "truth"
VERSION = 7
TEXT_BYTES = 1024  # of a text in a table; compression makes unused bytes free

# Status of a sample: how the full-space solve ended (never as only a reduced step can), or 5 if it was skipped because
# an earlier depth failed. Only converged samples have a displacement; the others contain NaN, so training cannot use
# them by mistake.
CONVERGED = int(Status.CONVERGED)
UNREACHED = 5
STATUS_NAMES = {
    **{
        int(status): status.name.lower()
        for status in Status
        if status < Status.STALLED
    },
    UNREACHED: "unreached",
}


@dataclass(frozen=True)
class Column:
    """One column: dtype ("str" for text), shape of a row, unit, meaning; ``measured``: varies between runs."""

    dtype: str
    meaning: str
    unit: str = ""
    shape: tuple[str, ...] = ()
    measured: bool = False

    def row_shape(self, sizes: Mapping[str, int]) -> tuple[int, ...]:
        return tuple(sizes[word] for word in self.shape)

    @property
    def stored_dtype(self) -> np.dtype[Any]:
        """Type in the file, with text of fixed length."""
        return np.dtype(f"S{TEXT_BYTES}" if self.dtype == "str" else self.dtype)


STATES: dict[str, Column] = {
    "rows": Column("f8", "handle rows of the reduced state", "m (R^T rows of frames: 1)", ("rows", "dim")),
    "internal": Column("f8", "internal correction: internal equilibrium minus U q", "m", ("nodes", "dim")),
    "residual": Column("f8", "relative residual of the internal equilibrium", "1"),
    "decrement": Column("f8", "relative Newton decrement of the internal equilibrium", "1"),
    "min_det_F": Column("f8", "smallest det F of the internal equilibrium", "1"),
    "min_eigenvalue": Column(
        "f8", "lowest Ritz value on the null space, relative to the block diagonal", "1"
    ),
    "energy": Column("f8", "potential energy of the internal equilibrium", "J"),
    "handle_force": Column(
        "f8", "derivative of the energy of internal equilibria by the handle rows", "N", ("rows", "dim")
    ),
    "stable": Column("?", "no negative curvature on the null space"),
    "scene": Column("str", "recorded scene the state comes from"),
    "frame": Column("i8", "frame of the recording"),
    "time": Column("f8", "time in the recording", "s"),
    "seconds": Column("f8", "core-seconds of the internal solve", "s", measured=True),
}

# Candidates whose internal equilibrium was refused: recorded, so that none is dropped silently.
REFUSED: dict[str, Column] = {
    "rows": STATES["rows"],
    "reason": Column("str", "why the state was refused"),
    "scene": STATES["scene"],
    "frame": STATES["frame"],
    "time": STATES["time"],
}

CONTACTS: dict[str, Column] = {
    "unit": Column("i8", "number of the contact in the order of work of the whole plan"),
    "state": Column("i8", "row of states/"),
    "collider": Column("i8", "index into the attribute `colliders`"),
    "place": Column("i8", "surface node (mesh number) that the collider is aimed at"),
    "rotation_index": Column("i8", "index of the collider's rotation"),
    "rotation": Column("f8", "rotation of the collider", "1", ("dim", "dim")),
    "direction": Column("f8", "direction in which the collider advances", "1", ("dim",)),
    "thickness": Column(
        "f8", "the most that a point of the surface can be in the collider there; infinite: more than needed", "m"
    ),
    "seconds": Column("f8", "core-seconds of all solves of the contact, second path included", "s", measured=True),
}

SAMPLES: dict[str, Column] = {
    "contact": Column("i8", "row of contacts/"),
    "depth_index": Column("i8", "number of the depth along the contact's path, shallow to deep"),
    "depth": Column("f8", "deepest point of the collider below the internal equilibrium's surface", "m"),
    "pose_rotation": Column("f8", "rotation of the collider: world = R z + t", "1", ("dim", "dim")),
    "pose_translation": Column("f8", "translation of the collider: world = R z + t", "m", ("dim",)),
    "displacement": Column(
        "f4", "contact displacement: equilibrium minus internal equilibrium", "m", ("nodes", "dim")
    ),
    "status": Column("i4", "see the attribute `status_codes`"),
    "reason": Column("str", "the solver's sentence"),
    "branch_flag": Column("?", "jumped to another branch since the depth before (see sampling/contact_path.py)"),
    "node_speed": Column("f8", "fastest node since the depth before, relative to the collider", "1"),
    "residual": Column("f8", "relative residual", "1"),
    "decrement": Column("f8", "relative Newton decrement", "1"),
    "newton_iterations": Column("i8", "Newton iterations, extra steps of the path included"),
    "cg_iterations": Column("i8", "conjugate gradient iterations, extra steps of the path included"),
    "min_det_F": Column("f8", "smallest det F", "1"),
    "max_depth": Column("f8", "largest penetration left at equilibrium", "m"),
    "intrusion": Column(
        "f8",
        "deepest point of the collider's surface inside the deformed body (see contact/intrusion.py)",
        "m",
    ),
    "energy": Column("f8", "potential energy at equilibrium", "J"),
    "handle_force": Column(
        "f8",
        "derivative of the energy of equilibria by the handle rows; less that of the state, generalised contact force",
        "N",
        ("rows", "dim"),
    ),
    "seconds": Column("f8", "core-seconds of the solve", "s", measured=True),
}

REPEAT: dict[str, Column] = {
    "sample": Column("i8", "row of samples/ that was solved a second time, along another path"),
    "displacement": Column("f4", "contact displacement at the end of the other path", "m", ("nodes", "dim")),
    "status": Column("i4", "see the attribute `status_codes`"),
    "spread": Column(
        "f8", "|u2 - u1| / |u1|: the label noise of the sample (NaN where either did not converge)", "1"
    ),
}

TABLES: dict[str, dict[str, Column]] = {
    "states": STATES,
    "refused": REFUSED,
    "contacts": CONTACTS,
    "samples": SAMPLES,
    "repeat": REPEAT,
}


def checked_table(
    name: str, values: Mapping[str, object], sizes: Mapping[str, int]
) -> dict[str, NDArray[Any]]:
    """``values`` as arrays of the types of table ``name``; raises SoftprintError on a missing, extra or
    misshapen one."""
    columns = TABLES[name]
    if set(values) != set(columns):
        missing, extra = sorted(set(columns) - set(values)), sorted(set(values) - set(columns))
        raise SoftprintError(f"truth table {name!r}: missing columns {missing}, unknown columns {extra}")
    arrays: dict[str, NDArray[Any]] = {}
    for key, column in columns.items():
        array = np.asarray(values[key], dtype=object if column.dtype == "str" else column.dtype)
        length = len(next(iter(arrays.values()))) if arrays else len(array)
        if array.shape != (length, *column.row_shape(sizes)):
            wanted = (length, *column.row_shape(sizes))
            raise SoftprintError(f"truth column {name}/{key}: shape {array.shape}, expected {wanted}")
        arrays[key] = array
    return arrays
