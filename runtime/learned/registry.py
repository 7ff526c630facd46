"""The kinds of learned corrections.

Each is a folder here, whose `entry.py` holds a `LearnedForm` named FORM, and a folder of the same name in `surrogate/`,
where it is trained, whose `entry.py` holds a `TrainingForm` named TRAINING. To add one, copy the two folders of the
kind that is most like it, and name it in `FORMS`. Inside them are

    runtime/learned/NAME    inputs.py      what the network reads of a state, by training and by the running model alike
                            model.py       the network with its options, a `LearnedModel` (`form.py`)
                            correction.py  the trained network on a body, a `Correction` (`correction.py` above it)
                            entry.py       the three joined
    surrogate/NAME          data.py        inputs and targets from a truth file
                            loss.py, task.py    what is minimised, a `LearningTask` (`surrogate/learning_task.py`)
                            entry.py       the three joined

Keys of its own in [[training.models]] tables go into `runtime/experiment/schema/training.py`.

This module imports none of them, since experiment files are checked without torch. `form.find_form` imports them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple


class Registered(NamedTuple):
    """any_collider: whether one model can be trained on a library of colliders, for any; on_mechanics: whether it has
    the linear mechanics of the body below it; description: for those who write experiment files."""

    any_collider: bool
    on_mechanics: bool
    description: str


FORMS: Mapping[str, Registered] = {
    "force": Registered(
        True, True, "a network corrects the contact forces of the body's linear mechanics, for any collider"
    ),
    "thesis4": Registered(
        True,
        False,
        "principal components of the displacement by colliders of one shape, object-centric (thesis, eq. 4.7)",
    ),
    "thesis5": Registered(
        False, False, "a network is the displacement field of one collider (thesis, eq. 5.4)"
    ),
    "thesis6": Registered(
        True, False, "the displacement from a local descriptor of any collider (thesis, eq. 6.5)"
    ),
}
