"""Files without a name, for what is larger than memory: gone when this process is, however it ends.

Arrays are mapped from them. What only lies in such a mapping the kernel may write back and drop at any moment, so it takes
no memory that the process could run out of.
"""

from __future__ import annotations

import errno
import mmap
import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import LocalFault

_TAIL_BYTES = 64
"""Behind every array: Embree loads a little beyond the last vertex."""
_IN_MEMORY = frozenset({"tmpfs", "ramfs"})


class SpillFile:
    """One file. Appending is for one thread at a time, `write_at` and `read_at` for any."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        with _room_in(folder):
            # The descriptor alone is kept: the file lost its name when it was made.
            file = tempfile.TemporaryFile(dir=folder, buffering=0)  # noqa: SIM115
        self._file = file
        self.size = 0
        """Bytes that were appended."""

    @property
    def number(self) -> int:
        """Its descriptor."""
        return self._file.fileno()

    def append(self, data: bytes | npt.NDArray[Any]) -> None:
        """Behind what is there; LocalFault where the disk is full."""
        if len(data):
            view = memoryview(data if isinstance(data, bytes) else np.ascontiguousarray(data).data).cast("B")
            self.write_at(self.size, view)
            self.size += len(view)

    def write_at(self, offset: int, data: memoryview) -> None:
        """All of it, at a place; LocalFault where the disk is full."""
        with _room_in(self._folder):
            while len(data):
                written = os.pwrite(self.number, data, offset)
                data, offset = data[written:], offset + written

    def read_at(self, offset: int, count: int) -> bytes:
        """So many bytes, which must be there."""
        data = os.pread(self.number, count, offset)
        while len(data) < count:
            more = os.pread(self.number, count - len(data), offset + len(data))
            assert more, "a spill file ends too early"
            data += more
        return data

    def empty(self) -> None:
        """Give its room back."""
        os.ftruncate(self.number, 0)
        self.size = 0

    def reserve(self, size: int) -> None:
        """Zeros up to this size, with room on the disk for all of them: a mapping could not say that there is none."""
        with _room_in(self._folder):
            os.posix_fallocate(self.number, 0, max(size, 1))

    def mapped(self, dtype: npt.DTypeLike, shape: tuple[int, ...]) -> npt.NDArray[Any]:
        """Its first bytes as an array, which may be written to; the file must be as long as that, and `_TAIL_BYTES` more are added to it."""
        kind = np.dtype(dtype)
        count = int(np.prod(shape))
        self.reserve(count * kind.itemsize + _TAIL_BYTES)
        memory = mmap.mmap(self.number, count * kind.itemsize + _TAIL_BYTES)
        return np.frombuffer(memory, kind, count).reshape(shape)

    def close(self) -> None:
        """Let go of it; what is mapped stays as long as it is used."""
        self._file.close()


class Spill:
    """The files of one render."""

    def __init__(self, folder: Path | None = None) -> None:
        """In this folder, or that for temporary files; LocalFault if it cannot be, or lies in memory itself."""
        self.folder = Path(tempfile.gettempdir()) if folder is None else folder
        kind = file_system_of(self.folder)
        if kind in _IN_MEMORY:
            raise LocalFault(
                f"what does not fit the budget would lie in memory all the same: {kind} is no disk",
                where=str(self.folder),
                remedy="name a folder on a disk by TMPDIR",
            )
        self._files: list[SpillFile] = []
        self._lock = threading.Lock()

    def file(self) -> SpillFile:
        """A new, empty file."""
        made = SpillFile(self.folder)
        with self._lock:
            self._files.append(made)
        return made

    def zeros(self, dtype: npt.DTypeLike, shape: tuple[int, ...]) -> npt.NDArray[Any]:
        """A mapped array."""
        return self.file().mapped(dtype, shape)

    def close(self) -> None:
        """Let go of all files."""
        for file in self._files:
            file.close()
        self._files.clear()


def will_need(array: npt.NDArray[Any], first: int, last: int) -> None:
    """Rows first .. last - 1 of a mapped array will be read soon: the kernel may read ahead. Nothing happens to an array in memory."""
    base: Any = array
    while isinstance(base, np.ndarray):
        base = base.base
    memory = base.obj if isinstance(base, memoryview) else base
    if not isinstance(memory, mmap.mmap) or last <= first or not hasattr(mmap, "MADV_WILLNEED"):
        return
    row = array.strides[0]
    begin = first * row // mmap.PAGESIZE * mmap.PAGESIZE
    memory.madvise(mmap.MADV_WILLNEED, begin, min(last * row, len(memory)) - begin)


def file_system_of(folder: Path) -> str:
    """The kind of file system that a folder lies in, as the kernel calls it; empty where nobody says."""
    try:
        mounts = Path("/proc/self/mountinfo").read_text().splitlines()
    except OSError:
        return ""
    device = folder.stat().st_dev if folder.is_dir() else -1
    wanted = f"{os.major(device)}:{os.minor(device)}" if device >= 0 else ""
    for line in mounts:
        before, _, behind = line.partition(" - ")
        if before.split()[2] == wanted:
            return behind.split()[0]
    return ""


@contextmanager
def _room_in(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        what = "there is no room for what does not fit the memory budget" if full else f"a temporary file cannot be used: {error.strerror}"
        raise LocalFault(what, where=str(folder), remedy="free some, or name another folder by TMPDIR") from error
