"""What scenes of an experiment have in common."""

from pathlib import Path

import pytest

from softprint.runtime.experiment import load_experiment
from softprint.runtime.scenes.scene import held_frames

EXAMPLES = Path(__file__).parents[3] / "examples"


@pytest.mark.parametrize(("name", "held"), [("jelly3d_small", {"base"}), ("hand_small", set())])
def test_frames_that_are_held_in_every_scene(name, held):
    """The jelly stands on its base; the hand follows springs."""
    assert held_frames(load_experiment(EXAMPLES / f"{name}.toml")) == held
