"""A truth file is only read with the colliders that it was made with."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import load_experiment
from softprint.runtime.experiment.sources import formulas_hash
from softprint.runtime.shapes import find_shape
from softprint.runtime.truth.truth_colliders import (
    FORMULAS,
    flat_table,
    require_same_colliders,
    require_same_loads,
    sampled_file_hashes,
)
from tests.toy_experiment import write_experiment, write_library_experiment


def truth_of(experiment):
    """The relevant parts of a truth made with this experiment."""
    tables = {"colliders": {spec.name: spec.model_dump(mode="json") for spec in experiment.colliders}}
    if experiment.library is not None:
        tables["library"] = experiment.library.model_dump(mode="json")
    made_from = flat_table(tables, "")
    for name in experiment.sampled_colliders:
        made_from |= sampled_file_hashes(experiment, name)
    formulas = formulas_hash(experiment, experiment.sampled_colliders)
    if formulas is not None:
        made_from[FORMULAS] = formulas
    header = SimpleNamespace(colliders=experiment.sampled_colliders, made_from=made_from)
    return SimpleNamespace(path=Path("truth.h5"), header=header)


def test_shapes_of_another_size_are_refused(tmp_path):
    path = write_library_experiment(tmp_path)
    truth = truth_of(load_experiment(path))
    require_same_colliders(truth, load_experiment(path))
    # The shapes sampled next, and other content of the file, do not change the earlier ones.
    require_same_colliders(truth, load_experiment(path, ["library.shapes=['mug']", "sampling.places=5"]))
    with pytest.raises(SoftprintError, match=r"library.size: 0.02 -> 0.03.*generate --no-resume"):
        require_same_colliders(truth, load_experiment(path, ["library.size=0.03"]))


def test_a_shape_with_another_formula_is_refused(tmp_path, monkeypatch):
    experiment = load_experiment(write_library_experiment(tmp_path))
    truth, pear = truth_of(experiment), find_shape("pear")
    thicker = replace(pear, field=lambda p: pear.field(p) - 0.01)
    monkeypatch.setattr(
        "softprint.runtime.experiment.sources.find_shape",
        lambda name: thicker if name == "pear" else find_shape(name),
    )
    with pytest.raises(SoftprintError, match="library formulas hash"):
        require_same_colliders(truth, experiment)
    del truth.header.made_from[FORMULAS]  # as in a truth that was made before it was kept there
    require_same_colliders(truth, experiment)


def test_another_mesh_is_refused(tmp_path):
    path = write_experiment(tmp_path, 3)
    truth = truth_of(load_experiment(path))
    (tmp_path / "same.stl").write_bytes((tmp_path / "ball.stl").read_bytes())
    require_same_colliders(truth, load_experiment(path, ["colliders.ball.file='same.stl'"]))
    with pytest.raises(SoftprintError, match=r"colliders\.ball\.resolution: 16 -> 24"):
        require_same_colliders(truth, load_experiment(path, ["colliders.ball.resolution=24"]))
    (tmp_path / "ball.stl").write_bytes((tmp_path / "ball.stl").read_bytes() + b"\0")
    with pytest.raises(SoftprintError, match="collider file hash"):
        require_same_colliders(truth, load_experiment(path))


def test_an_imported_truth_has_no_collider(tmp_path):
    experiment = load_experiment(write_experiment(tmp_path, 3))
    header = SimpleNamespace(colliders=("ball", "another"), made_from={"published q and z": "0123"})
    require_same_colliders(SimpleNamespace(path=Path("truth.h5"), header=header), experiment)


def test_labels_of_other_loads_are_refused(tmp_path):
    path = write_experiment(tmp_path, 3)
    tables = load_experiment(path).model_dump(mode="json", include={"contact", "dynamics"})
    truth = SimpleNamespace(path=Path("truth.h5"), header=SimpleNamespace(made_from=flat_table(tables, "")))
    # Friction and the time step are of motions.
    require_same_loads(truth, load_experiment(path, ["contact.friction=0.5", "dynamics.time_step=0.01"]))
    for change, words in (
        ("contact.stiffness=2e10", r"contact.stiffness: 10000000000.0 -> 20000000000.0"),
        ("contact.refinement=0", r"contact.refinement: 2 -> 0"),
        ("dynamics.gravity=[0, 0, 0]", r"dynamics.gravity: .* -> \[0"),
    ):
        with pytest.raises(SoftprintError, match=words):
            require_same_loads(truth, load_experiment(path, [change]))
    # As in data sets that were imported.
    require_same_loads(
        SimpleNamespace(path=truth.path, header=SimpleNamespace(made_from={})),
        load_experiment(path, ["contact.stiffness=2e10"]),
    )
