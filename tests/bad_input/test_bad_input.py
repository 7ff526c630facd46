"""Bad input of every kind gives a clear message and status 1, and leaves no files behind."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from softprint.runtime.cli import main
from softprint.runtime.io.files import fixed_text
from softprint.runtime.mesh import write_mesh
from softprint.runtime.mesh.box import box_mesh
from tests.bad_input.altered import alter_tensors, altered_h5
from tests.toy_experiment import write_experiment

LOCKS = {".generate.lock"}  # the lock stays: removing it could remove that of another process


def content(folder: Path) -> dict[str, bytes]:
    """All files below a folder."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.name not in LOCKS
    }


@dataclass
class Bench:
    """A toy experiment in its own folder, and the command line in this process."""

    folder: Path
    capture: pytest.CaptureFixture[str]

    @property
    def experiment(self) -> Path:
        return self.folder / "toy.toml"

    @property
    def run(self) -> Path:
        return self.folder / "run"

    def change(self, before: str, after: str) -> None:
        text = self.experiment.read_text()
        assert before in text
        self.experiment.write_text(text.replace(before, after))

    def call(self, verb: str, *options: str | Path) -> tuple[int, str]:
        """Exit status and stderr."""
        self.capture.readouterr()
        arguments = [verb, self.experiment, "--out", self.run, "--quiet", *options]
        status = main.main([str(argument) for argument in arguments])
        return status, self.capture.readouterr().err

    def refused(self, verb: str, *options: str | Path, words: tuple[str, ...]) -> str:
        """The error message of a command that must fail and must not change the folder."""
        before = content(self.folder)
        status, said = self.call(verb, *options)
        assert status == 1, said
        assert "Traceback" not in said
        for word in words:
            assert word in said, said
        assert content(self.folder) == before
        return said


@pytest.fixture
def bench2d(tmp_path, capsys) -> Bench:
    write_experiment(tmp_path, 2)
    return Bench(tmp_path, capsys)


@pytest.fixture
def bench3d(tmp_path, capsys) -> Bench:
    write_experiment(tmp_path, 3)
    return Bench(tmp_path, capsys)


@pytest.fixture
def finished(finished_run, tmp_path, capsys) -> Bench:
    shutil.copytree(finished_run, tmp_path, dirs_exist_ok=True)
    return Bench(tmp_path, capsys)


# ------------------------------------------------------------------------------------ experiment files

CONFIG = {
    "unknown key": (
        "poisson = 0.4",
        "poisson = 0.4\nyoungs = 1.0",
        ("[body.material.youngs]", "did you mean `young`?"),
    ),
    "unknown table": ("[report]", "[reprot]", ("[reprot]", "did you mean `report`?")),
    "text for a number": (
        "young = 2e4",
        'young = "soft"',
        ("[body.material.young]", "valid number", '"soft"'),
    ),
    "number for text": ('name = "toy"', "name = 7", ("[experiment.name]", "string")),
    "list for a table": ("[contact]\nstiffness = 1e10", "contact = 3", ("contact",)),
    "impossible value": ("poisson = 0.4", "poisson = 0.5", ("[body.material.poisson]", "less than 0.5")),
    "not a number": ("young = 2e4", "young = nan", ("[body.material.young]",)),
    "infinite": ("time_step = 0.02", "time_step = inf", ("[dynamics.time_step]",)),
    "negative step": ("time_step = 0.02", "time_step = -0.02", ("[dynamics.time_step]", "or equal to 0.00001")),
    "no states": ("states = 3", "states = 0", ("[sampling.states]", "greater than")),
    "missing key": ("young = 2e4\n", "", ("[body.material.young]", "is missing", "Young's modulus")),
    "no such mesh": ('mesh = "box.vtu"', 'mesh = "gone.vtu"', ("[body.mesh]", "gone.vtu")),
    "mesh is a folder": ('mesh = "box.vtu"', 'mesh = "."', ("[body.mesh]",)),
    "not TOML": ("[experiment]", "[experiment", ("not TOML", "line 2")),
    "key twice": ("young = 2e4", "young = 2e4\nyoung = 1e4", ("not TOML",)),
    "three numbers in 2D": (
        "position = [0.0, 0.085]",
        "position = [0.0, 0.0, 0.085]",
        ("scenes[0].colliders[0].keyframes[0].position", "2"),
    ),
    "solid collider in 2D": ('shape = "circle"', 'shape = "sphere"', ("[colliders[0].shape]", "2")),
    "unknown shape": ('shape = "circle"', 'shape = "cirle"', ("[colliders[0].shape]", "circle")),
    "collider that is no name of a group": (
        'name = "disc"\nshape',
        'name = "my disc/x"\nshape',
        ("[colliders[0].name]", '"my disc/x"'),
    ),
    "model called full": ('name = "ours"', 'name = "full"', ("[training.models[2].name]", "choose another name")),
    "unknown collider": (
        'colliders = [{ name = "disc"',
        'colliders = [{ name = "disk"',
        ("scenes[0].colliders[0].name", "disk", "disc"),
    ),
    "unknown frame": (
        'kinematic = ["base"]',
        'kinematic = ["bass"]',
        ("scenes[0].kinematic[0]", "bass", "base"),
    ),
    "unknown handle": (
        'role = "test"',
        'role = "test"\nsprings = [{ handle = 9, stiffness = 1.0, target = [0, 0] }]',
        ("scenes[1].springs[0].handle", "9", "4 point handles"),
    ),
    "times go back": ("time = 0.4", "time = -0.4", ("scenes[0].colliders[0].keyframes",)),
    "plane to sample with": (
        'shape = "circle"\nradius = 0.02',
        'shape = "plane"\nnormal = [0, 1]',
        ("sampling.collider", "plane"),
    ),
    "empty frame": ("box = [[-1, -1], [1, 0.007]]", "box = [[5, 5], [6, 6]]", ("base", "0 nodes")),
    "frame of everything": (
        "box = [[-1, -1], [1, 0.007]]",
        "box = [[-1, -1], [1, 1]]",
        ("base", "every node"),
    ),
    "too many handles": ("points = 4", "points = 4000", ("4000", "surface nodes")),
    "region without cells": (
        "density = 1000.0",
        "density = 1000.0\nregions = [{ box = [[5, 5], [6, 6]], young = 1.0 }]",
        ("body.material.regions[0]",),
    ),
}


@pytest.mark.parametrize("case", CONFIG)
def test_experiment_file(bench2d, case):
    before, after, words = CONFIG[case]
    bench2d.change(before, after)
    said = bench2d.refused("body", words=words)
    assert "toy.toml" in said or "body" in said or "base" in said or "handles" in said
    print(said)


@pytest.mark.parametrize(
    ("written", "words"),
    [
        (b"\x89PNG\r\n\x1a\n\x00\xff\xfe", ("not a text file",)),
        (b"", ("is missing",)),
        (b"\0" * 64, ("not TOML",)),
        (None, ("no such experiment file",)),
    ],
    ids=["binary", "empty", "zeros", "missing"],
)
def test_not_an_experiment_file(bench2d, written, words):
    bench2d.experiment.unlink()
    if written is not None:
        bench2d.experiment.write_bytes(written)
    print(bench2d.refused("body", words=("toy.toml", *words)))


def test_experiment_is_a_folder(bench2d):
    bench2d.experiment.unlink()
    bench2d.experiment.mkdir()
    bench2d.refused("body", words=("toy.toml", "directory"))


@pytest.mark.parametrize(
    "override",
    [
        "nonsense",
        "=3",
        "sampling.=3",
        "sampling.places=many",
        "sampling.nowhere=3",
        "colliders.ball.radius=1",
        "colliders[7].radius=1",
        "experiment.name.x=1",
        "body=3",
        "scenes=[]x",
        "sampling..places=1",
        "colliders=1",
        "experiment.seed=-1",
        "experiment.name='../../x'",
        "sampling.places=1e3",
        "body.mesh.x=1",
        "a=b=c",
    ],
)
def test_set_nonsense(bench2d, override):
    said = bench2d.refused("body", "--set", override, words=())
    assert override.split("=")[0].split(".")[0].split("[")[0] in said
    print(said)


def test_mesh_of_another_dimension(bench2d, bench3d):
    (bench3d.folder / "box.vtu").unlink()
    write_mesh(bench3d.folder / "box.vtu", box_mesh([-0.05, 0.0], [0.05, 0.06], [6, 4]))
    print(bench3d.refused("body", words=("box.vtu", "2", "3")))


# ----------------------------------------------------------------------------------------- body meshes


def vtu(points: object, *blocks: tuple[str, list[list[int]]]) -> Callable[[Path], None]:
    """Writes a mesh without meshio's checks."""

    def write(path: Path) -> None:
        import meshio

        meshio.write(
            path,
            meshio.Mesh(np.array(points, dtype=float), [(kind, np.array(cells)) for kind, cells in blocks]),
        )

    return write


def altered(
    change: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]],
) -> Callable[[Path], None]:
    """The block of the 3D toy with points (n, 3) and cells (m, 4) changed."""

    def write(path: Path) -> None:
        mesh = box_mesh([-0.05, -0.05, 0.0], [0.05, 0.05, 0.06], [3, 3, 4])
        points, cells = change(mesh.points.copy(), mesh.cells.copy())
        vtu(points, ("tetra", cells.tolist()))(path)

    return write


def cut(share: float) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        data = path.read_bytes()
        path.write_bytes(data[: int(share * len(data))])

    return write


def with_nan(points, cells):
    points[5, 1] = np.nan
    return points, cells


def flattened(points, cells):
    points[cells[0]] = points[cells[0, 0]]
    return points, cells


CORNERS = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [-1, -1, -1]]
MESHES = {
    "truncated": (cut(0.5), ("cannot be read as a mesh",)),
    "cut to its header": (cut(0.02), ("cannot be read as a mesh",)),
    "no bytes": (lambda path: path.write_bytes(b""), ("cannot be read as a mesh",)),
    "text": (lambda path: path.write_text("a shopping list"), ("cannot be read as a mesh",)),
    "random bytes": (
        lambda path: path.write_bytes(np.random.default_rng(0).bytes(3000)),
        ("cannot be read as a mesh",),
    ),
    "no cells": (vtu(CORNERS), ("empty",)),
    "surface only": (
        vtu(CORNERS[:4], ("triangle", [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])),
        ("triangle surface", "tetrahedra"),
    ),
    "hexahedra": (
        vtu(
            [[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)],
            ("hexahedron", [[0, 1, 3, 2, 4, 5, 7, 6]]),
        ),
        ("hexahedron", "linear tetrahedra"),
    ),
    "mixed": (
        vtu(CORNERS, ("tetra", [[0, 1, 2, 3]]), ("wedge", [[0, 1, 2, 3, 4, 5]])),
        ("mixes cells", "wedge"),
    ),
    "not finite": (altered(with_nan), ("node 5", "not finite")),
    "degenerate": (altered(flattened), ("no volume", "cell")),
    "repeated cell": (altered(lambda points, cells: (points, np.vstack([cells, cells[:1]]))), ("twice",)),
    "non-manifold": (
        vtu(CORNERS, ("tetra", [[0, 1, 2, 3], [0, 1, 2, 4], [0, 1, 2, 5]])),
        ("not a manifold",),
    ),
    "folded": (vtu([*CORNERS[:4], [0.2, 0.2, 0.9]], ("tetra", [[0, 1, 2, 3], [0, 1, 2, 4]])), ("overlap",)),
    "several pieces": (
        altered(
            lambda points, cells: (np.vstack([points, points + 1]), np.vstack([cells, cells + len(points)]))
        ),
        ("2 pieces",),
    ),
    "node that is not there": (altered(lambda points, cells: (points[:-1], cells)), ("node",)),
}


@pytest.mark.parametrize("case", MESHES)
def test_body_mesh(bench3d, case):
    write, words = MESHES[case]
    write(bench3d.folder / "box.vtu")
    print(bench3d.refused("body", words=("box.vtu", *words)))


def test_inverted_cells_are_flipped(bench3d):
    altered(lambda points, cells: (points, cells[:, [0, 1, 3, 2]]))(bench3d.folder / "box.vtu")
    assert bench3d.call("body")[0] == 0


# ------------------------------------------------------------------------------------------- colliders


def surface(vertices: object, triangles: object) -> bytes:
    """A binary STL file."""
    corners = np.asarray(vertices, dtype="<f4")[np.asarray(triangles)]
    records = np.zeros(
        len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("flags", "<u2")]
    )
    records["corners"] = corners
    return bytes(80) + np.uint32(len(corners)).tobytes() + records.tobytes()


def ball(change: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]) -> bytes:
    import trimesh

    made = trimesh.creation.icosphere(subdivisions=2, radius=0.02)
    return surface(*change(np.array(made.vertices), np.array(made.faces)))


def not_finite(vertices, triangles):
    vertices[3, 0] = np.nan
    return vertices, triangles


WHOLE = ball(lambda v, t: (v, t))
COLLIDERS = {
    "truncated": (WHOLE[: len(WHOLE) // 2], ("cut short",)),
    "cut to its header": (WHOLE[:60], ("cut short",)),
    "no bytes": (b"", ()),
    "text": (b"a shopping list", ()),
    "random bytes": (np.random.default_rng(1).bytes(3000), ()),
    "no triangles": (WHOLE[:80] + bytes(4), ("no triangles",)),
    "open": (ball(lambda v, t: (v, t[v[t].mean(axis=1)[:, 2] < 0.01])), ("open", "close it")),
    "not finite": (ball(not_finite), ("not finite",)),
    "flat": (surface([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), ("drawing is flat",)),
    "a point": (surface([[0, 0, 0]], [[0, 0, 0]]), ("one point",)),
    "non-manifold": (
        surface([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0]], [[0, 1, 2], [0, 1, 3], [1, 0, 4]]),
        ("non-manifold",),
    ),
}


@pytest.mark.parametrize("case", COLLIDERS)
def test_collider_mesh(bench3d, case):
    data, words = COLLIDERS[case]
    assert bench3d.call("body")[0] == 0
    (bench3d.folder / "ball.stl").write_bytes(data)
    print(bench3d.refused("simulate", "--model", "bare", words=("ball.stl", *words)))


def test_an_inward_collider_is_flipped_outward(tmp_path):
    from softprint.runtime.colliders.surface_mesh.mesh_collider import load_mesh_collider

    (tmp_path / "ball.stl").write_bytes(ball(lambda v, t: (v, t[:, ::-1])))
    assert load_mesh_collider(tmp_path / "ball.stl", resolution=12).sdf(np.zeros((1, 3)))[0] < 0


@pytest.mark.parametrize(
    ("shape", "words"),
    [
        ('shape = "box"\nhalf_extents = [0.01, 0.01, 0.01]', ("half_extents", "3")),
        ('shape = "capsule"\nstart = [0, 0]\nend = [0, 0, 1]\nradius = 1', ("end", "3")),
        ('shape = "polygon"\nvertices = [[0, 0], [1, 0]]', ("three", "vertices")),
        ('shape = "polygon"\nvertices = [[0, 0], [0.01, 0.01], [0.01, 0], [0, 0.01]]', ("cross each other",)),
        ('shape = "polygon"\nfile = "gone.txt"', ("gone.txt",)),
        ('shape = "polygon"\nfile = "box.vtu"', ("box.vtu",)),
        ('shape = "polygon"', ("either `vertices` or `file`",)),
        ('shape = "circle"\nradius = -1', ("radius", "greater than 0")),
        ('shape = "union"\nblend = 0.1\nparts = []', ("parts",)),
        (
            'shape = "union"\nblend = 0.01\n'
            'parts = [{ shape = "sphere", radius = 0.01 }, { shape = "circle", radius = 0.01 }]',
            ("dimension",),
        ),
    ],
)
def test_collider_table(bench2d, shape, words):
    assert bench2d.call("body")[0] == 0
    bench2d.change('shape = "circle"\nradius = 0.02', shape)
    print(bench2d.refused("simulate", "--model", "bare", words=words))


# ------------------------------------------------------------------------------------ files of the run


DAMAGE: dict[str, Callable[[bytes], bytes]] = {
    "no bytes": lambda data: b"",
    "random bytes": lambda data: np.random.default_rng(2).bytes(4000),
    "a text": lambda data: b"a shopping list\n",
    **{
        f"cut to {share:.0%}": lambda data, share=share: data[: int(share * len(data))]
        for share in (0.01, 0.3, 0.6, 0.99)
    },
}
# The command that reads each file, and the remedy in its message for a bad one.
READERS = {
    "body.h5": (["simulate", "--model=bare", "--no-resume"], "make it again"),
    "truth.h5": (["train", "--no-resume"], "make it again"),
    "corrections/ours.safetensors": (["simulate", "--model=ours"], "train it again"),
    "mechanics_3000.safetensors": (["simulate", "--model=ours"], "softprint mechanics"),
    "motions/held_out_full.h5": (["report", "--no-pictures"], "make it again"),
}


@pytest.mark.parametrize("damage", DAMAGE)
@pytest.mark.parametrize("name", READERS)
def test_damaged_file(finished, name, damage):
    command, remedy = READERS[name]
    path = finished.run / name
    path.write_bytes(DAMAGE[damage](path.read_bytes()))
    print(finished.refused(*command, words=(path.name, remedy)))


@pytest.mark.parametrize("name", READERS)
def test_missing_file(finished, name):
    (finished.run / name).unlink()
    if name == "body.h5":  # is built where it is missing
        assert finished.call(*READERS[name][0])[0] == 0
    else:
        word = "mechanics_*.safetensors" if name.startswith("mechanics") else Path(name).name
        print(finished.refused(*READERS[name][0], words=(word,)))


@pytest.mark.parametrize("name", ["body.h5", "truth.h5", "motions/held_out_full.h5"])
@pytest.mark.parametrize(
    ("attribute", "value", "words"),
    [
        ("softprint_version", 99, ("version 99", "reads version")),
        ("softprint_kind", "shopping list", ("shopping list", "expected")),
        ("softprint_kind", None, ("not one of Softprint's",)),
    ],
    ids=["version", "kind", "foreign"],
)
def test_hdf5_of_another_kind(finished, name, attribute, value, words):
    with altered_h5(finished.run / name) as file:
        del file.attrs[attribute]
        if value is not None:
            file.attrs[attribute] = fixed_text(value) if isinstance(value, str) else value
    print(finished.refused(*READERS[name][0], words=(Path(name).name, *words)))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"softprint_version": "99"}, ("version 99",)),
        ({"softprint_kind": "soup"}, ("no correction",)),
        ({"header": "{}"}, ("header", "train it again")),
        ({"header": "soup"}, ("header", "train it again")),
    ],
    ids=["version", "kind", "no header", "bad header"],
)
def test_correction_of_another_kind(finished, change, words):
    alter_tensors(finished.run / "corrections" / "ours.safetensors", change)
    finished.refused("simulate", "--model=ours", words=("ours.safetensors", *words))


def test_files_of_another_body(finished):
    """A stiffer body: the body file does not fit the experiment; when it is made again, no other file fits it."""
    finished.change("young = 2e4", "young = 3e4")
    finished.refused("simulate", "--model=bare", words=("body.h5", "material", "softprint body"))
    finished.refused("report", "--no-pictures", words=("body.h5", "material"))
    assert finished.call("body")[0] == 0
    finished.refused("simulate", "--model=ours", words=("ours.safetensors", "another body", "train it again"))
    finished.refused("train", words=("truth.h5", "another body", "generate it again"))
    finished.refused("generate", words=("truth.h5", "young: 20000.0 -> 30000.0", "--no-resume"))
    finished.refused(
        "report", "--no-pictures", words=("held_out_full.h5", "another body", "simulate the scene again")
    )


# ----------------------------------------------------------------------- order of work, names, folders


def test_commands_out_of_order(bench2d):
    assert bench2d.call("body")[0] == 0
    bench2d.refused("train", words=("truth.h5", "softprint generate"))
    bench2d.refused("simulate", "--model", "ours", words=("no model 'ours'", "bare", "softprint train"))
    bench2d.refused("report", words=("held_out_full.h5", "softprint simulate", "--model full"))
    (bench2d.run / "body.h5").unlink()
    bench2d.refused("report", words=("body.h5", "softprint body"))


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (["simulate", "--model=nobody"], ("nobody", "bare")),
        (["simulate", "--model=bare", "--model=nobody"], ("nobody", "bare")),
        (["simulate", "--scene=nowhere"], ("nowhere", "press, held_out")),
        (["simulate", "--model=../body"], ("../body",)),
        (["train", "--model=nobody"], ("nobody", "thesis5, mechanics, ours")),
        (["bench", "--scene=nowhere"], ("nowhere", "press, held_out")),
        (["bench", "--iterations=0"], ("--iterations", "at least 1")),
        (["generate", "--units=-1"], ("--units", "negative")),
        (["generate", "--time-budget=nan"], ("--time-budget",)),
    ],
    ids=" ".join,
)
def test_unknown_names(bench2d, command, words):
    assert bench2d.call("body")[0] == 0
    print(bench2d.refused(*command, words=words))


@pytest.mark.parametrize("verb", ["body", "generate", "train", "simulate", "report", "bench"])
def test_output_folder_that_cannot_be(bench2d, verb):
    bench2d.run.write_text("in the way")
    print(bench2d.refused(verb, words=("cannot make the output folder", "run")))


@pytest.mark.skipif(not os.path.ismount("/sys"), reason="no /sys here")
def test_output_folder_that_nobody_may_write(bench2d, softprint):
    """/sys is read-only even for root."""
    done = softprint("body", bench2d.experiment, "--out", "/sys/softprint")
    assert done.returncode == 1
    assert "/sys/softprint" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_unknown_verb(softprint):
    done = softprint("genrate")
    assert done.returncode == 2
    assert "genrate" in done.stderr
    assert "Traceback" not in done.stderr


def test_several_colliders_and_none_to_sample_with(bench2d):
    pytest.importorskip("dolfinx")
    before = bench2d.experiment.read_text()
    other = '\n[[colliders]]\nname = "other"\nshape = "circle"\nradius = 0.01\n'
    bench2d.experiment.write_text(before + other)
    assert bench2d.call("body")[0] == 0
    bench2d.refused("generate", words=("sampling.collider", "'disc', 'other'", "library"))
