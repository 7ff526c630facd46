"""Compiled kernels on disk, which several processes may keep at once.

Numba numbers the files of a kernel that is compiled for different types, by an index that it reads before it writes.
Two processes that compile a kernel at the same moment, each for its own types, take the same number. The index may then
name the code of the one for the types of the other, and that runs on them without a word. Here the name of a file says
what it was compiled for. The index can still lose an entry: what that was for is compiled again.
"""

from __future__ import annotations

import hashlib
from typing import Any

from numba.core.caching import IndexDataCacheFile


class FilesByKey(IndexDataCacheFile):
    """The files of one kernel. Keys say what code is for: types, processor, and the code itself."""

    def save(self, key: object, data: Any) -> None:
        """The code first, so that the index names no file that is not there."""
        name = self._data_name(hashlib.sha256(repr(key).encode()).hexdigest()[:16])
        self._save_data(name, data)
        self._save_index({**self._load_index(), key: name})

    def _data_name(self, digest: str) -> str:
        return self._index_name.removesuffix(".nbi") + f".{digest}.nbc"


def keep_by_key(kernel: Any) -> None:
    """Let a kernel that numba keeps on disk have files of that kind."""
    cache = kernel._cache
    place = cache._impl.locator
    cache._cache_file = FilesByKey(cache.cache_path, cache._impl.filename_base, place.get_source_stamp())
