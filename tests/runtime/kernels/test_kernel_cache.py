"""Two processes that compile one kernel for different types at the same moment."""

from numba.core.caching import IndexDataCacheFile

from softprint.runtime.contact.piercing_kernels import bounds
from softprint.runtime.kernel_cache import FilesByKey

ONE, OTHER = ("float64",), ("float32",)


def raced(kind, folder):
    """What is found for each key where the other process has read the index before the first writes it, and writes its
    code before the first does."""
    first, second = (kind(str(folder), "kernel-1.py3", "stamp") for _ in range(2))
    second._load_index = dict
    write = first._save_data

    def late(name, data):
        second.save(OTHER, "code of the other")
        write(name, data)

    first._save_data = late
    first.save(ONE, "code of the one")
    reader = kind(str(folder), "kernel-1.py3", "stamp")
    return reader.load(ONE), reader.load(OTHER)


def test_no_code_for_other_types_is_found(tmp_path):
    assert raced(FilesByKey, tmp_path) == ("code of the one", "code of the other")


def test_files_of_numba_are_mixed_up(tmp_path):
    """Once they are not, `kernel_cache.py` is of no use."""
    assert raced(IndexDataCacheFile, tmp_path)[1] == "code of the one"


def test_changed_source_finds_nothing_old(tmp_path):
    FilesByKey(str(tmp_path), "kernel-1.py3", "stamp").save(ONE, "old")
    new = FilesByKey(str(tmp_path), "kernel-1.py3", "another stamp")
    assert new.load(ONE) is None
    new.save(ONE, "new")
    assert new.load(ONE) == "new"


def test_kernels_have_such_files():
    assert isinstance(bounds._cache._cache_file, FilesByKey)
