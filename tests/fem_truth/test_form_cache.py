"""The cache of compiled forms: killed compilers leave no files that block a later run."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from softprint.fem_truth.elasticity.form_cache import cache_folder, form_cache
from softprint.runtime.errors import SoftprintError

REPOSITORY = Path(__file__).resolve().parents[2]
COMPILE = """
from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.runtime.body import assemble_body, frame_in_box, place_handles
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.mesh.box import box_mesh
mesh = box_mesh([0, 0], [1, 1], [3, 3])
handles = place_handles(mesh, 3, [frame_in_box(mesh, "base", [[0, 0], [1, 0.4]])])
body = assemble_body(mesh, handles, make_material("linear", 1.0, 0.3), 1.0)
print(FullSpaceElasticity(body).energy(1.1 * mesh.points))
"""


def compiler(cache: Path) -> subprocess.Popen[str]:
    """A process that compiles three forms."""
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY), "XDG_CACHE_HOME": str(cache)}
    return subprocess.Popen(
        [sys.executable, "-c", COMPILE], env=environment, stdout=subprocess.PIPE, text=True
    )


def test_killed_while_compiling(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = cache_folder()
    killed = compiler(tmp_path)
    deadline = time.monotonic() + 60
    while not list(folder.glob("libffcx_forms*.c")):
        assert time.monotonic() < deadline
        assert killed.poll() is None
        time.sleep(0.002)
    killed.kill()
    killed.communicate()
    unfinished = [path for path in folder.glob("*.c") if not path.with_name(path.name + ".cached").exists()]
    assert len(unfinished) == 1, "killed too late to leave anything"

    again = compiler(tmp_path)
    # FFCx on its own would wait for the killed process and then fail; a minute is enough on a busy machine.
    out, _ = again.communicate(timeout=60)
    assert again.returncode == 0
    assert float(out) > 0
    assert not [path for path in folder.glob("*.c") if not path.with_name(path.name + ".cached").exists()]


def test_unfinished_forms_are_cleared_and_finished_ones_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = cache_folder()
    folder.mkdir(parents=True)
    done = ["libffcx_forms_a.c", "libffcx_forms_a.c.cached", "libffcx_forms_a.cpython-311.so"]
    for name in [*done, "libffcx_forms_b.c", "libffcx_forms_b.o"]:
        (folder / name).touch()
    with form_cache():
        assert sorted(path.name for path in folder.glob("lib*")) == done


def test_an_unusable_folder_is_reported(tmp_path, monkeypatch):
    (tmp_path / "softprint").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(SoftprintError, match="XDG_CACHE_HOME"), form_cache():
        pass
