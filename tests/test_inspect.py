"""What `softprint inspect` prints for every kind of file, and for foreign files."""

from __future__ import annotations

import argparse
import json
import shutil
import tomllib
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import torch

from softprint.fem_truth.generate.shards import write_shard
from softprint.runtime.body import save_body
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verbs.inspect_verb import VERB
from softprint.runtime.colliders import RigidPose, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics import KinematicHandle, PlacedCollider, Simulator
from softprint.runtime.dynamics.state_file import save_state
from softprint.runtime.errors import SoftprintError
from softprint.runtime.inspect import kind
from softprint.runtime.inspect.mesh_quality import cell_angles, mean_ratio, mesh_facts
from softprint.runtime.io.kept_json import keep
from softprint.runtime.learned.correction_file import save_correction
from softprint.runtime.learned.thesis5.model import ContactCentricModel, ContactCentricOptions
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mechanics.mechanics_file import save_mechanics
from softprint.runtime.mesh import box_mesh, write_mesh
from softprint.runtime.mesh.mesh import Mesh
from softprint.runtime.published.export import export_published
from softprint.runtime.truth.truth_file import load_truth
from softprint.surrogate.checkpoints import Checkpoint, save_checkpoint
from tests.toy_truth import PRESS, write_truth

REPOSITORY = Path(__file__).resolve().parent.parent


@dataclass(frozen=True)
class Announced:
    """An entry point as pyproject.toml has it, whether or not the package was installed since."""

    target: str

    def load(self):
        module, name = self.target.split(":")
        return getattr(import_module(module), name)


@pytest.fixture(autouse=True)
def announced(monkeypatch):
    points = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]["entry-points"]
    monkeypatch.setattr(kind, "entry_points", lambda group: [Announced(t) for t in points[group].values()])


def inspect(file: Path, **given) -> str:
    said: list[str] = []
    options = {
        "sample": None,
        "frame": None,
        "json": False,
        "experiment": False,
        "png": None,
        "colliders": None,
    }
    args = argparse.Namespace(**{**options, "file": file, **given})
    assert VERB.run(args, Context(quiet=True, rank=0, write=said.append)) == 0
    return "\n".join(said)


def facts(file: Path, **given) -> dict:
    return json.loads(inspect(file, json=True, **given))


def test_a_regular_simplex_has_the_known_angle_and_shape_one(dim) -> None:
    points = {2: [[0, 0], [1, 0], [0.5, 3**0.5 / 2]], 3: [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]}[
        dim
    ]
    cells = {2: [[0, 1, 2]], 3: [[0, 2, 1, 3]]}[dim]
    mesh = Mesh(np.array(points, dtype=float), np.array(cells))
    if mesh.cell_volumes[0] < 0:
        mesh = Mesh(mesh.points, mesh.cells[:, [0, 1, 3, 2]])
    angle = {2: 60.0, 3: np.degrees(np.arccos(1 / 3))}[dim]
    np.testing.assert_allclose(cell_angles(mesh), angle, rtol=1e-12)
    np.testing.assert_allclose(mean_ratio(mesh), 1.0, rtol=1e-12)


def test_all_numbers_of_a_box() -> None:
    box = mesh_facts(box_mesh([0.0, 0.0, 0.0], [0.2, 0.1, 0.1], [4, 2, 2]))
    assert (box["nodes"], box["tetrahedra"], box["watertight"]) == (45, 96, True)
    assert box["volume [m^3]"] == pytest.approx(2e-3, rel=1e-12)
    assert box["surface [m^2]"] == pytest.approx(0.1, rel=1e-12)
    # Kuhn's tetrahedra have angles of 45, 60 and 90 degrees.
    assert box["smallest and largest angle [degrees]"] == pytest.approx([45.0, 90.0])


def test_a_body_is_described_and_drawn(tmp_path, jelly2d_body) -> None:
    path = tmp_path / "body.h5"
    save_body(path, jelly2d_body, "a recipe")
    told = facts(path)
    assert told["kind"] == "a body"
    assert told["body"]["handles"] == {"points": 6, "frame 'base' of nodes": 32}
    assert told["mesh"]["area [m^2]"] == pytest.approx(0.006)
    assert told["hashes"] == {"content": jelly2d_body.content_hash, "recipe": "a recipe"}
    assert told["subspace"]["cubature error"]["energy"] == jelly2d_body.cubature.energy_error
    assert "numpy" in told["made with"]
    assert "watertight" in inspect(path, png=tmp_path / "body.png")
    assert picture_colours(tmp_path / "body.png") > 20


def picture_colours(path: Path) -> int:
    """Number of colours of a picture; an empty one has one."""
    from PIL import Image

    return len(np.unique(np.asarray(Image.open(path).convert("RGB")).reshape(-1, 3), axis=0))


def test_a_truth_is_described_by_sample_and_drawn(tmp_path, jelly2d_body) -> None:
    write_truth(tmp_path / "truth.h5", jelly2d_body)
    told = facts(tmp_path / "truth.h5", sample=1)
    assert told["truth"]["by status"] == {"converged": 5, "unreached": 1}
    assert told["truth"]["usable for training"] == 5
    assert told["truth"]["label-noise floor"] is None  # nothing was solved twice
    assert told["hashes"]["body"] == jelly2d_body.content_hash
    assert told["sample 1"]["status"] == "converged"
    assert told["sample 1"]["state, contact"] == [0, 0]
    assert inspect(tmp_path / "truth.h5", experiment=True) == "[experiment]"
    inspect(tmp_path / "truth.h5", sample=2, png=tmp_path / "sample.png")
    assert picture_colours(tmp_path / "sample.png") > 20
    with pytest.raises(SoftprintError, match="no sample 6; they are numbered 0 to 5"):
        inspect(tmp_path / "truth.h5", sample=6)
    with pytest.raises(SoftprintError, match="no solution to draw"):
        inspect(tmp_path / "truth.h5", sample=3, png=tmp_path / "none.png")
    with pytest.raises(SoftprintError, match="no frames, so --frame does not apply"):
        inspect(tmp_path / "truth.h5", frame=1)
    assert not (tmp_path / "none.png").exists()


def test_a_motion_is_described_by_frame_and_drawn_with_its_colliders(tmp_path) -> None:
    from softprint.runtime.cli.run_body import body_of_run
    from softprint.runtime.scenes.simulate import simulate_scene

    write_mesh(tmp_path / "box.vtu", box_mesh([0.0, 0.0], [0.1, 0.05], [10, 5]))
    (tmp_path / "toy.toml").write_text(PRESS)
    context = Context(
        tmp_path / "toy.toml", out=tmp_path / "run", quiet=True, rank=0, write=lambda text: None
    )
    played = simulate_scene(context, body_of_run(context), context.experiment.scenes[0], "bare")
    told = facts(played.path, frame=2)
    assert told["motion"]["scene, model"] == ["press", "bare"]
    assert told["motion"]["frames"] == 5
    assert told["quality"]["converged share"] == 1.0
    assert told["frame 2"]["status"] == "CONVERGED"
    assert inspect(played.path, experiment=True) == PRESS.rstrip("\n")
    inspect(played.path, png=tmp_path / "frame.png", colliders=tmp_path / "toy.toml")
    assert picture_colours(tmp_path / "frame.png") > 20
    with pytest.raises(SoftprintError, match="numbered 0 to 4"):
        inspect(played.path, frame=5)
    assert facts(tmp_path / "toy.toml")["experiment"]["colliders"] == {"ball": "circle"}
    with pytest.raises(SoftprintError, match=r"inspect the \.h5 file"):
        inspect(played.path.with_suffix(".xdmf"))


def test_a_correction_and_a_checkpoint_are_described(tmp_path, jelly2d_body) -> None:
    model = ContactCentricModel(
        ContactCentricOptions("weighted_rows", False, (8,), "tanh", "saturating", 1e-3),
        2,
        jelly2d_body.n_rows,
    )
    path = tmp_path / "ours.safetensors"
    save_correction(path, "ours", model, jelly2d_body, "ball", "abc", 0.125, {"seconds": 3.0})
    told = facts(path)
    assert told["correction"]["error on held-out states"] == 0.125
    assert told["hashes"] == {"body": jelly2d_body.content_hash, "truth": "abc"}
    assert told["options"]["widths"] == [8]
    with pytest.raises(SoftprintError, match="cannot be drawn"):
        inspect(path, png=tmp_path / "x.png")
    with pytest.raises(SoftprintError, match="does not contain the experiment"):
        inspect(path, experiment=True)
    half = tmp_path / "half.safetensors"
    save_checkpoint(
        half, Checkpoint("a run", 40, [{"step": 40, "loss": 0.5}], {"model.a": torch.zeros(3, 4)})
    )
    told = facts(half)
    assert (told["checkpoint"]["steps done"], told["checkpoint"]["weights"]) == (40, 12)
    assert told["latest"]["loss"] == 0.5


def test_a_learned_energy_is_described(tmp_path) -> None:
    errors = {"mechanics": {"handles": 0.2}, "learned": {"handles": 0.1}, "samples": 40, "converged": True}
    path = tmp_path / "energy_300.json"
    values = [0.5]
    keep(path, {"truth": "abc"}, {"energy": values, "errors": errors})
    told = facts(path)
    assert (told["energy"]["b"], told["energy"]["converged"]) == (0.5, True)
    assert told["RMS errors on held-out samples"]["handles, learned"] == 0.1
    assert told["made of"] == {"truth": "abc"}
    keep(path, {"truth": "abc"}, {"energy": None, "errors": errors})  # that of mechanics
    assert "linear mechanics" in facts(path)["energy"]["b"]
    keep(path, {"truth": "abc"}, {"energy": values[1:], "errors": errors})
    with pytest.raises(SoftprintError, match="energy is incomplete"):
        inspect(path)


def test_mechanics_are_told(tmp_path, jelly2d_body) -> None:
    mechanics = compute_mechanics(jelly2d_body, 20, condensation=True, gravity=[0.0, -9.81])
    path = tmp_path / "mechanics_20.safetensors"
    header = save_mechanics(path, mechanics, jelly2d_body, 20)
    told = facts(path)
    assert told["mechanics"]["limit of contact nodes"] == 20
    assert told["mechanics"]["gravity [m/s^2]"] == [0.0, -9.81]
    assert told["hashes"] == {"body": jelly2d_body.content_hash, "content": header.content_hash}


def test_a_state_is_told(tmp_path, jelly_body) -> None:
    dim = jelly_body.dim
    ball = PlacedCollider("ball", Sphere(0.02, dim, "ball"))
    simulator = Simulator(
        jelly_body,
        [ball],
        contact=PenaltyContact(1e10),
        mechanics=compute_mechanics(jelly_body, 100, condensation=True),
        kinematic=[KinematicHandle("base")],
    )
    aside = [0.01] * (dim - 1)  # over a node of the top, which is at 0.06 m
    above, inside = (RigidPose(np.eye(dim), np.array([*aside, height])) for height in (0.1, 0.077))
    path = tmp_path / "state.h5"
    state = simulator.rest_state(poses={"ball": above})
    save_state(path, state)
    told = facts(path)
    assert told["kind"] == "the state of a simulation"
    assert told["state"]["handle rows, dimension"] == [jelly_body.n_rows, dim]
    assert told["state"]["colliders"] == ["ball"]
    assert told["state"]["a step led to it"] is False
    assert told["condensed contact"] == {"in contact": False}

    result = simulator.step(state, {"ball": inside})
    save_state(path, result.state)
    told = facts(path)
    assert told["state"]["time [s]"] == pytest.approx(1 / 60)
    assert told["state"]["a step led to it"] is True
    assert told["condensed contact"]["in contact"] is True
    assert told["condensed contact"]["active nodes"] == {"ball": result.contacts["ball"].points}
    # The ball is 3 mm below the top: nodes give way by no more.
    assert 0 < told["condensed contact"]["largest displacement [m]"] < 3e-3
    with pytest.raises(SoftprintError, match="no frames, so --frame does not apply"):
        inspect(path, frame=0)


def test_a_shard_is_told(tmp_path) -> None:
    samples = {"status": np.array([0, 0, 5])}
    write_shard(tmp_path / "c.shard", {"contacts": {"seconds": np.array([2.5])}, "samples": samples})
    told = facts(tmp_path / "c.shard")["shard"]
    assert told["samples by status"] == {"converged": 2, "unreached": 1}
    assert told["core-seconds"] == 2.5


def test_curves_and_timings_are_described(tmp_path) -> None:
    held_out = {"rms": 0.25, "worst": 0.5, "samples": 10, "squared": 0.06}
    curves = {"model": "ours", "held_out": held_out, "noise_floor": 1e-4, "samples": 90, "left_out": 2}
    (tmp_path / "ours.json").write_text(json.dumps(curves | {"history": [{"step": 7, "loss": 0.5}]}))
    assert facts(tmp_path / "ours.json")["training"]["error on held-out states"] == {
        "rms": 0.25,
        "worst": 0.5,
    }
    errors = {"mechanics": {"handles": 0.2}, "learned": {"handles": 0.1}, "samples": 10}
    (tmp_path / "forces.json").write_text(json.dumps(curves | {"history": [], "energy": errors}))
    told = facts(tmp_path / "forces.json")["energy of contact, RMS errors on held-out samples"]
    assert told == {"handles, mechanics": 0.2, "handles, learned": 0.1}
    bench = {
        "scene": "press",
        "iterations": 2,
        "sizes": {"nodes": 9},
        "machine": {"cores": 2},
        "software": {},
    }
    (tmp_path / "bench.json").write_text(json.dumps(bench | {"speeds": [{"model": "bare", "step": 0.002}]}))
    assert facts(tmp_path / "bench.json")["model bare"] == {"step": 0.002}


def test_a_published_data_set_is_described(tmp_path, jelly2d_body) -> None:
    ball = Sphere(0.02, dim=2, name="ball")
    write_truth(tmp_path / "truth.h5", jelly2d_body)
    with load_truth(tmp_path / "truth.h5") as truth:
        export_published(tmp_path, truth, jelly2d_body, ball)
    meshes = facts(tmp_path / "meshes.h5")
    assert meshes["body box2d"]["point handles"] == 6
    assert meshes["body box2d"]["frames, nodes"] == [32]
    told = facts(tmp_path / "dataset.h5")["samples"]
    assert (told["samples"], told["different handle states"], told["unit of length"]) == (5, 2, "m")


def test_colliders_are_described() -> None:
    told = facts(REPOSITORY / "meshes/pointy.stl")["surface, in the file's units"]
    assert (told["triangles"], told["watertight"], told["as a collider"]) == (4500, True, "usable")
    assert facts(REPOSITORY / "meshes/star.txt")["polygon, in the file's units"]["corners"] == 10
    assert facts(REPOSITORY / "meshes/jelly2d.vtu")["mesh"]["triangles"] == 13710


def test_an_open_surface_is_not_a_collider(tmp_path) -> None:
    import meshio

    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    meshio.write(
        tmp_path / "sheet.stl", meshio.Mesh(square, [("triangle", np.array([[0, 1, 2], [0, 2, 3]]))])
    )
    told = facts(tmp_path / "sheet.stl")["surface, in the file's units"]
    assert told["watertight"] is False
    assert told["as a collider"].startswith("refused: ")
    assert told["area"] == pytest.approx(1.0)


def test_pictures_in_space(tmp_path) -> None:
    try:
        inspect(REPOSITORY / "meshes/pointy.stl", png=tmp_path / "x.png")
    except SoftprintError as error:
        if "no picture can be drawn here" not in str(error):
            raise
        pytest.skip("no OpenGL off screen")
    assert picture_colours(tmp_path / "x.png") > 100


FOREIGN = {
    "gone.h5": (None, "there is no such file"),
    "empty.h5": (b"", "is empty"),
    "text.h5": (b"hello", "not a file of Softprint's"),
    "cut.h5": (b"\x89HDF\r\n\x1a\n" + bytes(200), "truncated or damaged"),
    "cut.safetensors": (b"\xff" * 30, "not a readable safetensors file"),
    "list.safetensors": ((4).to_bytes(8, "little") + b"[12]", "not a readable safetensors file"),
    "other.safetensors": ((2).to_bytes(8, "little") + b"{}", "not a file of Softprint's"),
    "cut.json": (b'{"softprint_report": 1,', "not readable as JSON"),
    "bare.json": (b'{"softprint_report": 1}', "the report is incomplete"),
    "other.json": (b"[1, 2]", "not a file of Softprint's"),
    "cut.shard": (b"softprint shard 1\nabc", "truncated or altered"),
    "bad.toml": (b"a = ", "this is not TOML"),
    "bad.stl": (b"solid x\n", "bad.stl"),
    "bad.vtu": (b"<VTKFile>", "cannot be read as a mesh"),
    "notes.txt": (b"1 2\n3 4\n", "polygon"),
    "prose.txt": (b"Dear reader\n", "not a file of Softprint's"),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_foreign_files_get_a_clear_error(tmp_path, name) -> None:
    content, words = FOREIGN[name]
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(SoftprintError, match=words) as told:
        inspect(tmp_path / name)
    assert "\n" not in str(told.value)


def test_a_damaged_body_is_found(tmp_path, jelly2d_body) -> None:
    save_body(tmp_path / "body.h5", jelly2d_body)
    content = bytearray((tmp_path / "body.h5").read_bytes())
    shutil.copy(tmp_path / "body.h5", tmp_path / "whole.h5")
    (tmp_path / "body.h5").write_bytes(content[: len(content) // 2])
    with pytest.raises(SoftprintError, match="truncated or damaged"):
        inspect(tmp_path / "body.h5")
    assert facts(tmp_path / "whole.h5")["kind"] == "a body"


def test_pictures_are_png(tmp_path) -> None:
    with pytest.raises(SoftprintError, match=r"call it x\.png"):
        inspect(REPOSITORY / "meshes/star.txt", png=tmp_path / "x.jpg")
    with pytest.raises(SoftprintError, match="--colliders is for pictures"):
        inspect(REPOSITORY / "meshes/star.txt", colliders=tmp_path / "x.toml")
