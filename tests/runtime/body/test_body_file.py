"""The body file: round trip, and clear errors for damaged files."""

import numpy as np
import pytest

from softprint.runtime.body import assemble_body, frame_in_box, load_body, place_handles, save_body
from softprint.runtime.elasticity import make_material
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import fixed_text
from softprint.runtime.mesh import box_mesh
from tests.bad_input.altered import altered_h5


@pytest.fixture(scope="module", params=[(2, True), (3, True), (2, False)], ids=["2d", "3d", "no frame"])
def body(request):
    dim, framed = request.param
    mesh = box_mesh([0.0] * dim, [0.1] * dim, [5, 4, 4][:dim])
    frames = [frame_in_box(mesh, "base", [[-1.0] * dim, [0.03] + [1.0] * (dim - 1)])] if framed else []
    material = make_material("neo_hookean", np.linspace(1e4, 2e4, mesh.n_cells), 0.4)
    return assemble_body(mesh, place_handles(mesh, 5, frames), material, 1000.0, name="a box")


def test_body_round_trip(body, tmp_path):
    save_body(tmp_path / "body.h5", body)
    again = load_body(tmp_path / "body.h5")
    assert again.content_hash == body.content_hash
    assert again.name == "a box"
    assert again.material.model == "neo_hookean"
    assert [frame.name for frame in again.handles.frames] == [frame.name for frame in body.handles.frames]
    assert again.cubature.force_error == body.cubature.force_error
    for part in ("basis", "density", "node_mass", "reduced_mass"):
        np.testing.assert_array_equal(getattr(again, part), getattr(body, part))
    np.testing.assert_array_equal(again.material.young, body.material.young)
    np.testing.assert_array_equal(again.rest_rows, body.rest_rows)
    np.testing.assert_array_equal(again.surface.areas, body.surface.areas)
    np.testing.assert_array_equal(again.cubature.weights, body.cubature.weights)


def alter_basis(file):
    file["basis"][0, 0] += 1e-9


def alter_name(file):
    del file["cubature/weights"]


def alter_hash(file):
    del file.attrs["file_hash"]


def alter_model(file):
    file["material"].attrs["model"] = fixed_text("linear")


def alter_version(file):
    file.attrs["softprint_version"] = 99


@pytest.mark.parametrize(
    ("alter", "words"),
    [
        (alter_basis, "altered or damaged"),
        (alter_model, "altered or damaged"),
        (alter_name, "incomplete.*weights"),
        (alter_hash, "incomplete.*file_hash"),
        (alter_version, "version 99"),
    ],
)
def test_altered_files_are_refused(body, tmp_path, alter, words):
    path = tmp_path / "body.h5"
    save_body(path, body)
    with altered_h5(path) as file:
        alter(file)
    with pytest.raises(SoftprintError, match=words):
        load_body(path)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_truncated_files_are_refused(body, tmp_path, share):
    save_body(tmp_path / "whole.h5", body)
    data = (tmp_path / "whole.h5").read_bytes()
    (tmp_path / "cut.h5").write_bytes(data[: int(share * len(data))])
    with pytest.raises(SoftprintError, match=r"cut\.h5.*make it again"):
        load_body(tmp_path / "cut.h5")


def test_missing_file_is_named(tmp_path):
    with pytest.raises(SoftprintError, match=r"nowhere\.h5: there is no such body file"):
        load_body(tmp_path / "nowhere.h5")
