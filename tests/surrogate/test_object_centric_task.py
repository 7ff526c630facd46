"""Training of object-centric corrections: a field that moves with the collider along a bar."""

from __future__ import annotations

import numpy as np
import torch

from softprint.runtime.learned.thesis4.model import ObjectCentricOptions
from softprint.surrogate.thesis4.data import ObjectCentricData, TrainedColliders
from softprint.surrogate.thesis4.task import ObjectCentricTask
from softprint.surrogate.train import TrainingSettings, train

NODES, COMPONENTS = 40, 12
# Width of the dent that the collider makes, in lengths of the bar.
WIDTH = 0.06


def dents(places: np.ndarray) -> ObjectCentricData:
    """The collider at `places` (s,) along a bar of length one."""
    along = np.linspace(0.0, 1.0, NODES)
    fields = np.zeros((len(places), NODES, 2), dtype=np.float32)
    fields[..., 1] = -np.exp(-0.5 * ((along - places[:, None]) / WIDTH) ** 2)
    return ObjectCentricData(places[:, None], np.ones(len(places)), fields, np.arange(len(places)) + 100)


def task(input_gain: float) -> ObjectCentricTask:
    options = ObjectCentricOptions((24, 24), COMPONENTS, 1, NODES, (), "whole", "saturating", 1e-9)
    rng = np.random.default_rng(0)
    training, validation = (dents(rng.uniform(size=count)) for count in (300, 50))
    nothing = TrainedColliders(np.zeros(1), np.zeros(2))
    return ObjectCentricTask(options, training, validation, np.ones(NODES), 3, nothing, input_gain)


def test_the_gain_scales_the_first_layer_alone():
    plain, steep = (task(gain).fresh_model(3).state_dict() for gain in (1.0, 4.0))
    for name, weights in plain.items():
        factor = 4.0 if name.startswith("network.local") else 1.0
        assert torch.equal(steep[name], factor * weights), name


def test_a_steep_first_layer_learns_narrow_dents_sooner():
    """A dent is narrow beside the range of places, and a tanh layer begins with functions that are nearly linear."""
    plain, steep = (
        train(task(gain), TrainingSettings(300, 64, 1e-2, 0.0, 3, 0)).held_out.rms for gain in (1.0, 4.0)
    )
    # 0.28 and 0.39; both fall as training goes on, and the lead shrinks.
    assert steep < 0.85 * plain


def test_some_samples():
    data = dents(np.linspace(0.1, 0.9, 5))
    own = data.some(np.array([103, 101]))
    assert list(own.sample) == [101, 103]
    assert np.array_equal(own.inputs, data.inputs[[1, 3]])
    assert np.array_equal(own.fields, data.fields[[1, 3]])
