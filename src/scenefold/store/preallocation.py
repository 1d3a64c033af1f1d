"""Room in a file before it is written.

A database that finds the disk full in the middle of a commit can only say that something failed. So the file is
lengthened beforehand, in steps, by asking the file system for blocks. That the answer was no is remembered by the
caller until the commit's result is known: it may still fit into free pages inside the file.

More than that is taken ahead, where the disk can spare it, so that others who fill the disk leave the database what it
needs to make room again.
"""

from __future__ import annotations

import errno
import os
from pathlib import Path

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
STEP_BYTES_MIN = 1 << 20
STEP_BYTES_MAX = 64 << 20
AHEAD_BYTES_MIN = 8 << 20
"""Taken ahead by the smallest file; by others as much as they have. Whoever has little needs little to delete it."""


def ahead_of(size: int, bytes_max: int) -> int:
    """How much a file of this size takes ahead of need."""
    return min(bytes_max, max(size, AHEAD_BYTES_MIN))


class GrowingFile:
    """An existing file that others write, held open to lengthen it."""

    def __init__(self, path: Path, ahead_bytes_max: int = 0) -> None:
        """`ahead_bytes_max`: what may be taken ahead of need, as long as as much stays free for others."""
        self._ahead_bytes_max = ahead_bytes_max
        self._file = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        self._is_open = True
        self.size = os.fstat(self._file).st_size

    def reach(self, size: int) -> bool:
        """Have blocks up to `size` at least; False if there is no room for them."""
        step = min(max(size // 8, STEP_BYTES_MIN), STEP_BYTES_MAX)
        ahead = size + ahead_of(size, self._ahead_bytes_max)
        if self._ahead_bytes_max and ahead > self.size:
            spared = self.size + self._free_bytes() - self._ahead_bytes_max
            if spared > max(size, self.size) and self._lengthen(min(ahead + step, spared)):
                return True
        return size <= self.size or self._lengthen(size + step) or self._lengthen(size)

    def _free_bytes(self) -> int:
        files = os.fstatvfs(self._file)
        return files.f_bavail * files.f_frsize

    def _lengthen(self, size: int) -> bool:
        try:
            os.posix_fallocate(self._file, self.size, size - self.size)
        except OSError as error:
            if error.errno not in NO_ROOM:
                raise
            return False
        self.size = size
        return True

    def close(self) -> None:
        """Once; the number may be another file's afterwards."""
        if self._is_open:
            self._is_open = False
            os.close(self._file)
