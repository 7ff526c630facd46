"""The path of `make demo` at toy size: body, truth on two ranks, training, simulation, report; 2D and 3D."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh

from softprint.runtime.body.body_file import load_body
from softprint.runtime.experiment import load_experiment
from softprint.runtime.experiment.experiment import ANY_COLLIDER
from softprint.runtime.learned.correction_file import read_header
from softprint.runtime.truth.truth_file import load_truth
from softprint.surrogate.data.splits import split_by_shape
from tests.toy_experiment import write_experiment, write_library_experiment


@pytest.mark.slow
def test_from_mesh_to_report(softprint_here, tmp_path, dim):
    experiment = write_experiment(tmp_path, dim)
    run = tmp_path / "run"
    steps = [
        (("body",), 1),
        (("mechanics",), 1),
        (("generate",), 2),
        (("train",), 1),
        (("simulate", *(f"--model={name}" for name in ("full", "bare", "thesis5", "mechanics", "ours"))), 1),
        (("report", *(["--no-pictures"] if dim == 2 else [])), 1),
    ]
    for (verb, *options), ranks in steps:
        done = softprint_here(verb, experiment, "--out", run, "--quiet", *options, ranks=ranks)
        assert done.returncode == 0, f"{verb}: {done.stdout}\n{done.stderr}"
    made = {path.relative_to(run).as_posix() for path in run.rglob("*") if path.is_file()}
    assert {"body.h5", "mechanics_3000.safetensors", "truth.h5", "report.html", "report.json"} <= made
    assert {f"corrections/{model}.safetensors" for model in ("thesis5", "mechanics", "ours")} <= made
    assert {
        f"motions/held_out_{model}.h5" for model in ("full", "bare", "thesis5", "mechanics", "ours")
    } <= made
    left_over = {name for name in made if Path(name).name.startswith(".") or name.endswith(".shard")}
    assert left_over <= {".generate.lock"}

    # Every number in the report is a number: nothing was divided by an empty set.
    def numbers(value):
        if isinstance(value, dict):
            for item in value.values():
                yield from numbers(item)
        elif isinstance(value, list):
            for item in value:
                yield from numbers(item)
        elif isinstance(value, float):
            yield value

    report = json.loads((run / "report.json").read_text())
    assert np.isfinite(list(numbers(report))).all()

    # A second run finds all files and does not change a byte.
    kept = ("truth.h5", "mechanics_3000.safetensors", "corrections/ours.safetensors")
    before = [(run / name).read_bytes() for name in kept]
    for (verb, *options), ranks in steps[:5]:
        assert (
            softprint_here(verb, experiment, "--out", run, "--quiet", *options, ranks=ranks).returncode == 0
        )
    assert [(run / name).read_bytes() for name in kept] == before


@pytest.mark.slow
def test_from_a_library_to_an_unseen_shape(softprint_here, tmp_path):
    experiment, run = write_library_experiment(tmp_path), tmp_path / "run"
    played = ("simulate", "--model=full", "--model=bare", "--model=ours", "--model=thesis6")
    for verb, *options in (("body",), ("generate",), ("train",), played, ("report", "--no-pictures")):
        done = softprint_here(
            verb, experiment, "--out", run, "--quiet", *options, ranks=1 + (verb == "generate")
        )
        assert done.returncode == 0, f"{verb}: {done.stdout}\n{done.stderr}"
    assert read_header(run / "corrections" / "ours.safetensors").collider == ANY_COLLIDER
    shapes = json.loads((run / "report.json").read_text())["shapes"]
    for model in ("ours", "thesis6"):
        assert set(shapes["sides"][model]) == {"learned", "validation", "testing"}
        assert (run / "motions" / f"held_out_{model}.h5").is_file()
    assert [row["shape"] for row in shapes["worst"]] == ["torus"] == shapes["testing"]
    # The error of body mechanics on an unseen round shape is some per cent, on any mesh.
    assert shapes["sides"]["mechanics"]["testing"]["squared"] < 0.05
    assert "Unseen shapes" in (run / "report.html").read_text()
    whole = softprint_here("export", experiment, "--out", run, "--quiet")
    assert whole.returncode == 1
    assert "name one with --collider" in whole.stderr
    one = softprint_here("export", experiment, "--out", run, "--quiet", "--collider", "pear")
    assert one.returncode == 0, one.stderr
    assert (run / "published" / "dataset.h5").is_file()
    resized = softprint_here(
        "train", experiment, "--out", run, "--quiet", "--no-resume", "--set", "library.size=0.03"
    )
    assert "library.size: 0.02 -> 0.03" in resized.stderr

    with load_truth(run / "truth.h5", load_body(run / "body.h5")) as truth:
        collider, roles = truth.contacts["collider"], load_experiment(experiment).library_roles
        assert truth.header.colliders == ("ball", "cushion", "pear", "torus")
        # Three states; two places per shape, one for the testing shape.
        assert np.bincount(collider).tolist() == [6, 6, 6, 3]
        split = split_by_shape(truth, 1, roles)
        of = collider[truth.samples["contact"]]
        assert set(of[split.train]) == {0, 1}
        assert set(of[split.validation]) == {2}
        assert set(truth.sample_state[split.train]) == {0, 1}
        assert set(truth.sample_state[split.validation]) == {2}
        assert set(split_by_shape(truth, 3, roles).validation) == set(
            np.flatnonzero(truth.usable & (of == 2))
        )


@pytest.mark.slow
def test_meshes_of_ones_own_are_learned_from_and_judged(softprint_here, tmp_path):
    """Five files: three to train on, one to choose by and one to judge by, beside no shape of the library."""
    experiment, run = write_library_experiment(tmp_path), tmp_path / "run"
    folder = tmp_path / "shapes"
    folder.mkdir()
    solids = {
        "bead": trimesh.creation.icosphere(subdivisions=2, radius=7.0),
        "brick": trimesh.creation.box([20.0, 30.0, 25.0]),
        "pill": trimesh.creation.capsule(height=20.0, radius=9.0),
        "chosen": trimesh.creation.cylinder(height=24.0, radius=12.0),
        "judged": trimesh.creation.cone(height=30.0, radius=14.0),
    }
    for name, solid in solids.items():
        solid.apply_translation([100.0, 0.0, 40.0])  # `centre` is for them all
        solid.export(folder / f"{name}.stl")
    table = [
        "library.shapes=[]",
        "library.meshes=['shapes/*.stl']",
        "library.validation=['shapes/chosen.stl']",
        "library.test=['shapes/judged.stl']",
        "training.models=[{name='ours'}]",
    ]
    options = [word for setting in table for word in ("--set", setting)]
    for verb in ("body", "generate", "train"):
        done = softprint_here(verb, experiment, "--out", run, "--quiet", *options)
        assert done.returncode == 0, f"{verb}: {done.stdout}\n{done.stderr}"
    assert read_header(run / "corrections" / "ours.safetensors").collider == ANY_COLLIDER
    roles = load_experiment(experiment, table).library_roles
    with load_truth(run / "truth.h5", load_body(run / "body.h5")) as truth:
        names = truth.header.colliders
        assert names == ("bead", "brick", "pill", "chosen", "judged")
        assert np.bincount(truth.contacts["collider"]).tolist() == [6, 6, 6, 6, 3]
        split = split_by_shape(truth, 1, roles)
        of = truth.contacts["collider"][truth.samples["contact"]]
        assert {names[number] for number in of[split.train]} <= {"bead", "brick", "pill"}
        assert {names[number] for number in of[split.validation]} == {"chosen"}
    judge_a_copy(softprint_here, experiment, run, tmp_path / "copy")
    (folder / "bead.stl").write_bytes((folder / "pill.stl").read_bytes())
    changed = softprint_here("train", experiment, "--out", run, "--quiet", "--no-resume", *options)
    assert changed.returncode == 1
    assert "library mesh bead file hash" in changed.stderr


def judge_a_copy(softprint_here, experiment, run, copy):
    """Of the trained correction, by a file that it never saw, with an experiment that trains nothing."""
    text = experiment.read_text()
    start, end = text.index("[library]"), text.index("[[scenes]]")
    table = "[library]\nsize = 0.02\nresolution = 12\ntest = ['shapes/judged.stl']\n"
    text = text[:start] + table + text[end:]
    judging = experiment.with_name("judging.toml")
    judging.write_text(
        "".join(part for part in tables(text) if not part.startswith(("[training", "[[training")))
    )
    shutil.copytree(run / "corrections", copy / "corrections")
    for file in (run / "body.h5", *run.glob("mechanics_*.safetensors")):
        shutil.copy(file, copy)
    played = ("simulate", "--model=full", "--model=ours")
    for verb, *options in (("generate",), played, ("report", "--no-pictures")):
        done = softprint_here(verb, judging, "--out", copy, "--quiet", *options)
        assert done.returncode == 0, f"{verb}: {done.stdout}\n{done.stderr}"
    shapes = json.loads((copy / "report.json").read_text())["shapes"]
    assert shapes["testing"] == ["judged"]
    assert set(shapes["sides"]["ours"]) == {"testing"}


def tables(text):
    """The text of an experiment cut before each of its tables."""
    return re.split(r"^(?=\[)", text, flags=re.MULTILINE)
