"""The data folder: made if need be, held by one process at a time.

A lock file with the holder's pid stays in the folder; what counts is the kernel's lock on it, which ends with the
process however it dies. So a pid left behind by a dead process is no obstacle, and is overwritten.
"""

from __future__ import annotations

import errno
import fcntl
import os
from pathlib import Path

from scenefold.base.errors import LocalFault

LOCK_NAME = "scenefold.lock"

_UNWRITABLE = (errno.EACCES, errno.EPERM, errno.EROFS)


class FolderLock:
    """Holds the folder from construction until `release`."""

    def __init__(self, folder: Path, *, only_read: bool = False) -> None:
        """`only_read`: the folder must be there, and a disk that cannot be written is no obstacle."""
        if not only_read:
            _make(folder)
        try:
            self._file, is_writable = _open(folder / LOCK_NAME, only_read=only_read)
        except OSError as error:
            raise _fault(error, folder) from error
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if is_writable:
                os.ftruncate(self._file, 0)
                os.pwrite(self._file, f"{os.getpid()}\n".encode(), 0)
        except BlockingIOError:
            holder = os.pread(self._file, 32, 0).decode("ascii", "replace").strip() or "unknown"
            os.close(self._file)
            raise LocalFault(
                f"the data folder is in use by process {holder}",
                where=str(folder),
                remedy="stop that process, or choose another folder",
            ) from None
        except OSError as error:
            os.close(self._file)
            raise _fault(error, folder) from error

    def release(self) -> None:
        """Let go. The file stays: removing it would let two processes lock two files of the same name."""
        os.close(self._file)


def _open(path: Path, *, only_read: bool) -> tuple[int, bool]:
    """The lock file, and whether it can be written."""
    try:
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600), True
    except OSError as error:
        if not only_read or error.errno not in _UNWRITABLE:
            raise
    # The kernel locks whatever is open. Where nobody has made a lock file, and nobody can, nobody can write the rest.
    return os.open(path if path.exists() else path.parent, os.O_RDONLY | os.O_CLOEXEC), False


def _make(folder: Path) -> None:
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise _fault(error, folder) from error


def _fault(error: OSError, folder: Path) -> LocalFault:
    if isinstance(error, FileExistsError | NotADirectoryError):
        what, remedy = "the data folder is a file", "choose another folder"
    elif error.errno in _UNWRITABLE:
        what, remedy = "the data folder cannot be written", "give this user write permission, or choose another folder"
    elif error.errno in (errno.ENOSPC, errno.EDQUOT):
        what, remedy = "the disk of the data folder is full", "free some space there"
    else:
        what, remedy = f"the data folder cannot be used: {error.strerror or error}", "choose another folder"
    return LocalFault(what, where=str(folder), remedy=remedy)
