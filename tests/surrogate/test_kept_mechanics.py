"""A body's mechanics are worked out once for all the corrections of a run directory."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from runtime.learned.correction_file import as_saved, save_correction
from runtime.learned.force.model import ForceModel, ForceModelOptions
from runtime.mechanics.body_mechanics import compute_mechanics
from surrogate.kept_mechanics import kept_mechanics

OPTIONS = ForceModelOptions((4, 4), "silu", 5e-4, 3e-3, 1e9)
GRAVITY = [0.0, -9.81]
TRAINING = {"model": {"loads": 200}, "gravity": GRAVITY}


@pytest.fixture(scope="module")
def mechanics(jelly2d_body):
    return compute_mechanics(jelly2d_body, 200, internal=True, gravity=GRAVITY)


def write(path: Path, body, mechanics) -> Path:
    model = ForceModel(OPTIONS, 2, body.n_rows)
    save_correction(path, path.stem, model, body, "any", "truth", 0.1, TRAINING, mechanics)
    return path


def test_the_mechanics_of_a_correction_serve_the_next(tmp_path, jelly2d_body, mechanics):
    path = write(tmp_path / "ours.safetensors", jelly2d_body, mechanics)
    (tmp_path / "damaged.safetensors").write_bytes(path.read_bytes()[:-100])
    kept = kept_mechanics([tmp_path / "damaged.safetensors", path], jelly2d_body, 200, GRAVITY)
    assert kept is not None
    fresh = as_saved(mechanics)
    np.testing.assert_array_equal(kept.compliance.dense(), fresh.compliance.dense())
    # Half precision of the largest entry.
    largest = np.abs(mechanics.compliance.dense()).max()
    np.testing.assert_allclose(fresh.compliance.dense(), mechanics.compliance.dense(), atol=1e-3 * largest)
    turn = rows = jelly2d_body.rest_rows
    np.testing.assert_array_equal(
        kept.internal.displacement(rows, turn), fresh.internal.displacement(rows, turn)
    )


def test_other_mechanics_do_not(tmp_path, jelly2d_body, jelly3d_body, mechanics):
    path = write(tmp_path / "ours.safetensors", jelly2d_body, mechanics)
    assert kept_mechanics([path], jelly2d_body, 100, GRAVITY) is None
    assert kept_mechanics([path], jelly2d_body, 200, [0.0, 0.0]) is None
    assert kept_mechanics([path], jelly3d_body, 200, GRAVITY) is None
    without = write(tmp_path / "without.safetensors", jelly2d_body, mechanics._replace(internal=None))
    assert kept_mechanics([without], jelly2d_body, 200, GRAVITY) is None
