"""Fixtures shared by all tests: tiny bodies in 2D and 3D, and the command line as users call it."""

from __future__ import annotations

import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent

# Set before any library is loaded: one thread per test process, and a cache of compiled forms beside pytest's own, so
# that the next run finds its forms compiled. Workers share it: one process at a time compiles, and the others wait.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ["XDG_CACHE_HOME"] = str(REPOSITORY / ".pytest_cache" / "forms")
os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")  # pictures without a display


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests first, those with the most before others, so that no worker is left with one at the end."""
    slow = Counter(item.path for item in items if item.get_closest_marker("slow"))
    items.sort(key=lambda item: -slow[item.path])


@pytest.fixture(params=[2, 3], ids=["2d", "3d"])
def dim(request: pytest.FixtureRequest) -> int:
    """2, then 3."""
    return int(request.param)


def _jelly(lower: list[float], upper: list[float], divisions: list[int], points: int):
    from softprint.runtime.body import assemble_body, frame_in_box, place_handles
    from softprint.runtime.elasticity.materials import make_material
    from softprint.runtime.mesh.box import box_mesh

    mesh = box_mesh(lower, upper, divisions)
    slab = [[-1.0] * mesh.dim, [1.0] * (mesh.dim - 1) + [1.2 * upper[-1] / divisions[-1]]]
    handles = place_handles(mesh, points, [frame_in_box(mesh, "base", slab)])
    material = make_material("stable_neo_hookean", 2e4, 0.4)
    return assemble_body(mesh, handles, material, 1000.0, name=f"box{mesh.dim}d")


@pytest.fixture(scope="session")
def jelly2d_body():
    """A block of 300 triangles, 0.1 x 0.06 m, on a rigid slab "base", with 6 point handles."""
    return _jelly([-0.05, 0.0], [0.05, 0.06], [15, 10], points=6)


@pytest.fixture(scope="session")
def jelly3d_body():
    """A block of 600 tetrahedra, 0.1 x 0.1 x 0.06 m, on a rigid slab "base", with 8 point handles."""
    return _jelly([-0.05, -0.05, 0.0], [0.05, 0.05, 0.06], [5, 5, 4], points=8)


@pytest.fixture
def jelly_body(dim, request: pytest.FixtureRequest):
    """`jelly2d_body` or `jelly3d_body`, depending on `dim`."""
    return request.getfixturevalue(f"jelly{dim}d_body")


@pytest.fixture
def softprint(tmp_path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Calls the command line in a separate process: softprint("body", "x.toml", ranks=1, timeout=120).

    Runs in an empty folder; returns the finished process, whose status is not checked.
    """

    def call(*arguments: str | Path, ranks: int = 1, timeout: float = 300.0, **environment: str):
        command = [sys.executable, "-m", "softprint.runtime.cli.main", *map(str, arguments)]
        if ranks > 1:
            command = ["mpirun", "--oversubscribe", "-n", str(ranks), *command]
        return subprocess.run(
            command,
            cwd=tmp_path,
            env={
                **os.environ,
                "PYTHONPATH": str(REPOSITORY),
                "OMPI_ALLOW_RUN_AS_ROOT": "1",
                "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
                **environment,
            },
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
            stdin=subprocess.DEVNULL,
        )

    return call


@pytest.fixture
def softprint_here(softprint, tmp_path, capsys, monkeypatch) -> Callable[..., subprocess.CompletedProcess[str]]:
    """As `softprint`, in this process where one rank is enough: a new one takes seconds to import what verbs need."""
    from softprint.runtime.cli import main

    monkeypatch.chdir(tmp_path)

    def call(*arguments: str | Path, ranks: int = 1):
        if ranks > 1:
            return softprint(*arguments, ranks=ranks)
        words = [str(argument) for argument in arguments]
        capsys.readouterr()
        status = main.main(words)
        said = capsys.readouterr()
        return subprocess.CompletedProcess(words, status, said.out, said.err)

    return call


@pytest.fixture(scope="session")
def finished_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a toy experiment in 2D; its folder `run` has all output files."""
    from softprint.runtime.cli import main
    from tests.toy_experiment import write_experiment

    folder = tmp_path_factory.mktemp("finished")
    experiment = write_experiment(folder, 2)
    experiment.write_text(experiment.read_text().replace("steps = 20", "steps = 3"))
    for verb, *options in (["body"], ["generate"], ["train"], ["simulate", "--model=bare", "--model=full"]):
        assert main.main([verb, str(experiment), "--out", str(folder / "run"), "--quiet", *options]) == 0
    return folder
