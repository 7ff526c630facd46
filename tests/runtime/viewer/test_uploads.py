"""Shapes to choose from, and files that are dropped in."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from softprint.runtime.colliders.build import build_collider
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import load_experiment
from softprint.runtime.viewer.page.shape_choices import choices, renamed, table_of, table_of_upload
from softprint.runtime.viewer.page.solids import drawn_solid


def stl(mesh: trimesh.Trimesh) -> bytes:
    return mesh.export(file_type="stl")


def test_every_shape_has_its_size_and_can_be_drawn(toy):
    experiment = load_experiment(toy.experiment)
    names = choices(experiment)
    assert toy.collider in names
    assert {"box", "capsule", "cone"} < set(names)
    assert ("torus" in names) == (experiment.dim == 3)
    for name in names[:8]:
        collider = build_collider(table_of(experiment, name, 0.015), experiment.base_dir)
        if name != toy.collider:
            assert collider.size == pytest.approx(0.015, rel=0.02)
        vertices, faces = drawn_solid(collider, 0.1)
        assert vertices.shape[1] == faces.shape[1] == 3
        assert faces.max() < len(vertices)
        # On the surface, or in 2D within it; a tenth of the size: of the grid that a formula is drawn on.
        assert collider.sdf(vertices[:, : collider.dim]).max() < 2e-3


@pytest.mark.parametrize(("name", "size"), [("sphere", np.nan), ("box", -1.0), ("no such shape", 0.01)])
def test_shapes_that_are_none(toy3d, name, size):
    with pytest.raises(SoftprintError):
        table_of(load_experiment(toy3d.experiment), name, size)


def test_a_second_one_gets_a_name_of_its_own(toy3d):
    table = table_of(load_experiment(toy3d.experiment), "torus", 0.02)
    again = renamed(table, {"torus"})
    assert again.name == "torus_2"
    assert build_collider(again).name == "torus_2"


def test_an_upload_is_saved_and_centred(tmp_path):
    box = trimesh.creation.box(extents=[40.0, 20.0, 20.0])  # mm, somewhere
    box.apply_translation([500.0, 0.0, 0.0])
    table = table_of_upload(tmp_path, "my box.stl", stl(box), 0.03)
    assert table.name == "my_box"
    collider = build_collider(table)
    assert collider.size == pytest.approx(0.03, rel=0.02)
    assert np.allclose(0.5 * (collider.lower + collider.upper), 0.0, atol=2e-3)
    # The same file again is the same; another of its name is another.
    assert table_of_upload(tmp_path, "my box.stl", stl(box), 0.03).name == "my_box"
    assert table_of_upload(tmp_path, "my box.stl", stl(trimesh.creation.icosphere()), 0.03).name == "my_box_2"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("evil.py", b"import os"),
        ("../../../../tmp/evil.stl", b"solid\nendsolid"),
        ("empty.stl", b""),
        ("noise.ply", bytes(range(256)) * 50),
        ("huge.ply", b"ply\nformat ascii 1.0\nelement vertex 999999999999\nproperty float x\nend_header\n"),
        ("\x00.obj", b"v 0 0 nan\nf 1 1 1\n"),
        ("open.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
    ],
)
def test_bad_uploads_are_refused_and_leave_nothing(tmp_path, name, content):
    folder = tmp_path / "a" / "b" / "uploads"
    with pytest.raises(SoftprintError):
        table_of_upload(folder, name, content, 0.02)
    assert not folder.exists() or not list(folder.iterdir())
    assert (
        [path.name for path in (tmp_path / "a").iterdir()] in ([], ["b"])
        if (tmp_path / "a").exists()
        else True
    )
