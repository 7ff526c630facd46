"""The inputs of finished truth: a change of any of them is detected and named."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

pytest.importorskip("dolfinx")

from softprint.fem_truth.generate.plan_hash import fingerprint, refuse_changes
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import load_experiment
from softprint.runtime.shapes import find_shape
from tests.toy_experiment import write_experiment, write_library_experiment

BODY = SimpleNamespace(content_hash="the body")
MOTION = "frame,time,x,y,z,rx,ry,rz\nbase,0,0,0,{},0,0,0\n"


def changes(before: dict[str, str], after: dict[str, str]) -> list[str]:
    return [key for key in sorted({*before, *after}) if before.get(key) != after.get(key)]


def test_every_file_behind_a_truth_is_in_its_fingerprint(tmp_path):
    parts = "parts=[{shape='sphere', radius=0.01}, {shape='mesh', file='ball.stl'}]"
    union = f"{{name='union', shape='union', blend=0.001, {parts}}}"
    overrides = [
        f"colliders=[{union}, {{name='ball', shape='mesh', file='ball.stl'}}]",
        "sampling.collider='union'",
        "training.collider='union'",
        "scenes.press.tracking={file='motion.csv', stiffness=1.0, rotation_stiffness=1.0}",
    ]
    (tmp_path / "motion.csv").write_text(MOTION.format(0.0))
    path = write_experiment(tmp_path, 3)
    before = fingerprint(load_experiment(path, overrides), BODY)
    assert not changes(before, fingerprint(load_experiment(path, overrides), BODY))
    (tmp_path / "motion.csv").write_text(MOTION.format(0.01))
    moved = fingerprint(load_experiment(path, overrides), BODY)
    assert changes(before, moved) == ["scenes.press.tracking_file hash"]
    (tmp_path / "ball.stl").write_bytes((tmp_path / "ball.stl").read_bytes() + b"\0")
    # The part of the union that is sampled, and the ball that the states were recorded with.
    assert changes(moved, fingerprint(load_experiment(path, overrides), BODY)) == [
        "collider parts[1] file hash",
        "scenes.press.collider_file_ball hash",
    ]


def test_a_new_key_is_no_change(tmp_path):
    now = fingerprint(load_experiment(write_experiment(tmp_path, 3)), BODY)
    frame = '[{"name": "base", "box": [[-1.0, -1.0, -1.0], [1.0, 1.0, 0.016]]}]'
    before = {
        key: text for key, text in now.items() if key not in ("sampling.test_places", "scenes.press.tracking")
    }
    refuse_changes(tmp_path, {**before, "body.handles.frames": frame}, now)
    with pytest.raises(SoftprintError, match=r"body\.handles\.frames"):
        refuse_changes(tmp_path, {**before, "body.handles.frames": frame.replace("0.016", "0.017")}, now)
    with pytest.raises(SoftprintError, match=r"sampling\.test_places"):
        refuse_changes(tmp_path, before, {**now, "sampling.test_places": "3"})


def test_a_shape_with_another_formula_is_another_truth(tmp_path, monkeypatch):
    experiment = load_experiment(write_library_experiment(tmp_path))
    before = fingerprint(experiment, BODY)
    pear = find_shape("pear")
    thicker = replace(pear, field=lambda p: pear.field(p) - 0.01)
    monkeypatch.setattr(
        "softprint.runtime.experiment.sources.find_shape",
        lambda name: thicker if name == "pear" else find_shape(name),
    )
    after = fingerprint(experiment, BODY)
    assert changes(before, after) == ["library formulas hash"]
    with pytest.raises(SoftprintError, match="library formulas hash"):
        refuse_changes(tmp_path, before, after)
    # Shapes that are not sampled do not count, nor do inputs that an older truth has not recorded.
    monkeypatch.setattr(
        "softprint.runtime.experiment.sources.find_shape",
        lambda name: find_shape("pear" if name == "mug" else name),
    )
    assert fingerprint(experiment, BODY) == before
    refuse_changes(tmp_path, {key: text for key, text in before.items() if "formulas" not in key}, after)


def test_a_new_file_of_a_pattern_is_another_truth(tmp_path):
    """It changes which contact is of which shape, and what the shapes are for."""
    path = write_library_experiment(tmp_path)
    overrides = ["library={size=0.03, meshes=['own/*.stl']}"]
    (tmp_path / "own").mkdir()
    for name in ("a", "c", "d", "e", "f"):
        (tmp_path / "own" / f"{name}.stl").write_bytes((tmp_path / "ball.stl").read_bytes())
    before = fingerprint(load_experiment(path, overrides), BODY)
    (tmp_path / "own" / "b.stl").write_bytes((tmp_path / "ball.stl").read_bytes())
    with pytest.raises(SoftprintError, match=r'sampled colliders: \["a", "c", .* -> \["a", "b", "c"'):
        refuse_changes(tmp_path, before, fingerprint(load_experiment(path, overrides), BODY))
