"""Small files that hold keys and settings: written whole or not at all, read with one clear error.

A key file that is half-written after a power cut locks its owner out of a scene for good. So every write goes to
a temporary neighbour first, is synced, and takes the final name by rename; the folder is synced last, because a
rename that is only in memory is no rename. Files are 0600 from their first byte on: a chmod afterwards would
leave a moment in which others can open them.
"""

from __future__ import annotations

import os
import secrets
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from scenefold.base.errors import LocalFault

FILE_BYTES_MAX = 1024 * 1024
"""No file of a profile comes near; whatever is larger is not ours and is not read into memory."""


def make_private_folder(folder: Path) -> None:
    """Make `folder` and what is missing above it; the folder itself is 0700."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
    except OSError as problem:
        raise LocalFault(
            f"cannot make the folder: {problem.strerror}", where=str(folder), remedy="choose another place"
        ) from problem


def write_private(path: Path, content: bytes) -> None:
    """Replace the file at `path` by `content`, 0600, durably and in one step."""
    assert len(content) <= FILE_BYTES_MAX
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(6)}")
    try:
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
        sync_folder(path.parent)
    except OSError as problem:
        raise LocalFault(
            f"cannot write the file: {problem.strerror}",
            where=str(path),
            remedy="check the space and the permissions there",
        ) from problem


def write_toml(path: Path, document: Mapping[str, Any]) -> None:
    """Write a TOML document as write_private does."""
    import tomlkit  # late: readers of a profile, the usual case, never need it

    write_private(path, tomlkit.dumps(document).encode())


def read_private(path: Path, *, bytes_exact: int | None = None) -> bytes:
    """The whole file; LocalFault if it is missing, unreadable, too large or not as long as it must be."""
    try:
        with path.open("rb") as file:
            content = file.read(FILE_BYTES_MAX + 1)
    except FileNotFoundError as problem:
        raise LocalFault(
            "a file is missing", where=str(path), remedy="restore it from a backup, or run `scenectl cluster init` anew"
        ) from problem
    except OSError as problem:
        raise LocalFault(
            f"cannot read the file: {problem.strerror}", where=str(path), remedy="check its permissions"
        ) from problem
    if len(content) > FILE_BYTES_MAX or (bytes_exact is not None and len(content) != bytes_exact):
        expected = f"{bytes_exact}" if bytes_exact is not None else f"at most {FILE_BYTES_MAX}"
        raise damaged(path, f"{len(content)} bytes instead of {expected}")
    return content


def read_toml(path: Path) -> dict[str, Any]:
    """The TOML document at `path`; LocalFault if it is none."""
    try:
        return tomllib.loads(read_private(path).decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise damaged(path, str(problem)) from problem


def damaged(path: Path, what: str) -> LocalFault:
    """The error for a file whose content cannot be right."""
    return LocalFault(f"the file is damaged: {what}", where=str(path), remedy="restore it from a backup")


def sync_folder(folder: Path) -> None:
    """Make the names in `folder` durable."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
