"""Several small files as one piece of text, to be locked as a whole (specs/04-records.md, Locked files).

    { "format": 1, "kind": "backup", "files": { "users/ada/signing.seed": base64, ... } }

JSON, so that what is inside can be taken out by hand with any tool, years from now.
"""

from __future__ import annotations

import base64
import binascii
import json
import re
from collections.abc import Mapping

from scenefold.base.errors import LocalFault

ARCHIVE_BYTES_MAX = 64 * 1024 * 1024
FILES_MAX = 20_000
_FORMAT = 1
_PART = re.compile(r"[A-Za-z0-9_@-][A-Za-z0-9._@-]{0,127}")
_PARTS_MAX = 4


def pack_archive(kind: str, files: Mapping[str, bytes]) -> bytes:
    """The text. Names are relative, with slashes."""
    assert all(is_safe_name(name) for name in files), "names are ours"
    coded = {name: base64.b64encode(data).decode() for name, data in sorted(files.items())}
    return json.dumps({"format": _FORMAT, "kind": kind, "files": coded}, indent=1).encode() + b"\n"


def unpack_archive(data: bytes, kinds: tuple[str, ...], where: str = "") -> tuple[str, dict[str, bytes]]:
    """Kind and files; LocalFault if it is damaged, of another kind, or names a file that would lie elsewhere."""
    if len(data) > ARCHIVE_BYTES_MAX:
        raise _damaged(where)
    try:
        document = json.loads(data)
        number, kind, coded = document["format"], document["kind"], document["files"]
        if number != _FORMAT:
            raise LocalFault(f"the file has format {number!r}, this program knows {_FORMAT}", where=where, remedy="update this program")
        if kind not in kinds:
            raise LocalFault(f"the file holds {kind!r}, and {' or '.join(kinds)} is wanted", where=where, remedy="choose another file")
        files = {name: base64.b64decode(text, validate=True) for name, text in coded.items()}
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, binascii.Error):
        raise _damaged(where) from None
    if len(files) > FILES_MAX or not all(is_safe_name(name) for name in files):
        raise _damaged(where)
    return kind, files


def is_safe_name(name: str) -> bool:
    """Whether a name stays below the folder that it is unpacked in."""
    parts = name.split("/")
    return len(parts) <= _PARTS_MAX and all(_PART.fullmatch(part) for part in parts)


def _damaged(where: str) -> LocalFault:
    return LocalFault("the file of keys is damaged", where=where, remedy="restore it from another copy")
