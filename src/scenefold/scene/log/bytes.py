"""A scene's log as it travels: signed records, packed, sealed under the scene's key (specs/16-scene-log.md, Bytes).

Every record is signed by the scene's header key under the domain scenefold/log: whoever can only read the scene holds its
symmetric key and could seal a log of their own, but not sign a record.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from scenefold.base.errors import DamagedData, Refused
from scenefold.crypto import LOG_DOMAIN, PublicKey, SigningKey, open_log, seal_log
from scenefold.scene.log.book import SceneLog
from scenefold.wire import LogRecord, MalformedPacket, SignedRecord, pack_log, unpack_log


def sign_record(record: LogRecord, header_key: SigningKey) -> SignedRecord:
    """The record as the log keeps it."""
    encoded = record.encode()
    return SignedRecord(encoded, header_key.sign(LOG_DOMAIN, encoded))


def seal_private(records: Sequence[SignedRecord], *, genesis: bytes, symmetric_key: bytes, key_epoch: int, nonce: bytes) -> bytes:
    """The private part for the public header at the last record's position."""
    return seal_log(
        pack_log(records), genesis=genesis, position=len(records), symmetric_key=symmetric_key, key_epoch=key_epoch, nonce=nonce
    )


_EMPTY = SceneLog()


@dataclass(frozen=True, slots=True)
class OpenedLog:
    """A log's state, and the records that it is the fold of."""

    state: SceneLog = _EMPTY
    records: tuple[SignedRecord, ...] = ()


def open_private(
    private: bytes,
    *,
    genesis: bytes,
    position: int,
    symmetric_key: bytes,
    header_key: PublicKey,
    header_keyed_at: int = 1,
    known: OpenedLog | None = None,
) -> OpenedLog:
    """The log at `position`. DamagedData if anything in it does not verify.

    `header_key` signs from `header_keyed_at` on; what is older the hashes of the chain hold, and its keys signed while they counted.
    `known`: an earlier part of it; what it begins with is neither verified nor folded again.
    """
    where = f"scene {genesis[:4].hex()}, log position {position}"
    opened = open_log(private, genesis=genesis, position=position, symmetric_key=symmetric_key)
    try:
        records = unpack_log(opened)
        if known is None or records[: len(known.records)] != known.records:
            known = OpenedLog()
        new = records[len(known.records) :]
        for record in records[max(len(known.records), header_keyed_at - 1) :]:
            header_key.verify(record.signature, LOG_DOMAIN, record.record)
        state = known.state.extended(record.decoded() for record in new)
    except (MalformedPacket, DamagedData, Refused) as problem:
        raise DamagedData(f"the scene's log does not hold together: {problem.what}", where=where) from problem
    if state.position != position:
        raise DamagedData(f"the scene's log ends at position {state.position}", where=where)
    if not header_keyed_at <= position or state.grants.header_keyed_at != header_keyed_at:
        raise DamagedData("the scene's log and its header tell otherwise of the header key", where=where)
    return OpenedLog(state, records)
