"""An existing correction is not trained again; one trained by another version of the program is reported."""

import logging
from types import SimpleNamespace

import pytest

from softprint.runtime.cli.context import Context
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.experiment import load_experiment
from softprint.runtime.learned.correction_file import read_header, save_correction
from softprint.runtime.learned.force.entry import options
from softprint.runtime.learned.force.model import ForceModel
from softprint.runtime.learned.thesis5.model import ContactCentricModel, ContactCentricOptions
from softprint.runtime.scenes.playing import correction_path
from softprint.surrogate.kept_corrections import is_trained, kept_header, program_hash, recipe_of
from tests.toy_experiment import write_experiment, write_library_experiment

RECIPE = {"truth": "abc", "settings": {"seed": 7}}


@pytest.fixture
def trained(jelly2d_body, tmp_path):
    """Writes a correction as trained by a version of the program."""
    options = ContactCentricOptions("weighted_rows", False, (4,), "silu", "saturating", 1e-3)
    model = ContactCentricModel(options, 2, jelly2d_body.n_rows)

    def write(program):
        path = tmp_path / "corrections" / "ours.safetensors"
        path.parent.mkdir(exist_ok=True)
        training = {**RECIPE, "program": program, "seconds": 1.0}
        save_correction(path, "ours", model, jelly2d_body, "ball", "abc", 0.1, training)
        return path

    return write


def test_a_correction_of_this_program_is_kept_silently(trained, caplog):
    path = trained(program_hash())
    with caplog.at_level(logging.WARNING):
        assert kept_header(path, RECIPE, read_header) is not None
    assert not caplog.messages


def test_a_correction_of_another_program_is_kept_with_a_warning(trained, caplog):
    path = trained("of yesterday")
    with caplog.at_level(logging.WARNING):
        assert kept_header(path, RECIPE, read_header) is not None
    (message,) = caplog.messages
    assert "another version of the program: --no-resume trains it again" in message


def test_a_correction_of_another_recipe_is_not_kept(trained):
    path = trained(program_hash())
    assert kept_header(path, {**RECIPE, "truth": "other"}, read_header) is None


def test_what_shapes_are_for_is_part_of_the_recipe(tmp_path):
    """A shape that was learned from and is to judge now makes another correction; so does a frame that is let go."""
    path = write_library_experiment(tmp_path)

    def recipe(*overrides):
        experiment = load_experiment(path, overrides)
        spec = next(model for model in experiment.training.models if model.name == "ours")
        return recipe_of(experiment, spec, "abc", tmp_path)

    (tmp_path / "own").mkdir()
    for name in "abc":
        (tmp_path / "own" / f"{name}.stl").write_bytes((tmp_path / "ball.stl").read_bytes())
    table = "library={{size=0.03, meshes=['own/*.stl'], validation=['own/{}.stl'], test=['own/{}.stl']}}"
    assert recipe(table.format("a", "b")) == recipe(table.format("a", "b"))
    assert recipe(table.format("a", "b")) != recipe(table.format("b", "a"))
    assert recipe() != recipe("scenes.press.kinematic=[]")


def test_a_correction_with_other_mechanics_is_not_kept(tmp_path, jelly2d_body, caplog):
    context = Context(write_experiment(tmp_path, 2), out=tmp_path / "run", quiet=True, rank=0)
    spec = next(model for model in context.experiment.training.models if model.name == "ours")
    model = ForceModel(options(spec, jelly2d_body, PenaltyContact(1e9)), 2, jelly2d_body.n_rows)
    training = {**recipe_of(context.experiment, spec, "abc", context.out_dir), "program": program_hash()}
    path = correction_path(context.out_dir, "ours")
    path.parent.mkdir()
    save_correction(path, "ours", model, jelly2d_body, "ball", "abc", 0.1, training, "own")

    def of_run(content_hash):
        return SimpleNamespace(get=lambda contact_nodes: (SimpleNamespace(content_hash=content_hash), None))

    assert is_trained(context, spec, "abc", of_run("own"))
    assert not is_trained(context, spec, "of another truth", of_run("own"))
    assert not caplog.messages
    assert not is_trained(context, spec, "abc", of_run("other"))
    assert "was trained with different body mechanics; training it again" in caplog.text
