"""`softprint report` on a toy run: it writes both files, and clear messages if something is missing."""

import json
import os
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("jinja2")
pytest.importorskip("matplotlib")

from softprint.fem_truth.report import make
from softprint.fem_truth.report.made_report import MadeReport
from softprint.fem_truth.report.make import make_report
from softprint.fem_truth.report.measurements.solves import FrameSolves, SolveStore
from softprint.fem_truth.report.page import look_up
from softprint.runtime.body import build_body, save_body
from softprint.runtime.cli.context import Context
from softprint.runtime.colliders import RigidPose
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.schema.report import ReportSpec
from softprint.runtime.mesh import write_mesh
from softprint.runtime.mesh.box import box_mesh
from softprint.runtime.scenes.simulate import simulate_scene

EXPERIMENT = """
[experiment]
name = "toy"
[body]
mesh = "block.vtu"
[body.handles]
points = 6
frames = [{ name = "base", box = [[-1, -1], [1, 0.0075]] }]
[body.material]
young = 2e4
poisson = 0.4
density = 1000.0
[[colliders]]
name = "ball"
shape = "circle"
radius = 0.02
[contact]
stiffness = 1e9
friction = 0.0
[dynamics]
gravity = [0, -9.81]
[report]
frames = 3
[[scenes]]
name = "test"
role = "test"
duration = 0.2
kinematic = ["base"]
[[scenes.colliders]]
name = "ball"
keyframes = [{ time = 0.0, position = [0.0, 0.085] }, { time = 0.15, position = [0.0, 0.073] }]
"""


@pytest.fixture(scope="module")
def toy(tmp_path_factory) -> Path:
    """A folder with the experiment and a run directory with the body and two motions."""
    folder = tmp_path_factory.mktemp("toy")
    write_mesh(folder / "block.vtu", box_mesh([-0.05, 0.0], [0.05, 0.06], [15, 9]))
    (folder / "toy.toml").write_text(EXPERIMENT)
    context = context_of(folder, folder / "run")
    experiment = context.experiment
    body = build_body(experiment.body, experiment.base_dir, experiment.seed)
    save_body(folder / "run" / "body.h5", body)
    for model in ("bare", "full"):
        simulate_scene(context, body, experiment.scenes[0], model)
    return folder


def context_of(folder: Path, out: Path, *overrides: str) -> Context:
    out.mkdir(exist_ok=True)
    return Context(folder / "toy.toml", overrides, out, quiet=True, write=lambda text: None)


def reports(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*") if re.search("report|npz", path.name))


def test_report_of_a_toy_run(toy, monkeypatch):
    made = make_report(context_of(toy, toy / "run"))
    summary = json.loads(made.numbers.read_text())
    errors = summary["scenes"][0]["errors_solved"]
    assert errors["bare"]["relative_rms"] == 1.0
    assert errors["full"]["relative_rms"] == 0.0
    # Frictionless and slow, so that only a little inertia remains besides contact and internal deformation.
    assert errors["statics"]["relative_rms"] < 0.3
    # Exact contact without internal deformation is worse: on this coarse toy nearly all is internal.
    assert errors["statics"]["relative_rms"] < errors["truth"]["relative_rms"]
    assert summary["contact_displacement"]["bare"] == 1.0
    assert summary["timings"]["bare"]["cost_of_bare"] == 1.0
    assert [note for note in summary["notes"] if "softprint generate" in note]
    assert [note for note in summary["notes"] if "softprint train" in note]
    html = made.page.read_text()
    found = re.findall(r'<data value="([^"]+)" data-key="([^"]+)">', html)
    assert len(found) > 50
    assert all(float(value) == look_up(summary, key) for value, key in found)
    assert html.count("<img") == html.count('src="data:image/webp')

    def again(*arguments):
        raise AssertionError("a frame that was solved is solved again")

    monkeypatch.setattr(make, "solve_frame", again)
    before = made.numbers.read_text()
    make_report(context_of(toy, toy / "run"), pictures=False)
    errors_again = json.loads(made.numbers.read_text())["errors_solved"]
    assert errors_again == json.loads(before)["errors_solved"]
    assert "<img" not in made.page.read_text()


def test_a_plane_can_be_what_a_scene_presses_with(tmp_path):
    """It has no bounds."""
    write_mesh(tmp_path / "block.vtu", box_mesh([-0.05, 0.0], [0.05, 0.06], [15, 9]))
    text = EXPERIMENT.replace('shape = "circle"\nradius = 0.02', 'shape = "plane"\nnormal = [0, -1]')
    text = text.replace("[[colliders]]", '[sampling]\ncollider = "tip"\n[[colliders]]', 1)
    text += '[[colliders]]\nname = "tip"\nshape = "circle"\nradius = 0.02\n'
    (tmp_path / "toy.toml").write_text(text.replace("0.085]", "0.062]").replace("0.073]", "0.058]"))
    context = context_of(tmp_path, tmp_path / "run")
    body = build_body(context.experiment.body, context.experiment.base_dir, context.experiment.seed)
    save_body(tmp_path / "run" / "body.h5", body)
    for model in ("bare", "full"):
        simulate_scene(context, body, context.experiment.scenes[0], model)
    summary = json.loads(make_report(context, pictures=False).numbers.read_text())
    assert 0.0 < summary["scenes"][0]["errors_solved"]["statics"]["relative_rms"] < 1.0


def test_a_model_that_is_not_trained_has_no_headline():
    """Not the figures of another one under its name."""
    asked = SimpleNamespace(path="toy.toml", report=ReportSpec(model="gone"))
    by_default = SimpleNamespace(path="toy.toml", report=ReportSpec())
    with pytest.raises(SoftprintError, match=r"\[report.model\] 'gone' is not trained; there are mechanics, thesis5"):
        make._judged_model(asked, SimpleNamespace(trained={"thesis5": 0, "mechanics": 0}))
    assert make._judged_model(by_default, SimpleNamespace(trained={"mechanics": 0})) == "mechanics"
    assert make._judged_model(asked, SimpleNamespace(trained={})) is None


def test_a_report_is_kept_until_something_that_it_is_made_from_changes(toy, tmp_path):
    run = copy_of_run(toy, tmp_path)

    def kept(*overrides, pictures=False, resume=True):
        return MadeReport.kept(replace(context_of(toy, run, *overrides), resume=resume), pictures)

    assert kept() is None
    made = make_report(context_of(toy, run), pictures=False)
    assert kept() == made  # with the same summary lines
    assert kept(resume=False) is None
    assert kept(pictures=True) is None
    assert kept("report.frames=2") is None
    at = (run / "motions" / "test_bare.h5").stat()
    os.utime(run / "motions" / "test_bare.h5")  # as written anew
    assert kept() is None
    os.utime(run / "motions" / "test_bare.h5", ns=(at.st_atime_ns, at.st_mtime_ns))
    assert kept() == made
    numbers = made.numbers.read_text()
    made.numbers.write_text("{")
    assert kept() is None
    made.numbers.write_text(numbers)
    made.page.unlink()
    assert kept() is None


def test_an_interrupted_report_leaves_finished_solves_and_no_page(toy, tmp_path, monkeypatch):
    run = copy_of_run(toy, tmp_path)
    kept = SolveStore.save
    calls = []

    def save_then_stop(self, *arguments):
        kept(self, *arguments)
        calls.append(arguments[0])
        if len(calls) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(SolveStore, "save", save_then_stop)
    with pytest.raises(KeyboardInterrupt):
        make_report(context_of(toy, run), pictures=False)
    assert reports(run) == [f"frame_{frame:05d}.npz" for frame in calls]


def test_no_altered_byte_of_a_stored_solve_goes_unnoticed(tmp_path):
    store, full, pose = SolveStore(tmp_path, "context"), np.zeros((3, 2)), RigidPose.identity(2)
    solves = FrameSolves(np.ones((3, 2)), np.full((3, 2), 2.0), np.full((3, 2), 3.0), 0.5, "")
    store.save(4, full, pose, solves)
    path = next(tmp_path.glob("*.npz"))
    whole = path.read_bytes()
    for place in range(len(whole)):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << (place % 8)
        path.write_bytes(damaged)
        found = store.load(4, full, pose)  # the archive stores some data twice: not all damage matters
        assert found is None or all(
            np.array_equal(value, vars(solves)[name]) for name, value in vars(found).items()
        )


@pytest.mark.parametrize(
    ("absent", "verb"), [("body.h5", "softprint body"), ("motions/test_full.h5", "softprint simulate")]
)
def test_what_is_missing_is_named_with_its_remedy(toy, tmp_path, absent, verb):
    run = copy_of_run(toy, tmp_path)
    (run / absent).unlink()
    with pytest.raises(SoftprintError, match=re.escape(verb)) as error:
        make_report(context_of(toy, run))
    assert Path(absent).name in str(error.value)
    assert reports(run) == []


def test_an_experiment_without_a_held_out_scene_is_refused(toy, tmp_path):
    run = copy_of_run(toy, tmp_path)
    text = EXPERIMENT.replace('role = "test"', 'role = "record"')
    (tmp_path / "record.toml").write_text(text.replace("block.vtu", str(toy / "block.vtu")))
    with pytest.raises(SoftprintError, match='role = "test"'):
        make_report(Context(tmp_path / "record.toml", (), run, quiet=True, write=lambda line: None))


def test_a_scene_that_full_space_cannot_simulate_is_left_out_with_a_note(toy, tmp_path):
    run = copy_of_run(toy, tmp_path)
    fall = """
[[scenes]]
name = "fall"
role = "test"
duration = 0.2
kinematic = ["base"]
colliders = [{ name = "ball", density = 500.0, position = [0.0, 0.085] }]
"""
    (tmp_path / "both.toml").write_text(EXPERIMENT.replace("block.vtu", str(toy / "block.vtu")) + fall)
    made = make_report(
        Context(tmp_path / "both.toml", (), run, quiet=True, write=lambda line: None), pictures=False
    )
    summary = json.loads(made.numbers.read_text())
    assert [scene["name"] for scene in summary["scenes"]] == ["test"]
    assert [note for note in summary["notes"] if "\u201cfall\u201d is not evaluated" in note]


def test_a_motion_cut_short_is_refused_and_no_page_is_written(toy, tmp_path):
    run = copy_of_run(toy, tmp_path)
    path = run / "motions" / "test_full.h5"
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(SoftprintError, match=r"test_full\.h5"):
        make_report(context_of(toy, run))
    assert reports(run) == []


def copy_of_run(toy: Path, target: Path) -> Path:
    run = target / "run"
    (run / "motions").mkdir(parents=True)
    for name in ("body.h5", "motions/test_full.h5", "motions/test_bare.h5"):
        (run / name).write_bytes((toy / "run" / name).read_bytes())
    return run
