"""A run directory of the toy experiment in 2D and 3D, with an untrained correction beside the bare body."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.toy_experiment import write_experiment


@dataclass(frozen=True)
class ToyRun:
    """experiment: its file; out: the run directory; collider: the name of the one in its scenes."""

    experiment: Path
    out: Path
    collider: str

    def workshop(self):
        """A new one, which shares nothing with others."""
        from softprint.runtime.body import load_body
        from softprint.runtime.experiment import load_experiment
        from softprint.runtime.viewer.live import the_scene
        from softprint.runtime.viewer.session.workshop import Workshop

        experiment = load_experiment(self.experiment)
        body = load_body(self.out / "body.h5")
        return Workshop(experiment, body, the_scene(experiment, None), self.out)


def make_run(folder: Path, dim: int) -> ToyRun:
    import torch

    from softprint.runtime.cli.context import Context
    from softprint.runtime.cli.run_body import body_of_run
    from softprint.runtime.contact import PenaltyContact
    from softprint.runtime.experiment.experiment import ANY_COLLIDER
    from softprint.runtime.learned.correction_file import save_correction
    from softprint.runtime.learned.force.entry import options
    from softprint.runtime.learned.force.model import ForceModel
    from softprint.runtime.mechanics.body_mechanics import compute_mechanics
    from softprint.runtime.mechanics.mechanics_file import mechanics_path, save_mechanics

    path, out = write_experiment(folder, dim), folder / "run"
    context = Context(path, out=out, quiet=True)
    body = body_of_run(context)
    experiment = context.experiment
    mechanics = compute_mechanics(body, 200, True, experiment.dynamics.gravity)
    header = save_mechanics(mechanics_path(out, 200), mechanics, body, 200)
    torch.manual_seed(0)
    spec = next(spec for spec in experiment.training.models if spec.name == "ours")
    model = ForceModel(options(spec, body, PenaltyContact.of(experiment.contact)), body.dim, body.n_rows)
    (out / "corrections").mkdir()
    save_correction(
        out / "corrections" / "ours.safetensors",
        *("ours", model, body, ANY_COLLIDER, "", 0.0, {"untrained": "for tests"}, header.content_hash),
    )
    return ToyRun(path, out, "ball" if dim == 3 else "disc")


@pytest.fixture(scope="session")
def toy3d(tmp_path_factory: pytest.TempPathFactory) -> ToyRun:
    return make_run(tmp_path_factory.mktemp("view3d"), 3)


@pytest.fixture(scope="session")
def toy2d(tmp_path_factory: pytest.TempPathFactory) -> ToyRun:
    return make_run(tmp_path_factory.mktemp("view2d"), 2)


@pytest.fixture(params=["toy2d", "toy3d"])
def toy(request: pytest.FixtureRequest) -> ToyRun:
    """In the plane, then in space."""
    run: ToyRun = request.getfixturevalue(request.param)
    return run
