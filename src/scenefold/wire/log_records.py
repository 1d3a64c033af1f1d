"""Records of a log as bytes: what is chained, hashed, signed and kept (design of the consensus §3; specs/03-wire.md, Logs).

    LogRecord     =  [ position, prev_hash, request_id, origin, entry ]      entry = [ number, field, ... ]
    SignedRecord  =  [ record, signature ]                                   record = bytes of a LogRecord
    a log         =  [ SignedRecord, ... ]                                   as it travels in SceneLogAnswer.private

A record's hash is the SHA-512/256 of its bytes, and stands in the next one's `prev_hash`; the first one's is zero.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass

from scenefold.base.limits import LOG_BYTES_MAX, LOG_RECORD_BYTES_MAX, LOG_RECORDS_MAX
from scenefold.wire.common import DIGEST, SIGNATURE, U32, U64, NodeId
from scenefold.wire.containers import Many, Struct
from scenefold.wire.errors import MalformedPacket, UnknownEntry
from scenefold.wire.kinds import Bin
from scenefold.wire.log_entries import FOUNDER, LOG_ENTRY, LogEntry
from scenefold.wire.pieces import pack_piece, unpack_piece

NO_RECORD = bytes(32)
"""`prev_hash` of a log's first record."""


@dataclass(frozen=True, slots=True)
class LogRecord:
    """One record of a log. Positions begin at 1; `request_id`: 16 random bytes, the same when it is proposed again."""

    position: int
    prev_hash: bytes
    request_id: bytes
    origin: NodeId
    entry: LogEntry

    def encode(self) -> bytes:
        """The record's bytes; LocalFault if a field is out of bounds."""
        return pack_piece(LOG_RECORD, self, size_max=LOG_RECORD_BYTES_MAX)

    @classmethod
    def decode(cls, data: bytes) -> LogRecord:
        """The record that `data` is, wholly; MalformedPacket otherwise, UnknownEntry if a newer version may know it."""
        try:
            return unpack_piece(LOG_RECORD, data, size_max=LOG_RECORD_BYTES_MAX)
        except MalformedPacket as problem:
            if problem.unknown is None:
                raise
            raise UnknownEntry(problem.field, problem.unknown) from None

    def hash(self) -> bytes:
        return hash_of_record(self.encode())


@dataclass(frozen=True, slots=True)
class SignedRecord:
    """A LogRecord's bytes, signed under the domain scenefold/log."""

    record: bytes
    signature: bytes

    def decoded(self) -> LogRecord:
        """The record inside; MalformedPacket if it is none."""
        return LogRecord.decode(self.record)


LOG_RECORD = Struct(
    LogRecord,
    ("position", U64),
    ("prev_hash", DIGEST),
    ("request_id", Bin(lengths=(16,))),
    ("origin", U32),
    ("entry", LOG_ENTRY),
)
SIGNED_RECORD = Struct(SignedRecord, ("record", Bin(LOG_RECORD_BYTES_MAX)), ("signature", SIGNATURE))
_LOG = Many(SIGNED_RECORD, LOG_RECORDS_MAX)
STRUCTS = (FOUNDER, LOG_RECORD, SIGNED_RECORD)


def hash_of_record(record: bytes) -> bytes:
    """SHA-512/256 of a LogRecord's bytes."""
    return hashlib.new("sha512_256", record).digest()


def hash_of_entry(entry: LogEntry) -> bytes:
    """Likewise of an entry alone: what a record says, wherever it stands."""
    return hash_of_record(pack_piece(LOG_ENTRY, entry, size_max=LOG_RECORD_BYTES_MAX))


def pack_log(records: Iterable[SignedRecord]) -> bytes:
    """The records as one byte string of at most LOG_BYTES_MAX; LocalFault if they are more."""
    return pack_piece(_LOG, tuple(records), size_max=LOG_BYTES_MAX)


def unpack_log(data: bytes) -> tuple[SignedRecord, ...]:
    """The records that `data` is, wholly; MalformedPacket otherwise. What is inside them is not looked at."""
    return unpack_piece(_LOG, data, size_max=LOG_BYTES_MAX)
