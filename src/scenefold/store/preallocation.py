"""Room in a file before it is written.

A database that finds the disk full in the middle of a commit can only say that something failed. So the file is
lengthened beforehand, in steps, by asking the file system for blocks. That the answer was no is remembered by the
caller until the commit's result is known: it may still fit into free pages inside the file.
"""

from __future__ import annotations

import errno
import os
from pathlib import Path

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
STEP_BYTES_MIN = 1 << 20
STEP_BYTES_MAX = 64 << 20


class GrowingFile:
    """An existing file that others write, held open to lengthen it."""

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        self._is_open = True
        self.size = os.fstat(self._file).st_size

    def reach(self, size: int) -> bool:
        """Have blocks up to `size` at least; False if there is no room for them."""
        if size <= self.size:
            return True
        step = min(max(size // 8, STEP_BYTES_MIN), STEP_BYTES_MAX)
        return self._lengthen(size + step) or self._lengthen(size)

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
