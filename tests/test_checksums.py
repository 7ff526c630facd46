"""Every altered byte is detected: in numbers, texts, gaps and the checksums themselves; the error says where."""

from __future__ import annotations

import os
import re
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch

from softprint.fem_truth.generate.shards import DamagedShard, read_shard, write_shard
from softprint.runtime.body import load_body
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io import h5_contents
from softprint.runtime.io.files import create_softprint_h5, open_softprint_h5
from softprint.runtime.io.seal import BLOCK, Damage, Unsealed, damage, seal
from softprint.runtime.io.torch_file import load_tensors, save_tensors
from softprint.runtime.learned.correction_file import read_header
from softprint.runtime.mechanics.mechanics_file import read_mechanics_header
from softprint.runtime.scenes.motion_file import load_motion
from softprint.runtime.truth.truth_file import load_truth
from softprint.surrogate.checkpoints import Checkpoint, load_checkpoint, save_checkpoint

FILES: dict[str, Callable[[Path], object]] = {
    "body.h5": load_body,
    "truth.h5": lambda path: load_truth(path).close(),
    "motions/held_out_full.h5": load_motion,
    "corrections/ours.safetensors": read_header,
    "mechanics_3000.safetensors": read_mechanics_header,
}


@contextmanager
def altered(path: Path, place: int, mask: int) -> Iterator[None]:
    """Alter one byte of a file in place, and restore it."""
    with path.open("r+b", buffering=0) as file:
        good = os.pread(file.fileno(), 1, place)
        os.pwrite(file.fileno(), bytes([good[0] ^ mask]), place)
        yield
        os.pwrite(file.fileno(), good, place)


def is_whole(path: Path) -> bool:
    try:
        return not damage(path)
    except Unsealed:
        return False


def places(path: Path, count: int) -> list[tuple[int, int]]:
    """Offsets all over a file, and the change of the byte there: a single bit, or any other change."""
    rng = np.random.default_rng(0)
    masks = np.where(rng.random(count) < 0.5, 1 << rng.integers(8, size=count), rng.integers(1, 256, count))
    return list(zip(rng.integers(path.stat().st_size, size=count).tolist(), masks.tolist(), strict=True))


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """A file with groups, attributes, a compressed dataset, and a plain one without its own checksums."""
    path = tmp_path / "small.h5"
    with create_softprint_h5(path, "body", 1) as file:
        file.create_dataset("a/packed", data=np.arange(300.0), compression="gzip", fletcher32=True)
        file["a/plain"] = np.arange(50)
        file["a"].attrs["length"] = 0.1
    return path


def test_every_byte_of_a_small_file(small: Path) -> None:
    assert is_whole(small)
    size = small.stat().st_size
    for place in range(size):
        with altered(small, place, 1 << place % 8):
            assert not is_whole(small), place
    assert is_whole(small)
    for place in range(0, size - 64, 150):  # 64: of the last bytes a process of its own has to find out
        with (
            altered(small, place, 0x20),
            pytest.raises(SoftprintError, match=r"small\.h5.*damaged.*make it again"),
            open_softprint_h5(small, "body", 1),
        ):
            pass


@pytest.mark.parametrize("name", FILES)
def test_two_thousand_bytes_of_every_kind_of_file(finished_run: Path, tmp_path: Path, name: str) -> None:
    path = tmp_path / Path(name).name
    shutil.copy(finished_run / "run" / name, path)
    read, size = FILES[name], path.stat().st_size
    read(path)
    everywhere = places(path, 2000)
    if path.suffix == ".h5":
        header = [(place, 0x11) for place in (*range(1000), *range(size - 200, size))]
        for place, mask in [*header, *everywhere]:
            with altered(path, place, mask):
                assert not is_whole(path), place
        everywhere = [(place, mask) for place, mask in everywhere if place < size - 64][:15]
    for place, mask in everywhere:
        with altered(path, place, mask), pytest.raises(SoftprintError, match=path.name):
            read(path)
    read(path)


@pytest.mark.parametrize("reading", ["import os; os.abort()", "while True: pass", "raise OSError"])
def test_a_table_of_contents_that_breaks_its_reader_is_named(
    small: Path, monkeypatch: pytest.MonkeyPatch, reading: str
) -> None:
    """On an altered table of contents HDF5 may crash, or find no end; which bytes do it depends on its version."""
    monkeypatch.setattr(h5_contents, "_READ", ("-c", reading))
    monkeypatch.setattr(h5_contents, "_PATIENCE", 1.0)
    with (
        altered(small, 200, 1),
        pytest.raises(SoftprintError, match=r"altered \(its table of contents\)"),
        open_softprint_h5(small, "body", 1),
    ):
        pass


def test_every_byte_of_shards_and_checkpoints(tmp_path: Path) -> None:
    shard, checkpoint = tmp_path / "x.shard", tmp_path / "x.checkpoint"
    write_shard(shard, {"table": {"numbers": np.arange(5.0), "texts": ["a", "b"]}})
    save_checkpoint(checkpoint, Checkpoint("run", 3, [{"step": 3.0}], {"model.w": torch.ones(3)}))
    for path, read, error in (
        (shard, read_shard, DamagedShard),
        (checkpoint, load_checkpoint, SoftprintError),
    ):
        for place in range(path.stat().st_size):
            with altered(path, place, 1 << place % 8), pytest.raises(error, match=re.escape(path.name)):
                read(path)
        read(path)


def test_the_place_of_the_damage_is_named(tmp_path: Path) -> None:
    rng, path = np.random.default_rng(1), tmp_path / "large.h5"
    with create_softprint_h5(path, "truth", 1) as file:
        for name in ("first", "second"):
            file.create_dataset(name, data=rng.random((40, 5000)), chunks=(1, 5000), fletcher32=True)
    place = path.read_bytes().index(np.ascontiguousarray(h5py.File(path)["second"][20]).tobytes())
    with altered(path, place, 1), altered(path, place + 5 * BLOCK, 1):
        found = damage(path)
        assert [bad.start // BLOCK for bad in found] == [place // BLOCK, place // BLOCK + 5]
        assert found[0].start <= place < found[0].stop
        words = f"bytes within {found[0].start} to {found[0].stop - 1} and .*second"
        with pytest.raises(SoftprintError, match=words), open_softprint_h5(path, "truth", 1):
            pass
    tensors = {name: torch.from_numpy(rng.random(50_000)) for name in ("first", "second")}
    path = tmp_path / "large.safetensors"
    save_tensors(path, "recipe", 1, {"text": "a"}, tensors)
    place = path.read_bytes().index(tensors["second"].numpy().tobytes()) + 2 * BLOCK
    with (
        altered(path, place, 1),
        pytest.raises(SoftprintError, match=r"bytes within .* \(second\): do it") as told,
    ):
        load_tensors(path, "recipe", 1, "do it")
    first, last = map(int, re.findall(r"\d+", str(told.value).partition("within")[2])[:2])
    assert first <= place <= last
    assert load_tensors(path, "recipe", 1, "do it")[0]["text"] == "a"


def test_truncation_and_appended_bytes_are_detected(small: Path) -> None:
    whole = small.read_bytes()
    for content in (whole[:-1], whole[:-500], whole + b"\0", whole + whole, whole[:-36], b""):
        small.write_bytes(content)
        with pytest.raises(SoftprintError, match="make it again"), open_softprint_h5(small, "body", 1):
            pass


def test_hdf5_ignores_the_seal_and_breaks_it_when_it_writes(small: Path) -> None:
    with h5py.File(small) as file:
        assert file["a/packed"][7] == 7.0
    assert is_whole(small)
    with h5py.File(small, "r+") as file:
        file.attrs["note"] = 1
    with pytest.raises(SoftprintError, match="another program"), open_softprint_h5(small, "body", 1):
        pass


def test_files_from_before_seals_are_recognised_by_their_version(small: Path) -> None:
    with h5py.File(small, "r+") as file:
        file.attrs["softprint_version"] = 0
    with (
        pytest.raises(SoftprintError, match=r"version 0.*reads version 1"),
        open_softprint_h5(small, "body", 1),
    ):
        pass


def test_a_file_is_examined_again_when_it_has_changed(small: Path) -> None:
    """Also if it was valid before, is altered immediately, and gets its old modification time again."""
    long_ago = time.time_ns() - 10**12
    os.utime(small, ns=(long_ago, long_ago))
    assert is_whole(small)
    with small.open("r+b") as file:
        file.seek(2000)
        byte = file.read(1)
        file.seek(2000)
        file.write(bytes([byte[0] ^ 1]))
    os.utime(small, ns=(long_ago, long_ago))
    assert damage(small) == [Damage(0, min(BLOCK, small.stat().st_size - 32 - 4))]


def test_empty_and_block_sized_files_can_be_sealed(tmp_path: Path) -> None:
    for size in (0, 1, BLOCK - 1, BLOCK, BLOCK + 1, 64 * BLOCK + 5):
        path = tmp_path / str(size)
        path.write_bytes(bytes(size))
        seal(path)
        assert is_whole(path)
