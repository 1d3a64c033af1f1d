"""What is being written and has no name yet: drafts of key files and of folders with keys (specs/04-records.md, Drafts).

A draft lies beside its place as `.<name>.<random>`. Its writer holds the system's lock on it for as long as it is one, and loses that
lock however it dies; so a draft that nobody holds was left by the dead, and whoever next writes there removes it: keys may lie in it in
the clear. On a disk that knows no locks nothing is ever removed, since there nobody can tell the dead from the living.
"""

from __future__ import annotations

import fcntl
import os
import re
import secrets
import shutil
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

FILE_MODE = 0o600
FOLDER_MODE = 0o700
LOCK_FILE = ".lock"
"""In a folder that several processes change: whoever holds the lock of this file is alone in it."""
_FILE_RANDOM_BYTES, _FOLDER_RANDOM_BYTES = 8, 6
_TRIES = 100
_ANY = r"[^/]+"
_STEPS = r"(?:\.import|\.joining-[0-9a-f]{8})?"
"""What a draft of a whole profile may be for, besides a new one."""


def sync_folder(folder: Path) -> None:
    """Names that came or went there stay so, whatever happens to the machine."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextmanager
def new_file(place: Path) -> Iterator[tuple[Path, int]]:
    """An empty file beside `place`, for us alone, and a handle to write to it. Gone afterwards, unless it got a name."""
    for _ in range(_TRIES):
        draft = _beside(place, _FILE_RANDOM_BYTES)
        handle = os.open(draft, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, FILE_MODE)
        try:
            if not _is_ours_now(handle, draft):
                continue
            try:
                yield draft, handle
            finally:
                draft.unlink(missing_ok=True)
            return
        finally:
            os.close(handle)
    raise BlockingIOError("others remove what is written there")


@contextmanager
def new_folder(place: Path) -> Iterator[Path]:
    """An empty folder beside `place`, in a folder that exists, for us alone. Gone afterwards, unless it got a name."""
    for _ in range(_TRIES):
        draft = _beside(place, _FOLDER_RANDOM_BYTES)
        draft.mkdir(mode=FOLDER_MODE)
        try:
            handle = os.open(draft, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        except FileNotFoundError:
            continue
        try:
            if not _is_ours_now(handle, draft):
                continue
            try:
                yield draft
            finally:
                shutil.rmtree(draft, ignore_errors=True)
            return
        finally:
            os.close(handle)
    raise BlockingIOError("others remove what is written there")


def name_folder(draft: Path, place: Path) -> None:
    """Put a draft in its place, for good. OSError if something is there."""
    draft.rename(place)
    sync_folder(place.parent)


def sweep_files(folder: Path, name: str | None = None) -> None:
    """Remove drafts of dead writers of the file `name`, or of any file there. What cannot be removed stays."""
    _sweep(folder, _pattern(_ANY if name is None else _bare(name), _FILE_RANDOM_BYTES), stat.S_ISREG)


def sweep_folders(folder: Path, name: str | None = None) -> None:
    """Likewise drafts of the profile folder `name`, or of any folder there."""
    _sweep(folder, _pattern(_ANY if name is None else _bare(name) + _STEPS, _FOLDER_RANDOM_BYTES), stat.S_ISDIR)


def has_drafts(folder: Path) -> bool:
    """Whether there are drafts of files, of the dead or the living."""
    pattern = _pattern(_ANY, _FILE_RANDOM_BYTES)
    return any(pattern.fullmatch(entry.name) for entry in folder.iterdir())


@contextmanager
def alone_now(folder: Path) -> Iterator[None]:
    """BlockingIOError if somebody else is at work in the folder, OSError if nothing can be written there."""
    handle = os.open(folder / LOCK_FILE, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, FILE_MODE)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(handle)


def _pattern(names: str, random_bytes: int) -> re.Pattern[str]:
    return re.compile(rf"\.{names}\.[0-9a-f]{{{2 * random_bytes}}}")


def _bare(name: str) -> str:
    return re.escape(name.lstrip("."))


def _sweep(folder: Path, pattern: re.Pattern[str], is_kind: Callable[[int], bool]) -> None:
    with suppress(OSError):
        stale = [entry for entry in folder.iterdir() if pattern.fullmatch(entry.name)]
        gone = [entry for entry in stale if _remove_unheld(entry, is_kind)]
        if gone:
            sync_folder(folder)


def _remove_unheld(draft: Path, is_kind: Callable[[int], bool]) -> bool:
    try:
        found = draft.lstat()
        if not is_kind(found.st_mode) or found.st_uid != os.geteuid():
            return False
        handle = os.open(draft, os.O_NOFOLLOW | (os.O_RDONLY | os.O_DIRECTORY if stat.S_ISDIR(found.st_mode) else os.O_RDWR))
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if stat.S_ISDIR(found.st_mode):
                shutil.rmtree(draft)
            else:
                draft.unlink()
        finally:
            os.close(handle)
    except OSError:
        return False
    return True


def _beside(place: Path, random_bytes: int) -> Path:
    return place.with_name(f".{place.name.lstrip('.')}.{secrets.token_hex(random_bytes)}")


def _is_ours_now(handle: int, draft: Path) -> bool:
    """Take the lock. False if a sweep came first, between our making the draft and this, and has removed it or is about to."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass  # No locks on this disk: no sweeps either.
    return draft.exists()
