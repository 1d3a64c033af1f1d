"""The cluster's log in a profile: what its clients have seen, so that none of them falls behind it again (specs/15-cluster-log.md, Profile).

    members.log    "SFML" | version u8 = 1 | count u32 | count times: size u32 | SignedRecord, as a log of one | SHA-256 of all that

Version 2, once voters decide: before each size a byte, 0 for a SignedRecord, 1 for a DecidedValue.

No secret is in it, and no signature is verified again when it is read: whoever can write here can write cluster.toml.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Sequence
from pathlib import Path

from scenefold.base.errors import DamagedData, LocalFault, Refused
from scenefold.crypto import write_secret
from scenefold.wire import DecidedValue, MalformedPacket, pack_log, unpack_log
from scenefold.world.folder_lock import alone_in
from scenefold.world.log_view import KeptRecord, LogView

LOG_FILE = "members.log"
FILE_BYTES_MAX = 256 * 1024 * 1024
_HEAD = struct.Struct(">4sBI")
_SIZE = struct.Struct(">I")
_DIGEST_BYTES = 32
_MAGIC, _VERSION, _WITH_VOTES = b"SFML", 1, 2


class LogFile:
    """In the folder of a profile. `records` are from the first on."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / LOG_FILE

    def load(self) -> tuple[LogView, list[KeptRecord]]:
        """What was kept, and its fold; nothing if nothing was. LocalFault if it cannot be read, or is damaged."""
        try:
            with self._path.open("rb") as file:
                content = file.read(FILE_BYTES_MAX + 1)
        except FileNotFoundError:
            return LogView(), []
        except OSError as problem:
            raise LocalFault(
                f"cannot read the file: {problem.strerror}", where=str(self._path), remedy="check its permissions"
            ) from problem
        try:
            return LogView().after(_unpacked(content), None)
        except (DamagedData, MalformedPacket, Refused, struct.error, IndexError, ValueError) as problem:
            remedy = "remove this file: the nodes have all of it"
            raise LocalFault(f"the file is damaged: {problem}", where=str(self._path), remedy=remedy) from problem

    def save(self, records: Sequence[KeptRecord]) -> None:
        """Keep these, durably, unless as many lie there already: other clients of the profile write it, too."""
        if self._count() < len(records):
            with alone_in(self._path.parent):
                if self._count() < len(records):
                    write_secret(self._path, _packed(records), replace=True)

    def _count(self) -> int:
        try:
            with self._path.open("rb") as file:
                head = file.read(_HEAD.size)
        except OSError:
            return 0
        return int(_HEAD.unpack(head)[2]) if len(head) == _HEAD.size and head.startswith(_MAGIC) else 0


def _packed(records: Sequence[KeptRecord]) -> bytes:
    has_votes = any(isinstance(record, DecidedValue) for record in records)
    parts = [_HEAD.pack(_MAGIC, _WITH_VOTES if has_votes else _VERSION, len(records))]
    for record in records:
        by_votes = isinstance(record, DecidedValue)
        packed = record.encode() if isinstance(record, DecidedValue) else pack_log((record,))
        parts += (bytes([by_votes]) if has_votes else b"", _SIZE.pack(len(packed)), packed)
    content = b"".join(parts)
    return content + hashlib.sha256(content).digest()


def _unpacked(content: bytes) -> list[KeptRecord]:
    content, digest = content[:-_DIGEST_BYTES], content[-_DIGEST_BYTES:]
    if hashlib.sha256(content).digest() != digest:
        raise ValueError("its digest is wrong")
    magic, version, count = _HEAD.unpack_from(content)
    if magic != _MAGIC or version not in (_VERSION, _WITH_VOTES):
        raise ValueError("it is of another format")
    records, at = list[KeptRecord](), _HEAD.size
    for _ in range(count):
        by_votes = version == _WITH_VOTES and content[at] == 1
        at += version == _WITH_VOTES
        (size,) = _SIZE.unpack_from(content, at)
        at += _SIZE.size
        packed = content[at : at + size]
        records += (DecidedValue.decode(packed),) if by_votes else unpack_log(packed)
        at += size
    if at != len(content) or len(records) != count:
        raise ValueError("something follows its end")
    return records
