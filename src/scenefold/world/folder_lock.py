"""One process at a time in a folder of a profile: clients of one profile look at a file and then replace it, and nobody may come between.

The system takes the lock back from whoever dies; who was stopped keeps it, so nobody waits for ever. It is that of a file of its own,
since some network disks lock no folders.
"""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from scenefold.base.errors import LocalFault
from scenefold.crypto.drafts import FILE_MODE, LOCK_FILE

LOOK_S = 0.05
LOOKS_MAX = 200
"""In these 10 s, many others that write a small file each have had their turn."""


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Wait for the others, threads of this process among them. Not to be nested. LocalFault if nothing can be written there, or one of them
    is never done. To be called where a thread may wait."""
    try:
        handle = os.open(folder / LOCK_FILE, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, FILE_MODE)
    except OSError as problem:
        raise LocalFault(f"cannot write there: {problem.strerror}", where=str(folder), remedy="check its permissions") from problem
    try:
        _lock(handle, folder)
        yield
    finally:
        os.close(handle)


def _lock(handle: int, folder: Path) -> None:
    for _ in range(LOOKS_MAX):
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            # The system knows no waiting for a lock that has an end.
            time.sleep(LOOK_S)
        except OSError as problem:
            raise LocalFault(f"cannot lock the folder: {problem.strerror}", where=str(folder), remedy="put it on another disk") from problem
        else:
            return
    raise LocalFault(
        "another client of the profile writes there and is not done", where=str(folder), remedy="end it if it was stopped, then try again"
    )
