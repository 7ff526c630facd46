"""The truth file: round trip, atomic writing, and clear error messages."""

from __future__ import annotations

import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from softprint.runtime.errors import SoftprintError
from softprint.runtime.truth.truth_file import TruthHeader, create_truth, load_truth
from softprint.runtime.truth.truth_schema import TABLES, UNREACHED
from tests.bad_input.altered import altered_h5, flipped


def table(name, body, n: int, rng: np.random.Generator, **given):
    """Random columns of a table, except for the given ones."""
    sizes = {"nodes": body.n_nodes, "rows": body.n_rows, "dim": body.dim}
    columns = {}
    for key, column in TABLES[name].items():
        if column.dtype == "str":
            columns[key] = [f"{key} {k}" for k in range(n)]
        else:
            columns[key] = (10 * rng.random((n, *column.row_shape(sizes)))).astype(column.dtype)
    return columns | given


def header_of(body, planned: int = 2) -> TruthHeader:
    return TruthHeader(body.content_hash, "[experiment]", 7, ("ball",), planned, {"sampling.depths": "2"})


def write(path: Path, body, planned: int = 2, change: str = "", **given) -> dict:
    """given: columns of the samples."""
    rng = np.random.default_rng(0)
    rotations = np.broadcast_to(np.eye(body.dim), (4, body.dim, body.dim))
    written = {
        "states": table("states", body, 2, rng),
        "refused": table("refused", body, 1, rng),
        "contacts": table("contacts", body, 2, rng, state=[1, 0]),
        "samples": table(
            *("samples", body, 4, rng),
            contact=[0, 0, 1, 1],
            depth_index=[0, 1, 0, 1],
            status=[0, 0, 0, UNREACHED],
            branch_flag=[True, False, False, False],
            **({"intrusion": [0.001, 0.001, np.nan, 0.001], "min_det_F": [0.4, 0.3, 0.5, 0.2]} | given),
            pose_rotation=rotations,
        ),
        "repeat": table("repeat", body, 2, rng, sample=[0, 3], spread=[0.25, np.nan]),
    }
    if change:
        written["samples"][change] = written["samples"][change] + 1
    with create_truth(path, header_of(body, planned), body) as truth:
        for name, columns in written.items():
            truth.append(name, columns)
    return written


@pytest.fixture
def truth_path(tmp_path, jelly2d_body) -> Path:
    write(tmp_path / "truth.h5", jelly2d_body)
    return tmp_path / "truth.h5"


def test_round_trip(tmp_path, jelly_body) -> None:
    written = write(tmp_path / "truth.h5", jelly_body)
    with load_truth(tmp_path / "truth.h5", jelly_body) as truth:
        assert truth.header == header_of(jelly_body)
        assert truth.complete
        for name, columns in written.items():
            stored = getattr(truth, name)
            assert len(stored) == len(columns[next(iter(columns))])
            for key, values in columns.items():
                np.testing.assert_array_equal(stored[key], np.asarray(values, dtype=stored[key].dtype))
        np.testing.assert_array_equal(truth.displacement(2), written["samples"]["displacement"][2])
        picked = truth.displacement([3, 0, 3])
        np.testing.assert_array_equal(picked, written["samples"]["displacement"][[3, 0, 3]])
        np.testing.assert_array_equal(truth.internal(1), written["states"]["internal"][1])
        np.testing.assert_array_equal(truth.sample_state, [1, 1, 0, 0])
        np.testing.assert_array_equal(truth.pose(1).translation, written["samples"]["pose_translation"][1])
        assert truth.noise_floor == 0.25


def test_samples_after_a_jump_and_failures_are_not_used(truth_path) -> None:
    with load_truth(truth_path) as truth:
        np.testing.assert_array_equal(truth.usable, [False, False, True, False])


@pytest.mark.parametrize(("column", "times_spacing"), [("intrusion", 1.01), ("min_det_F", -0.01)])
def test_pierced_and_inverted_samples_are_not_used(tmp_path, jelly2d_body, column, times_spacing) -> None:
    """Not by the sample that is usable otherwise."""
    bad = times_spacing * jelly2d_body.mesh.surface_spacing
    write(tmp_path / "truth.h5", jelly2d_body, **{column: [0.001, 0.001, bad, 0.001]})
    with load_truth(tmp_path / "truth.h5") as truth:
        found = truth.pierced if column == "intrusion" else truth.inverted
        np.testing.assert_array_equal(found, [False, False, True, False])
        assert not truth.usable.any()


def test_a_part_of_the_plan_says_so(tmp_path, jelly2d_body) -> None:
    write(tmp_path / "truth.h5", jelly2d_body, planned=9)
    with load_truth(tmp_path / "truth.h5") as truth:
        assert not truth.complete


def test_content_hash_ignores_only_what_measures_the_machine(tmp_path, jelly2d_body) -> None:
    hashes = {}
    for change in ("", "seconds", "residual"):
        write(tmp_path / f"{change}.h5", jelly2d_body, change=change)
        with load_truth(tmp_path / f"{change}.h5") as truth:
            hashes[change] = truth.content_hash
    assert hashes[""] == hashes["seconds"] != hashes["residual"]


def test_an_exception_leaves_no_file(tmp_path, jelly2d_body) -> None:
    with (
        pytest.raises(RuntimeError, match="stop"),
        create_truth(tmp_path / "truth.h5", header_of(jelly2d_body), jelly2d_body),
    ):
        raise RuntimeError("stop")
    assert not list(tmp_path.iterdir())


def test_wrong_columns_are_named(tmp_path, jelly2d_body) -> None:
    rng = np.random.default_rng(0)
    with create_truth(tmp_path / "truth.h5", header_of(jelly2d_body), jelly2d_body) as truth:
        columns = table("repeat", jelly2d_body, 1, rng)
        with pytest.raises(SoftprintError, match=r"repeat/displacement: shape \(1, 3, 2\)"):
            truth.append("repeat", columns | {"displacement": np.zeros((1, 3, 2))})
        del columns["spread"]
        with pytest.raises(SoftprintError, match=r"missing columns \['spread'\]"):
            truth.append("repeat", columns)


def test_bad_files_are_distinguished(truth_path, jelly2d_body, jelly3d_body) -> None:
    folder = truth_path.parent
    with pytest.raises(SoftprintError, match="no such truth file"):
        load_truth(folder / "nothing.h5")
    truncated = folder / "truncated.h5"
    truncated.write_bytes(truth_path.read_bytes()[:-2000])
    with pytest.raises(SoftprintError, match="truncated"):
        load_truth(truncated)
    other = folder / "other.h5"
    shutil.copy(truth_path, other)
    with altered_h5(other) as file:
        file.attrs["softprint_version"] = 99
    with pytest.raises(SoftprintError, match="version 99"):
        load_truth(other)
    shutil.copy(truth_path, other)
    with altered_h5(other) as file:
        del file["samples/depth"]
    with pytest.raises(SoftprintError, match="incomplete"):
        load_truth(other)
    with pytest.raises(SoftprintError, match="made for another body"):
        load_truth(truth_path, jelly3d_body)
    load_truth(truth_path, jelly2d_body).close()


def test_a_flipped_bit_in_a_field_is_noticed_and_named(truth_path) -> None:
    with load_truth(truth_path) as truth:
        wanted = truth.displacement(1).tobytes()
    content = truth_path.read_bytes()
    place = content.index(wanted) + 5
    truth_path.write_bytes(flipped(content, place))
    with pytest.raises(
        SoftprintError, match=r"truth\.h5.*bytes within .*samples/displacement.*make it again"
    ):
        load_truth(truth_path)


def test_damage_that_comes_while_a_truth_is_open_is_noticed_when_it_is_read(truth_path) -> None:
    with load_truth(truth_path) as truth:
        wanted = truth.displacement(1).tobytes()
    content = truth_path.read_bytes()
    with load_truth(truth_path) as truth:
        truth_path.write_bytes(flipped(content, content.index(wanted) + 5))
        truth.displacement(0)
        with pytest.raises(SoftprintError, match="'displacement' is damaged"):
            truth.displacement(1)


def test_paraview_gets_one_step_a_sample(truth_path) -> None:
    pv = pytest.importorskip("pyvista")
    reader = pv.get_reader(truth_path.with_suffix(".xdmf"))
    assert reader.time_values == [0.0, 1.0, 2.0, 3.0]
    reader.set_active_time_value(2.0)
    grid = reader.read()
    with load_truth(truth_path) as truth, h5py.File(truth_path) as file:
        np.testing.assert_array_equal(grid.point_data["contact_displacement"][:, :2], truth.displacement(2))
        np.testing.assert_array_equal(grid.points[:, :2], file["view/points_0"][()])
