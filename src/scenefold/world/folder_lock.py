"""One process at a time in a folder of a profile: clients of one profile look at a file and then replace it, and nobody may come between.

The system takes the lock back from whoever dies. It is that of a file of its own, since some network disks lock no folders.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from scenefold.base.errors import LocalFault
from scenefold.crypto.secrets_on_disk import FILE_MODE

LOCK_FILE = ".lock"


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Wait for the others, threads of this process among them. Not to be nested. LocalFault if nothing can be written there."""
    try:
        handle = os.open(folder / LOCK_FILE, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, FILE_MODE)
    except OSError as problem:
        raise LocalFault(f"cannot write there: {problem.strerror}", where=str(folder), remedy="check its permissions") from problem
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
        except OSError as problem:
            raise LocalFault(f"cannot lock the folder: {problem.strerror}", where=str(folder), remedy="put it on another disk") from problem
        yield
    finally:
        os.close(handle)
