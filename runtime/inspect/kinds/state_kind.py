"""A state file: the state of a simulation at one time."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from softprint.runtime.dynamics.state import ReducedState
from softprint.runtime.dynamics.state_file import KIND as STATE
from softprint.runtime.dynamics.state_file import VERSION, load_state
from softprint.runtime.inspect.file_head import FileHead
from softprint.runtime.inspect.kind import Kind, Part
from softprint.runtime.inspect.summary import Section, Summary, versions
from softprint.runtime.io.files import open_softprint_h5


def recognise(head: FileHead) -> bool:
    return head.h5 is not None and head.kind == STATE


def summarise(path: Path, part: Part) -> Summary:
    """All of the state is read."""
    state = load_state(path)
    with open_softprint_h5(path, STATE, VERSION) as file:
        provenance = json.loads(file.attrs["provenance"])
    sections: dict[str, Section] = {
        "state": {
            "time [s]": state.time,
            "handle rows, dimension": list(state.rows.shape),
            "largest rate of a handle row [1/s or m/s]": float(np.abs(state.rows_velocity).max(initial=0.0)),
            "colliders": list(state.poses),
            "that move freely": list(state.motions),
            "a step led to it": state.frame_rows is not None,
        },
        "condensed contact": _contact(state),
        "made with": versions(provenance),
    }
    return Summary(path, "the state of a simulation", sections)


def _contact(state: ReducedState) -> dict[str, Any]:
    """Of penalty contact at surface samples, which is found anew from the rows, a state holds nothing."""
    solved = state.contact
    if solved is None:
        return {"in contact": False}
    return {
        "in contact": len(solved.active) > 0,
        "active nodes": {name: int(solved.owned_by(name).sum()) for name in solved.names},
        "largest displacement [m]": float(solved.solution.largest_displacement),
    }


KIND = Kind(recognise, summarise)
