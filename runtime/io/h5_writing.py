"""Writing HDF5 files without a crash where the disk is full.

HDF5 (1.10 and 1.14 alike) answers a failed write with errors at every object that is closed afterwards, and with
a segmentation fault at the end. So it writes through an object of ours that never fails: the first error is kept,
what is written from then on goes to memory, and the file raises the error the next time it is asked for anything.
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
        self.stop: KeyboardInterrupt | None = None  # came in the midst of HDF5, which it would have crashed
        self._handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o666)
        self._place = self._size = 0
        self._spilled: list[tuple[int, bytes]] = []  # writes that found no room: where, and what

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
        """Nothing is held back."""

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
        while True:  # what is interrupted is done again, whole
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


class H5Writer(h5py.File):  # type: ignore[misc]  # h5py says nothing of its types
    """A new HDF5 file that raises OSError where it could not be written: from ``[]``, ``create_dataset`` and
    ``create_group``, and at the latest when its ``with`` block ends."""

    def __init__(self, path: Path) -> None:
        self._disk = _SafeDisk(path)
        # HDF5's format of 1.10 has checksums in its metadata: it can tell which dataset is damaged.
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
            while self:  # closing, too, is done again where it was interrupted
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
