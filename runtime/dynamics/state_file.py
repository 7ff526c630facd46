"""The state file (HDF5): the state of a simulation with the warm start of its next step.

A loaded simulation continues with the same bits as one that was never stored. Every object of the state is a group with
the name of its type and its fields; arrays are datasets, numbers attributes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact.contact_force import FrictionForces
from softprint.runtime.contact.solver.contact_solve import ContactSolution
from softprint.runtime.contact.solver.pressed_points import PressedPoints
from softprint.runtime.contact.solver.solved_contact import NearPoints, SolvedContact
from softprint.runtime.dynamics.body_checks import check_kind
from softprint.runtime.dynamics.state import KeptFactorisation, ReducedState
from softprint.runtime.dynamics.terms.kept_elastic_hessian import KeptHessian
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import create_softprint_h5, fixed_text, open_softprint_h5, read_text
from softprint.runtime.optimise.descent import Descent
from softprint.runtime.rigid.flight import RigidMotion

KIND, VERSION = "state", 9
_KINDS: dict[str, Any] = {
    kind.__name__: kind
    for kind in (
        ReducedState,
        RigidMotion,
        FrictionForces,
        SolvedContact,
        NearPoints,
        PressedPoints,
        ContactSolution,
        KeptFactorisation,
        Descent,
        KeptHessian,
    )
}
# Poses skip the normalisation of their constructor, which would change their bits.
_KINDS["RigidPose"] = RigidPose.known
_MAPPING, _NONE = "mapping", "none"


def save_state(path: str | Path, state: ReducedState) -> None:
    """Write a state; atomic. Raises SoftprintError for what is none, such as the result of a step."""
    check_kind("what is saved", state, ReducedState)
    with create_softprint_h5(path, KIND, VERSION) as file:
        _write(file, "state", state)


def load_state(path: str | Path) -> ReducedState:
    """The state of a file. Raises SoftprintError where it is missing, damaged, foreign or of another version."""
    with open_softprint_h5(path, KIND, VERSION) as file:
        state = _read(file["state"])
    if not isinstance(state, ReducedState):
        raise SoftprintError(f"{path}: does not contain the state of a simulation: save it again")
    return state


def _write(parent: h5py.Group, name: str, value: Any) -> None:
    if isinstance(value, np.ndarray):
        parent.create_dataset(name, data=value, fletcher32=value.size > 0)
        return
    if isinstance(value, bool | int | float):
        parent.attrs[name] = value
        return
    group = parent.create_group(name)
    if value is None:
        group.attrs["kind"] = fixed_text(_NONE)
    elif isinstance(value, Mapping):
        group.attrs["kind"] = fixed_text(_MAPPING)
        # By number, since the order matters and names may contain any character.
        for number, (key, entry) in enumerate(value.items()):
            _write(group, str(number), entry)
            group.attrs[f"name {number}"] = fixed_text(key)
    else:
        group.attrs["kind"] = fixed_text(type(value).__name__)
        for field in _field_names(value):
            _write(group, field, getattr(value, field))


def _field_names(value: Any) -> list[str]:
    """The fields of a dataclass or a named tuple."""
    return [field.name for field in fields(value)] if is_dataclass(value) else list(value._fields)


def _read(group: h5py.Group) -> Any:
    kind = read_text(group.attrs, "kind")
    if kind == _NONE:
        return None
    if kind == _MAPPING:
        count = len(group)
        return {read_text(group.attrs, f"name {k}"): _entry(group, str(k)) for k in range(count)}
    numbers = [name for name in group.attrs if name != "kind"]
    values = {name: _entry(group, name) for name in (*group, *numbers)}
    return _KINDS[kind](**values)


def _entry(group: h5py.Group, name: str) -> Any:
    if name in group.attrs:
        return group.attrs[name].item()
    entry = group[name]
    return np.asarray(entry[()]) if isinstance(entry, h5py.Dataset) else _read(entry)
