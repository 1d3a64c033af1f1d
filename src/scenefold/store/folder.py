"""The data folder: made if need be, held by one process at a time.

A lock file with the holder's pid stays in the folder; what counts is the kernel's lock on it, which ends with the
process however it dies. So a pid left behind by a dead process is no obstacle, and is overwritten.

Who only looks leaves no trace: what the lock file said is put back, and one that was not there is removed. Another process may wait
for the file that is removed; so whoever has locked one looks whether it still is the folder's.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import os
from pathlib import Path

from scenefold.base.errors import LocalFault

LOCK_NAME = "scenefold.lock"
PID_BYTES_MAX = 32

_log = logging.getLogger("scenefold.store")
_UNWRITABLE = (errno.EACCES, errno.EPERM, errno.EROFS)


class FolderLock:
    """Holds the folder from construction until `release`."""

    def __init__(self, folder: Path, *, only_read: bool = False) -> None:
        """`only_read`: the folder must be there, and a disk that cannot be written is no obstacle."""
        if not only_read:
            _make(folder)
        self._path = folder / LOCK_NAME
        try:
            self._file, is_writable, is_new = _locked(self._path, only_read=only_read)
        except OSError as error:
            raise _fault(error, folder) from error
        self._before: tuple[bytes, int] | None = None
        """What is put back at the end, and when it was written; b"": the file was not there."""
        try:
            if is_writable:
                if only_read:
                    self._before = b"" if is_new else os.pread(self._file, PID_BYTES_MAX, 0), os.fstat(self._file).st_mtime_ns
                self._write(f"{os.getpid()}\n".encode())
        except OSError as error:
            os.close(self._file)
            raise _fault(error, folder) from error

    def release(self) -> None:
        """Let go. The file stays, but for who only looked: there it is as it was, or is none."""
        try:
            if self._before is not None:
                self._put_back(*self._before)
        finally:
            os.close(self._file)

    def _put_back(self, text: bytes, written_ns: int) -> None:
        try:
            if text:
                self._write(text)
                os.utime(self._file, ns=(written_ns, written_ns))
            else:
                self._path.unlink()
        except OSError as error:
            # As on a disk that has come to be read-only meanwhile. A pid that is left is no obstacle to anybody.
            _log.debug("the lock file of %s stays as it is: %s", self._path.parent, error)

    def _write(self, text: bytes) -> None:
        os.ftruncate(self._file, 0)
        os.pwrite(self._file, text, 0)


def _locked(path: Path, *, only_read: bool) -> tuple[int, bool, bool]:
    """The lock file, locked; whether it can be written, and whether it was made now. LocalFault if another process has it."""
    while True:
        file, is_writable, is_new = _open(path, only_read=only_read)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if not is_writable or _is_still(path, file):
                return file, is_writable, is_new
        except BlockingIOError:
            holder = _written_in(file) or "unknown"
            os.close(file)
            what, remedy = f"the data folder is in use by process {holder}", "stop that process, or choose another folder"
            raise LocalFault(what, where=str(path.parent), remedy=remedy) from None
        except OSError:
            os.close(file)
            raise
        # Who looked has removed it between our opening and locking it.
        os.close(file)


def _written_in(file: int) -> str:
    """Nothing if it is the folder itself, which stands for a lock file that cannot be made."""
    try:
        return os.pread(file, PID_BYTES_MAX, 0).decode("ascii", "replace").strip()
    except IsADirectoryError:
        return ""


def _is_still(path: Path, file: int) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(file))
    except FileNotFoundError:
        return False


def _open(path: Path, *, only_read: bool) -> tuple[int, bool, bool]:
    """The lock file, whether it can be written, and whether it was made now."""
    try:
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600), True, True
    except FileExistsError:
        pass
    except OSError as error:
        if not only_read or error.errno not in _UNWRITABLE:
            raise
    try:
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600), True, False
    except OSError as error:
        if not only_read or error.errno not in _UNWRITABLE:
            raise
    # The kernel locks whatever is open. Where nobody has made a lock file, and nobody can, nobody can write the rest.
    return os.open(path if path.exists() else path.parent, os.O_RDONLY | os.O_CLOEXEC), False, False


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
