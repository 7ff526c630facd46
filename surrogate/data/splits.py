"""Training and validation splits: by state, and with many colliders also by shape.

The split is never by random row, because neighbouring samples are strongly correlated. Samples that are not converged
or that follow a branch jump are left out and counted. Testing shapes are in neither set, so that no choice depends on
them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import BoolArray, IntArray
from softprint.runtime.errors import SoftprintError
from softprint.runtime.shapes.catalogue import Role
from softprint.runtime.truth.truth_file import TruthData


@dataclass(frozen=True)
class Split:
    """Rows of the truth file for training and for validation, all those that may be learned from, these among them, and
    the number of samples left out as unusable."""

    train: IntArray
    validation: IntArray
    whole: IntArray
    left_out: int


def split_by_state(truth: TruthData, collider: str, validation_states: int) -> Split:
    """Hold out the last `validation_states` states (states are in farthest-point order), or none if that leaves no
    state to learn from. Uses samples of `collider` only."""
    ours = _of_colliders(truth, [collider])
    usable = truth.usable & ours
    held_out = _in_last_states(truth, usable, validation_states)
    return Split(
        np.flatnonzero(usable & ~held_out),
        np.flatnonzero(usable & held_out),
        np.flatnonzero(usable),
        int(ours.sum() - usable.sum()),
    )


def split_by_shape(truth: TruthData, validation_states: int, roles: Mapping[str, Role]) -> Split:
    """Train on the shapes whose role is training, and hold out those for validation. If there are more than
    `validation_states` states, the last `validation_states` are held out too, and validation uses unseen shapes at
    unseen states."""
    shapes = _with_role(truth, roles, "train")
    others = _with_role(truth, roles, "validation")
    usable = truth.usable & (shapes | others)
    learned, held_out = usable & shapes, usable & others
    if len(np.unique(truth.sample_state[usable])) > validation_states:
        last = _in_last_states(truth, usable, validation_states)
        learned, held_out = learned & ~last, held_out & last
    for part, what in (
        (learned, "training shapes"),
        (held_out, "validation shapes"),
    ):
        if not part.any():
            known = ", ".join(f"{name} ({roles.get(name, 'test')})" for name in truth.header.colliders)
            raise SoftprintError(
                f"{truth.path}: no usable samples of {what}; its shapes: {known}. `shapes`, `meshes` and `validation` "
                "of [library] say what each is for"
            )
    left_out = int((shapes | others).sum() - usable.sum())
    return Split(np.flatnonzero(learned), np.flatnonzero(held_out), np.flatnonzero(usable), left_out)


def _with_role(truth: TruthData, roles: Mapping[str, Role], role: Role) -> BoolArray:
    """Mask of the samples with the shapes of that role."""
    is_it = np.array([roles.get(name) == role for name in truth.header.colliders], dtype=bool)
    return np.asarray(is_it[truth.contacts["collider"][truth.samples["contact"]]])


def _of_colliders(truth: TruthData, colliders: Sequence[str]) -> BoolArray:
    """Mask of the samples with these colliders. Raises SoftprintError if the truth has none of them."""
    known = truth.header.colliders
    numbers = [known.index(name) for name in colliders if name in known]
    if not numbers:
        raise SoftprintError(
            f"{truth.path}: no samples of collider {' or '.join(map(repr, colliders[:3]))}; its colliders: "
            f"{', '.join(known[:8])}{', ...' if len(known) > 8 else ''}"
        )
    return np.asarray(np.isin(truth.contacts["collider"][truth.samples["contact"]], numbers))


def _in_last_states(truth: TruthData, usable: BoolArray, validation_states: int) -> BoolArray:
    """Mask of the samples at the last `validation_states` states with usable samples; of none, if that leaves no state
    to learn from."""
    states = np.unique(truth.sample_state[usable])
    last = states[len(states) - validation_states :] if len(states) > validation_states else states[:0]
    return np.asarray(np.isin(truth.sample_state, last))
