"""TOML documents of a profile: written whole or not at all, read with one clear error.

The first line is a comment with the SHA-256 of all behind it, so that a bit that changed on the disk, or an end that is lost, is told at
once, and not by what comes of another port, position or list of nodes. A file without that line is read as it is: earlier versions wrote
none, and who changes a file by hand leaves it out.
"""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from scenefold.base.errors import LocalFault
from scenefold.crypto import read_secret, write_secret

SETTINGS_BYTES_MAX = 1024 * 1024
"""Far more than NODES_MAX members take."""
_SUM = b"# SHA-256 of what follows: "


def write_toml(path: Path, document: Mapping[str, Any]) -> None:
    """Write or replace a document durably, 0600: some hold keys, and the others need no wider mode."""
    import tomlkit  # late: readers of a profile, the usual case, never need it

    content = tomlkit.dumps(document).encode()
    write_secret(path, b"%b%b\n%b" % (_SUM, hashlib.sha256(content).hexdigest().encode(), content), replace=True)


def read_secret_toml(path: Path) -> dict[str, Any]:
    """The document of a key file; LocalFault if it is missing, exposed or damaged."""
    return _parsed(path, read_secret(path))


def read_settings_toml(path: Path) -> dict[str, Any]:
    """A document without secrets, which an administrator may have copied here with any mode."""
    try:
        with path.open("rb") as file:
            content = file.read(SETTINGS_BYTES_MAX + 1)
    except OSError as error:
        raise LocalFault(f"cannot read the file: {error.strerror}", where=str(path), remedy="check its permissions") from error
    if len(content) > SETTINGS_BYTES_MAX:
        raise damaged(path, "far too large")
    return _parsed(path, content)


def damaged(path: Path, what: str) -> LocalFault:
    """The error for a file whose content cannot be right."""
    return LocalFault(f"the file is damaged: {what}", where=str(path), remedy="restore it from a backup")


def _parsed(path: Path, content: bytes) -> dict[str, Any]:
    if content.startswith(_SUM):
        line, _, content = content.partition(b"\n")
        if line != _SUM + hashlib.sha256(content).hexdigest().encode():
            remedy = "restore it from a backup; if it was changed by hand, and shall stay so, remove its first line"
            raise LocalFault("the file is damaged, or was changed by hand", where=str(path), remedy=remedy)
    try:
        return tomllib.loads(content.decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise damaged(path, str(problem)) from problem
