"""Atomic writing, hashes, and the checks on opening a Softprint file."""

import subprocess
import sys

import h5py
import numpy as np
import pytest

from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import (
    atomic_path,
    content_hash,
    create_softprint_h5,
    fixed_text,
    open_softprint_h5,
    provenance,
    read_text,
    sources_hash,
)


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    target = tmp_path / "new" / "out.txt"
    with atomic_path(target) as path:
        path.write_text("old")

    def killed_in_the_middle():
        with atomic_path(target) as path:
            path.write_text("half of the n")
            raise RuntimeError("killed")

    with pytest.raises(RuntimeError):
        killed_in_the_middle()
    assert target.read_text() == "old"
    assert list(target.parent.iterdir()) == [target]


def test_a_folder_in_the_way_is_named(tmp_path):
    (tmp_path / "out.h5").mkdir()
    with pytest.raises(SoftprintError, match="a folder of that name"), atomic_path(tmp_path / "out.h5"):
        pass


def test_an_error_of_hdf5_names_the_file_and_not_its_temporary_name(tmp_path):
    with pytest.raises(SoftprintError) as told, atomic_path(tmp_path / "out.h5") as path:
        h5py.File(path, "r")  # it is not there
    assert str(told.value).startswith(f"cannot write {tmp_path / 'out.h5'}: ")
    assert path.name not in str(told.value)


def test_hash_sees_names_values_types_and_shapes_but_not_order():
    base = {"a": np.arange(6.0), "b": "text", "c": 3}
    assert content_hash(base) == content_hash(dict(reversed(base.items())))
    changed = [
        {**base, "a": np.arange(6.0) + 1e-15},
        {**base, "a": np.arange(6)},
        {**base, "a": np.arange(6.0).reshape(2, 3)},
        {**base, "b": "texT"},
        {"a2": base["a"], "b": "text", "c": 3},
    ]
    assert len({content_hash(content) for content in [base, *changed]}) == 6


def test_hash_ignores_memory_layout():
    array = np.arange(6.0).reshape(2, 3)
    assert content_hash({"a": array}) == content_hash({"a": np.asfortranarray(array)})


def test_hash_of_sources_sees_names_and_texts_of_programs_alone(tmp_path):
    (tmp_path / "below").mkdir()
    program = tmp_path / "below" / "program.py"
    program.write_text("a = 1")
    before = sources_hash(tmp_path)
    (tmp_path / "notes.txt").write_text("read by no one")
    assert sources_hash(tmp_path) == before
    program.write_text("a = 2")
    changed = sources_hash(tmp_path)
    assert changed != before
    program.rename(tmp_path / "program.py")
    assert sources_hash(tmp_path) not in (before, changed)


def test_provenance_names_python_and_numpy():
    assert {"python", "numpy", "scipy"} <= set(provenance())


def test_only_the_right_kind_and_version_opens(tmp_path):
    good = tmp_path / "good.h5"
    with create_softprint_h5(good, "body", 2) as file:
        file["x"] = np.arange(1000.0)
    with open_softprint_h5(good, "body", 2) as file:
        assert file["x"].shape == (1000,)
    h5py.File(tmp_path / "foreign.h5", "w").close()
    (tmp_path / "text.h5").write_text("no HDF5")
    (tmp_path / "cut.h5").write_bytes(good.read_bytes()[:3000])
    cases = [
        ("nowhere.h5", "body", 2, "no such body file"),
        ("foreign.h5", "body", 2, "not one of Softprint's"),
        ("text.h5", "body", 2, "not a readable body file"),
        ("cut.h5", "body", 2, "truncated"),
        ("good.h5", "truth", 2, "this is a body file; a truth file was expected"),
        ("good.h5", "body", 3, "version 2.*reads version 3"),
    ]
    for name, kind, version, words in cases:
        with pytest.raises(SoftprintError, match=words), open_softprint_h5(tmp_path / name, kind, version):
            pass


def test_a_missing_dataset_is_named(tmp_path):
    with create_softprint_h5(tmp_path / "a.h5", "body", 1):
        pass
    with (
        pytest.raises(SoftprintError, match=r"incomplete.*'x'"),
        open_softprint_h5(tmp_path / "a.h5", "body", 1) as file,
    ):
        file["x"]


def test_files_of_a_killed_writer_are_removed_by_the_next_write(tmp_path):
    code = (
        "import os, signal, sys; from softprint.runtime.io.files import atomic_path\n"
        "with atomic_path(sys.argv[1]) as path:\n"
        "    path.write_text('half')\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    target, other = tmp_path / "out.h5", tmp_path / "other.h5"
    for path in (target, other):
        subprocess.run([sys.executable, "-c", code, str(path)], check=False)
    assert len(list(tmp_path.iterdir())) == 2
    with atomic_path(target) as mine, atomic_path(target) as also_mine:  # of living writers nothing is taken
        mine.write_text("one")
        also_mine.write_text("two")
    assert target.read_text() == "one"
    left = [path.name for path in tmp_path.iterdir() if path != target]
    assert len(left) == 1
    assert left[0].startswith(".other.")


def test_a_full_disk_is_reported_and_leaves_no_file(tmp_path):
    code = (
        "import resource, sys; import numpy as np\n"
        "from softprint import SoftprintError; from softprint.runtime.io.files import create_softprint_h5\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))\n"
        "try:\n"
        "    with create_softprint_h5(sys.argv[1], 'body', 1) as file:\n"
        "        file['x'] = np.arange(1e5)\n"
        "except SoftprintError as error:\n"
        "    print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "x.h5")], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "cannot write" in done.stdout
    assert str(tmp_path / "x.h5") in done.stdout
    assert not list(tmp_path.iterdir())


def test_no_altered_byte_goes_unnoticed(tmp_path):
    """Bytes all over a small file in turn: the file is refused, or its content is unchanged."""
    good, bad = tmp_path / "good.h5", tmp_path / "bad.h5"
    with create_softprint_h5(good, "body", 1) as file:
        file.create_dataset("x", data=np.arange(8.0), fletcher32=True)
        file.attrs["name"] = fixed_text("jelly")
    content = good.read_bytes()
    refused = 0
    for place in range(0, len(content), 37):  # a refusal reads the file in a process of its own
        bad.write_bytes(content[:place] + bytes([content[place] ^ 0x10]) + content[place + 1 :])
        try:
            with open_softprint_h5(bad, "body", 1) as file:
                found = read_text(file.attrs, "name"), file["x"][()].tolist()
        except SoftprintError:
            refused += 1
        else:
            assert found == ("jelly", list(range(8)))
    assert refused > 10
