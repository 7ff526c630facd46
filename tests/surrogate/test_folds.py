"""The folds of cross-validation share neither states nor shapes with what they are judged by."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from softprint.surrogate.data.folds import FOLDS, folds_of


def truth_of(states: int, shapes: int, places: int = 2, depths: int = 3):
    """Every shape at every state, at some places, at some depths each."""
    state, shape, _ = (column.ravel() for column in np.mgrid[:states, :shapes, :places])
    contact = np.repeat(np.arange(len(state)), depths)
    return SimpleNamespace(
        samples={"contact": contact}, contacts={"collider": shape}, sample_state=state[contact]
    )


@pytest.mark.parametrize(("states", "shapes"), [(5, 1), (1, 6), (5, 10), (3, 4), (2, 2), (1, 1)])
def test_contacts_states_and_shapes_are_held_out(states, shapes):
    truth = truth_of(states, shapes)
    samples = np.flatnonzero(np.random.default_rng(1).random(len(truth.sample_state)) < 0.9)
    folds = folds_of(truth, samples, 0)
    assert len(folds) == min(FOLDS, *(count for count in (states, shapes) if count > 1), 2 * states * shapes)
    contact = truth.samples["contact"][samples]
    labels = {
        "contact": contact,
        "state": truth.sample_state[samples],
        "shape": truth.contacts["collider"][contact],
    }
    for fold in folds:
        for what, count in (("contact", 2), ("state", states), ("shape", shapes)):
            if count > 1:
                assert not set(labels[what][fold.learn]) & set(labels[what][fold.judge]), what
    judged = np.concatenate([fold.judge for fold in folds])
    assert len(np.unique(judged)) == len(judged)
    if 1 in (states, shapes):  # otherwise the diagonal
        assert len(judged) == len(samples)


def test_samples_of_one_contact_have_none():
    assert folds_of(truth_of(1, 1, places=1), np.arange(3), 0) == []
