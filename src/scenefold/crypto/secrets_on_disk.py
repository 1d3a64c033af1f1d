"""Files that hold keys: readable by their owner alone, from the first byte, and complete or absent.

A key file is made beside its final name with mode 0600 (never widened by the umask, never narrowed afterwards:
between creation and chmod anyone could have opened it), synced, then linked to its name, which fails if the name
is taken. Folders that hold keys have mode 0700. A key file that others may read is refused: it may already have been read.
"""

from __future__ import annotations

import os
import secrets
import stat
from pathlib import Path

from scenefold.base.errors import LocalFault

FILE_MODE = 0o600
FOLDER_MODE = 0o700
SECRET_BYTES_MAX = 1024 * 1024
"""No key file of ours is larger; a wrong path may name anything."""


def make_private_folder(folder: Path) -> None:
    """Makes `folder`, and parents that are missing, for the owner alone. One that exists keeps its mode."""
    try:
        for missing in reversed([path for path in (folder, *folder.parents) if not path.exists()]):
            missing.mkdir(mode=FOLDER_MODE, exist_ok=True)
        if not folder.is_dir():
            raise NotADirectoryError(f"{folder} is a file")
    except OSError as error:
        raise LocalFault(
            f"cannot make the folder: {error.strerror or error}", where=str(folder), remedy="name a folder that you may write to"
        ) from None


def write_secret(path: Path, data: bytes, *, replace: bool = False) -> None:
    """Writes a key file durably, mode 0600. LocalFault if it exists, unless `replace`."""
    draft = path.with_name(f".{path.name}.{secrets.token_hex(8)}")
    try:
        try:
            _write_new(draft, data)
            if replace:
                draft.replace(path)
            else:
                os.link(draft, path)
        finally:
            draft.unlink(missing_ok=True)
        _sync_folder(path.parent)
    except FileExistsError:
        raise LocalFault(
            "a key file exists already", where=str(path), remedy="move it away first: whoever holds it depends on it"
        ) from None
    except OSError as error:
        raise LocalFault(
            f"cannot write the key file: {error.strerror or error}", where=str(path), remedy="check the folder and its rights"
        ) from None


def _write_new(path: Path, data: bytes) -> None:
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, FILE_MODE)
    with os.fdopen(handle, "wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def _sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def read_secret(path: Path) -> bytes:
    """A key file's bytes. LocalFault if it is missing, or if others may read or change it."""
    return _read(path, exposed_mask=0o077)


def read_certificate(path: Path) -> bytes:
    """A certificate's bytes: no secret, but nobody else may change whom we trust. LocalFault as above."""
    return _read(path, exposed_mask=0o022)


def _read(path: Path, exposed_mask: int) -> bytes:
    try:
        with path.open("rb") as file:
            # Of the open file, not of the path: the two may differ a moment later.
            mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
            data = file.read(SECRET_BYTES_MAX + 1)
    except FileNotFoundError:
        raise LocalFault("a key file is missing", where=str(path), remedy="restore it from a backup") from None
    except OSError as error:
        raise LocalFault(
            f"cannot read the key file: {error.strerror or error}", where=str(path), remedy="check its owner and rights"
        ) from None
    if mode & exposed_mask:
        raise LocalFault(
            f"the key file is open to others (mode {mode:04o})",
            where=str(path),
            remedy=f"chmod 600 '{path}', and replace the key if others use this machine",
        )
    if len(data) > SECRET_BYTES_MAX:
        raise LocalFault("far too large for a key file", where=str(path), remedy="check the path")
    return data
