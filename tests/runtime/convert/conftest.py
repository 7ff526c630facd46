"""Motions of the toy experiments in 2D and 3D, and a shallow press of a ball recorded in memory."""

from __future__ import annotations

from pathlib import Path

import pytest

from softprint.runtime.scenes.motion_file import Motion, load_motion
from tests.toy_experiment import write_experiment


@pytest.fixture(scope="package", params=[2, 3], ids=["2d", "3d"])
def motion(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Motion:
    """16 frames of 1/50 s of a collider that is pressed in."""
    return _simulated(tmp_path_factory.mktemp("motion"), request.param)


@pytest.fixture(scope="package")
def motion3d(tmp_path_factory: pytest.TempPathFactory) -> Motion:
    """In 3D alone."""
    return _simulated(tmp_path_factory.mktemp("motion3d"), 3)


def _simulated(folder: Path, dim: int) -> Motion:
    from softprint.runtime.cli import main

    experiment = write_experiment(folder, dim)
    # Deeper than that of the experiment, which the bare subspace in 3D does not feel.
    text = experiment.read_text()
    before, held_out = text.split('name = "held_out"')
    experiment.write_text(before + 'name = "held_out"' + held_out.replace("0.075]", "0.070]"))
    for verb, *options in (["body"], ["simulate", "--model=bare"]):
        assert main.main([verb, str(experiment), "--out", str(folder / "run"), "--quiet", *options]) == 0
    return load_motion(folder / "run" / "motions" / "held_out_bare.h5")
