"""A correction that is there is not trained again, but what learned it is told apart from what would now."""

import logging
from types import SimpleNamespace

import pytest

from runtime.learned.correction_file import save_correction
from runtime.learned.thesis5.model import ContactCentricModel, ContactCentricOptions
from surrogate import run_training

RECIPE = {"truth": "abc", "settings": {"seed": 7}}


@pytest.fixture
def trained(jelly2d_body, tmp_path):
    """Writes a correction that was learned by a program."""
    options = ContactCentricOptions("weighted_rows", False, (4,), "silu", "saturating", 1e-3)
    model = ContactCentricModel(options, 2, jelly2d_body.n_rows)

    def write(program):
        path = tmp_path / "corrections" / "ours.safetensors"
        path.parent.mkdir(exist_ok=True)
        training = {**RECIPE, "program": program, "seconds": 1.0}
        save_correction(path, "ours", model, jelly2d_body, "ball", "abc", 0.1, training)
        return SimpleNamespace(out_dir=tmp_path)

    return write


def test_that_of_this_program_is_kept_without_a_word(trained, caplog):
    context = trained(run_training._program())
    with caplog.at_level(logging.WARNING):
        assert run_training._is_done(context, "ours", RECIPE)
    assert not caplog.messages


def test_that_of_another_program_is_kept_and_told(trained, caplog):
    context = trained("of yesterday")
    with caplog.at_level(logging.WARNING):
        assert run_training._is_done(context, "ours", RECIPE)
    (message,) = caplog.messages
    assert "another version of the program: --no-resume learns it again" in message


def test_that_of_another_recipe_is_not(trained):
    context = trained(run_training._program())
    assert not run_training._is_done(context, "ours", {**RECIPE, "truth": "other"})
