"""The learned energy of a run is learned once, and again where something that it depends on has changed."""

from types import SimpleNamespace

import numpy as np
import pytest

from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.surrogate.force.energy import EnergyErrors
from softprint.surrogate.force.kept_energy import energy_path, kept_energy

ENERGY = LearnedEnergy.of((0.5,))
ERRORS = EnergyErrors({"handles": 0.2}, {"handles": 0.1}, 40)


@pytest.fixture
def run(tmp_path):
    """What training knows of a run, and how often it learned an energy there."""
    told = []
    context = SimpleNamespace(
        out_dir=tmp_path, resume=True, seed=7, experiment=SimpleNamespace(scenes=[]), say=told.append
    )
    data = SimpleNamespace(
        context=context,
        truth=SimpleNamespace(content_hash="abc"),
        split=SimpleNamespace(whole=np.arange(8)),
        mechanics=SimpleNamespace(get=lambda nodes: (SimpleNamespace(content_hash=f"of {nodes}"), None)),
    )
    spec = SimpleNamespace(name="ours", contact_nodes=300, static_condensation=True, added_to="")
    options = SimpleNamespace(law=PenaltyContact(1e10), band=2e-3)
    learned = []

    def learn(found=(ENERGY, ERRORS)):
        def once():
            learned.append(1)
            return found

        return kept_energy(data, spec, options, once)

    return SimpleNamespace(data=data, spec=spec, options=options, learn=learn, learned=learned, told=told)


@pytest.mark.parametrize("energy", [ENERGY, None], ids=["learned", "that of mechanics"])
def test_it_is_learned_once(run, energy):
    first = run.learn((energy, ERRORS))
    assert run.learn() == first == (energy, ERRORS)
    assert len(run.learned) == 1
    assert "kept" in run.told[-1]


def test_a_truth_without_forces_leaves_no_file(run):
    assert run.learn(None) is None
    assert not energy_path(run.data.context.out_dir, 300).exists()


CHANGES = {
    "truth": lambda run: setattr(run.data.truth, "content_hash", "other"),
    "samples": lambda run: setattr(run.data.split, "whole", np.arange(4)),
    "seed": lambda run: setattr(run.data.context, "seed", 8),
    "mechanics": lambda run: setattr(
        run.data.mechanics, "get", lambda nodes: (SimpleNamespace(content_hash="other"), None)
    ),
    "condensation": lambda run: setattr(run.spec, "static_condensation", False),
    "stiffness": lambda run: setattr(run.options, "law", PenaltyContact(2e10)),
    "band": lambda run: setattr(run.options, "band", 1e-3),
    "no resume": lambda run: setattr(run.data.context, "resume", False),
    "held frame": lambda run: setattr(
        run.data.context.experiment, "scenes", [SimpleNamespace(kinematic=["base"])]
    ),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_it_is_learned_again_where_something_has_changed(run, change):
    run.learn()
    change(run)
    run.learn()
    assert len(run.learned) == 2


@pytest.mark.parametrize("text", ["{", "[1]", '{"made_of": 3}'])
def test_a_damaged_file_is_replaced(run, text):
    run.learn()
    path = energy_path(run.data.context.out_dir, 300)
    whole = path.read_text()
    path.write_text(text)
    assert run.learn() == (ENERGY, ERRORS)
    assert path.read_text() == whole


def test_values_that_are_no_energy_are_learned_again(run):
    run.learn()
    path = energy_path(run.data.context.out_dir, 300)
    whole = path.read_text()
    path.write_text(whole.replace(str(ENERGY.values[-1]), "1e999"))
    assert run.learn() == (ENERGY, ERRORS)
    assert path.read_text() == whole
