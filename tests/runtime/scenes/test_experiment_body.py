"""The body of a run is the one that the experiment describes now, or is refused by what differs."""

from __future__ import annotations

import pytest

from softprint.runtime.body import save_body
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import load_experiment
from softprint.runtime.mesh import box_mesh, write_mesh
from softprint.runtime.scenes.experiment_body import body_of_experiment, load_body_of, recipe_of_experiment
from tests.toy_experiment import write_experiment


@pytest.mark.parametrize("with_recipe", [True, False], ids=["recipe", "no recipe"])
def test_another_body_is_refused(tmp_path, with_recipe):
    path, file = write_experiment(tmp_path, 2), tmp_path / "body.h5"
    experiment = load_experiment(path)
    save_body(file, body_of_experiment(experiment), recipe_of_experiment(experiment) if with_recipe else "")
    load_body_of(experiment, file)
    # The seed draws the states at which the error of the cubature is measured.
    load_body_of(load_experiment(path, ["experiment.seed=4"]), file)
    for change, words in (
        ("body.handles.points=5", "set of handles"),
        ("body.handles.hold='projection'", "hold"),
        ("body.material.young=3e4", "material"),
        ("body.surface.samples=9", "number of surface samples"),
        ("body.cubature.points_per_row=4", "cubature"),
    ):
        with pytest.raises(SoftprintError, match=rf"its {words} differs.*softprint body"):
            load_body_of(load_experiment(path, [change]), file)
    write_mesh(tmp_path / "box.vtu", box_mesh([-0.05, 0.0], [0.05, 0.06], [14, 10]))
    with pytest.raises(SoftprintError, match="its mesh differs"):
        load_body_of(experiment, file)
