"""Files that hold keys: readable by their owner alone, from the first byte, and complete or absent.

A key file is made beside its final name (drafts.py) with mode 0600 (never widened by the umask, never narrowed afterwards:
between creation and chmod anyone could have opened it), synced, then linked to its name, which fails if the name
is taken. Folders that hold keys have mode 0700. A key file that others may read, or that is another's, is refused: it may already have been
read.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable
from pathlib import Path

from scenefold.base.errors import LocalFault
from scenefold.crypto.drafts import FOLDER_MODE, new_file, sweep_files, sync_folder

_ROOT = 0
SECRET_BYTES_MAX = 1024 * 1024
"""No key file of ours is larger; a wrong path may name anything."""


def make_private_folder(folder: Path) -> None:
    """Makes `folder`, and parents that are missing, for the owner alone. One that exists keeps its mode."""
    try:
        for missing in reversed([path for path in (folder, *folder.parents) if not path.exists()]):
            missing.mkdir(mode=FOLDER_MODE, exist_ok=True)
            sync_folder(missing.parent)
        if not folder.is_dir():
            raise NotADirectoryError(f"{folder} is a file")
    except OSError as error:
        raise LocalFault(
            f"cannot make the folder: {error.strerror or error}", where=str(folder), remedy="name a folder that you may write to"
        ) from None


def write_secret(path: Path, data: bytes, *, replace: bool = False) -> None:
    """Writes a key file durably, mode 0600. LocalFault if it exists, unless `replace`. What a killed writer of this file left goes."""
    try:
        sweep_files(path.parent, path.name)
        with new_file(path) as (draft, handle):
            with os.fdopen(handle, "wb", closefd=False) as file:
                file.write(data)
                file.flush()
                os.fsync(handle)
            if replace:
                draft.replace(path)
            else:
                os.link(draft, path)
        sync_folder(path.parent)
    except FileExistsError:
        raise LocalFault(
            "a key file exists already", where=str(path), remedy="move it away first: whoever holds it depends on it"
        ) from None
    except OSError as error:
        raise LocalFault(
            f"cannot write the key file: {error.strerror or error}", where=str(path), remedy="check the folder and its rights"
        ) from None


def remove_secrets(folder: Path, names: Iterable[str]) -> None:
    """Removes key files that are there, durably; with them goes what killed writers left. OSError if one cannot be removed."""
    there = [folder / name for name in names if (folder / name).exists()]
    for path in there:
        path.unlink(missing_ok=True)
    if there:
        sync_folder(folder)
    sweep_files(folder)


def read_secret(path: Path) -> bytes:
    """A key file's bytes. LocalFault if it is missing, no file, another user's, or if others may read or change it."""
    return _read(path, exposed_mask=0o077)


def read_certificate(path: Path) -> bytes:
    """A certificate's bytes: no secret, but nobody else may change whom we trust. LocalFault as above."""
    return _read(path, exposed_mask=0o022)


def _read(path: Path, exposed_mask: int) -> bytes:
    try:
        # Not to wait for whoever writes to a pipe.
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        with os.fdopen(handle, "rb") as file:
            # Of the open file, not of the path: the two may differ a moment later.
            found = os.fstat(handle)
            _check_file(path, found, exposed_mask)
            data = file.read(SECRET_BYTES_MAX + 1)
    except FileNotFoundError:
        raise LocalFault("a key file is missing", where=str(path), remedy="restore it from a backup") from None
    except OSError as error:
        raise LocalFault(
            f"cannot read the key file: {error.strerror or error}", where=str(path), remedy="check its owner and rights"
        ) from None
    if len(data) > SECRET_BYTES_MAX:
        raise LocalFault("far too large for a key file", where=str(path), remedy="check the path")
    return data


def _check_file(path: Path, found: os.stat_result, exposed_mask: int) -> None:
    """LocalFault for what is no file, or what others may have read or changed: its owner can, whatever its mode. The system's may anyway."""
    if not stat.S_ISREG(found.st_mode):
        raise LocalFault("cannot read the key file: it is no file", where=str(path), remedy="check the path")
    if found.st_uid not in (os.geteuid(), _ROOT):
        raise LocalFault(
            f"the key file belongs to another user (id {found.st_uid})",
            where=str(path),
            remedy=_as_owner(path, found.st_uid),
        )
    mode = stat.S_IMODE(found.st_mode)
    if mode & exposed_mask:
        raise LocalFault(
            f"the key file is open to others (mode {mode:04o})",
            where=str(path),
            remedy=f"chmod 600 '{path}', and replace the key if others use this machine",
        )


def _as_owner(path: Path, owner: int) -> str:
    """What to do about a file of another user. Were root told to take it, its user would be locked out of a profile that was all right."""
    run = f"run it as that user (`sudo -u '#{owner}'`, in a container `--user {owner}`)"
    if os.geteuid() == _ROOT:
        return run
    return f"{run} if the keys are theirs; if they are yours, chown {os.geteuid()} '{path}', and replace the key if that user is not you"
