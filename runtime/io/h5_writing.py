"""Writing HDF5 files without crashing on a full disk.

After a failed write, HDF5 (both 1.10 and 1.14) raises errors for every object that is closed afterwards, and ends in a
segmentation fault. It therefore writes through a file object that never fails: the first error is stored, later writes
go to memory, and the next access to the file raises the error.
"""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import Any

import h5py


class _SafeDisk(io.RawIOBase):
    """A file for HDF5 to write. error: what went wrong with it, if anything did."""

    def __init__(self, path: Path) -> None:
        self.error: OSError | None = None
        self.stop: KeyboardInterrupt | None = None  # received inside HDF5, which it would have crashed
        self._handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o666)
        self._place = self._size = 0
        self._spilled: list[tuple[int, bytes]] = []  # failed writes: position and bytes

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        start = {os.SEEK_SET: 0, os.SEEK_CUR: self._place, os.SEEK_END: self._size}
        self._place = start[whence] + offset
        return self._place

    def tell(self) -> int:
        return self._place

    def flush(self) -> None:
        """Writes are unbuffered."""

    def truncate(self, size: int | None = None) -> int:
        self._size = self._place if size is None else size
        if self.error is None:
            try:
                os.ftruncate(self._handle, self._size)
            except OSError as error:
                self.error = error
        return self._size

    def write(self, data: Any) -> int:
        place = self._place
        while True:  # an interrupted write is repeated completely
            try:
                return self._write(memoryview(data).cast("B"), place)
            except KeyboardInterrupt as stop:
                self.stop = stop

    def _write(self, content: memoryview, place: int) -> int:
        done = 0
        while self.error is None and done < len(content):
            try:
                done += os.pwrite(self._handle, content[done:], place + done)
            except OSError as error:
                self.error = error
        if done < len(content):
            self._spilled.append((place + done, bytes(content[done:])))
        self._place = place + len(content)
        self._size = max(self._size, self._place)
        return len(content)

    def readinto(self, buffer: Any) -> int:
        target = memoryview(buffer).cast("B")
        count = max(0, min(len(target), self._size - self._place))
        found = os.pread(self._handle, count, self._place)
        target[:count] = found.ljust(count, b"\0")
        for place, content in self._spilled:
            start, stop = max(place, self._place), min(place + len(content), self._place + count)
            if start < stop:
                target[start - self._place : stop - self._place] = content[start - place : stop - place]
        self._place += count
        return count

    def close(self) -> None:
        if not self.closed:
            os.close(self._handle)
        super().close()


class H5Writer(h5py.File):  # type: ignore[misc]  # h5py has no type information
    """A new HDF5 file that raises OSError if it cannot be written: from ``[]``, ``create_dataset`` and
    ``create_group``, and at the latest when its ``with`` block ends."""

    def __init__(self, path: Path) -> None:
        self._disk = _SafeDisk(path)
        # The file format of HDF5 1.10 has checksums of metadata, which locate the damaged dataset.
        super().__init__(self._disk, "w", libver=("v110", "v110"))

    def __getitem__(self, name: Any) -> Any:
        self._raise_error()
        return super().__getitem__(name)

    def create_dataset(self, *arguments: Any, **options: Any) -> Any:
        self._raise_error()
        return super().create_dataset(*arguments, **options)

    def create_group(self, *arguments: Any, **options: Any) -> Any:
        self._raise_error()
        return super().create_group(*arguments, **options)

    def __exit__(self, *exception: Any) -> None:
        try:
            while self:  # an interrupted close is repeated too
                try:
                    super().__exit__(*exception)
                except KeyboardInterrupt as stop:
                    self._disk.stop = stop
        finally:
            self._disk.close()
            self._raise_error()

    def _raise_error(self) -> None:
        if self._disk.stop is not None:
            raise self._disk.stop
        if self._disk.error is not None:
            raise self._disk.error
