"""What is learned from and what is held out: by state, and where there are many colliders by shape too.

Never by random row: neighbouring samples tell the same story. Samples that are not converged or that follow a branch
jump are left out and counted. Testing shapes of the library are on neither side, so that nothing is chosen by them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from runtime.arrays import BoolArray, IntArray
from runtime.errors import SoftprintError
from runtime.shapes import names, validation_names
from runtime.truth.truth_file import TruthData


@dataclass(frozen=True)
class Split:
    """Rows of the truth file for training and for validation, and how many samples were left out as
    unusable."""

    train: IntArray
    validation: IntArray
    left_out: int


def split_by_state(truth: TruthData, collider: str, validation_states: int) -> Split:
    """Hold out the last `validation_states` states (they are in farthest-point order). Samples of `collider`
    only."""
    ours = _of_colliders(truth, [collider])
    usable = truth.usable & ours
    held_out = _in_last_states(truth, usable, validation_states)
    return Split(
        np.flatnonzero(usable & ~held_out), np.flatnonzero(usable & held_out), int(ours.sum() - usable.sum())
    )


def split_by_shape(truth: TruthData, validation_states: int) -> Split:
    """Learn from the library's training shapes, and hold out the validation shapes among them; where there are more
    states than `validation_states`, these hold out the last of them too, and validation is on shapes and states both
    unseen."""
    validation = set(validation_names())
    shapes = _of_colliders(truth, [name for name in names("train") if name not in validation])
    others = _of_colliders(truth, [name for name in names("train") if name in validation])
    usable = truth.usable & (shapes | others)
    learned, held_out = usable & shapes, usable & others
    if len(np.unique(truth.sample_state[usable])) > validation_states:
        last = _in_last_states(truth, usable, validation_states)
        learned, held_out = learned & ~last, held_out & last
    for part, what in (
        (learned, "training shapes to learn from"),
        (held_out, "validation shapes to hold out"),
    ):
        if not part.any():
            raise SoftprintError(
                f"{truth.path}: has no usable samples of {what}; validation shapes are {', '.join(sorted(validation))}"
            )
    left_out = int((shapes | others).sum() - usable.sum())
    return Split(np.flatnonzero(learned), np.flatnonzero(held_out), left_out)


def _of_colliders(truth: TruthData, colliders: Sequence[str]) -> BoolArray:
    """Which samples are of these colliders. Raises SoftprintError where the truth knows none of them."""
    known = truth.header.colliders
    numbers = [known.index(name) for name in colliders if name in known]
    if not numbers:
        raise SoftprintError(
            f"{truth.path}: has no samples of collider {' or '.join(map(repr, colliders[:3]))}; its colliders: "
            f"{', '.join(known[:8])}{', ...' if len(known) > 8 else ''}"
        )
    return np.asarray(np.isin(truth.contacts["collider"][truth.samples["contact"]], numbers))


def _in_last_states(truth: TruthData, usable: BoolArray, validation_states: int) -> BoolArray:
    """Which samples are of the last states that have usable ones."""
    states = np.unique(truth.sample_state[usable])
    if len(states) <= validation_states:
        raise SoftprintError(
            f"{truth.path}: has usable samples of {len(states)} states; holding out {validation_states} for "
            f"validation (training.validation_states) leaves none to learn from"
        )
    return np.asarray(np.isin(truth.sample_state, states[len(states) - validation_states :]))
