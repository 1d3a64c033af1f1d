"""A scene's log as it travels: signed records, packed, sealed under the scene's key (specs/16-scene-log.md, Bytes, Snapshots).

Every record is signed by the scene's header key under the domain scenefold/log: whoever can only read the scene holds its
symmetric key and could seal a log of their own, but not sign a record. In place of the first ones a snapshot may stand, signed likewise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.reasons import RejectReason
from scenefold.crypto import LOG_DOMAIN, SNAPSHOT_DOMAIN, PublicKey, SigningKey, is_shortened, open_log, seal_log
from scenefold.scene.log.agreement import check_agrees
from scenefold.scene.log.book import SceneLog
from scenefold.scene.log.states import packed_state, unpacked_state
from scenefold.wire import LogRecord, MalformedPacket, ShortenedLog, SignedRecord, SignedSnapshot, UnknownEntry, pack_log, unpack_log


def sign_record(record: LogRecord, header_key: SigningKey) -> SignedRecord:
    """The record as the log keeps it."""
    encoded = record.encode()
    return SignedRecord(encoded, header_key.sign(LOG_DOMAIN, encoded))


def sign_snapshot(log: SceneLog, genesis: bytes, header_key: SigningKey) -> SignedSnapshot:
    """What stands in place of all records that this log is the fold of."""
    unsigned = SignedSnapshot(packed_state(log), b"")
    return SignedSnapshot(unsigned.state, header_key.sign(SNAPSHOT_DOMAIN, unsigned.signable(genesis)))


def seal_private(
    records: Sequence[SignedRecord],
    *,
    genesis: bytes,
    symmetric_key: bytes,
    key_epoch: int,
    nonce: bytes,
    snapshot: SignedSnapshot | None = None,
) -> bytes:
    """The private part for the public header at the last record's position. `snapshot`: of those that come before `records`."""
    return seal_log(
        pack_log(records) if snapshot is None else ShortenedLog(snapshot, tuple(records)).encode(),
        genesis=genesis,
        position=len(records) if snapshot is None else records[-1].decoded().position,
        symmetric_key=symmetric_key,
        key_epoch=key_epoch,
        nonce=nonce,
        shortened=snapshot is not None,
    )


_EMPTY = SceneLog()


@dataclass(frozen=True, slots=True)
class OpenedLog:
    """A log's state, and the records that it is the fold of, behind a snapshot if there is one."""

    state: SceneLog = _EMPTY
    records: tuple[SignedRecord, ...] = ()
    snapshot: SignedSnapshot | None = None

    def beginning(self) -> SceneLog:
        """The state that the first of the records goes on from."""
        return _EMPTY if self.snapshot is None else unpacked_state(self.snapshot.state)

    def begins(self, other: OpenedLog) -> bool:
        """Whether the other one is this, with more records."""
        return self.snapshot == other.snapshot and other.records[: len(self.records)] == self.records


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
    """The log at `position`. DamagedData if anything in it does not verify, or a snapshot tells otherwise of the past than `known` does.

    `header_key` signs from `header_keyed_at` on, and every snapshot; what is older the hashes of the chain hold, and its keys signed while they
    counted. `known`: an earlier part of it; what it begins with is neither verified nor folded again.
    """
    where = f"scene {genesis[:4].hex()}, log position {position}"
    opened = open_log(private, genesis=genesis, position=position, symmetric_key=symmetric_key)
    try:
        found = _unpacked(opened, genesis, header_key, shortened=is_shortened(private))
        known = known or OpenedLog()
        goes_on = known.begins(found)
        before = known.state if goes_on else found.beginning()
        new = found.records[len(known.records) if goes_on else 0 :]
        for record in new[max(0, header_keyed_at - 1 - before.position) :]:
            header_key.verify(record.signature, LOG_DOMAIN, record.record)
        folded = [record.decoded() for record in new]
        state = before.extended(folded) if goes_on or found.snapshot is None else _compared(before, folded, known.state)
    except UnknownEntry as problem:
        raise DamagedData(f"the scene's log cannot be read: {problem.what}", where=where, remedy=problem.remedy) from problem
    except (MalformedPacket, DamagedData, Refused) as problem:
        raise DamagedData(f"the scene's log does not hold together: {problem.what}", where=where, remedy=problem.remedy) from problem
    if state.position != position:
        raise DamagedData(f"the scene's log ends at position {state.position}", where=where)
    if not header_keyed_at <= position or state.grants.header_keyed_at != header_keyed_at:
        raise DamagedData("the scene's log and its header tell otherwise of the header key", where=where)
    return OpenedLog(state, found.records, found.snapshot)


def _unpacked(opened: bytes, genesis: bytes, header_key: PublicKey, *, shortened: bool) -> OpenedLog:
    """What is in it, not folded yet."""
    if not shortened:
        return OpenedLog(records=unpack_log(opened))
    log = ShortenedLog.decode(opened)
    header_key.verify(log.snapshot.signature, SNAPSHOT_DOMAIN, log.snapshot.signable(genesis))
    if not log.records:
        raise Refused(RejectReason.ILL_FORMED, "no record stands behind its snapshot")
    return OpenedLog(records=log.records, snapshot=log.snapshot)


def _compared(before: SceneLog, records: Sequence[LogRecord], known: SceneLog) -> SceneLog:
    """The fold from a snapshot on, which says of the past what was read before: at the very position up to which that was, if it is folded here."""
    if not known.position:
        return before.extended(records)
    count = min(max(0, known.position - before.position), len(records))
    then = before.extended(records[:count])
    check_agrees(known, then)
    return then.extended(records[count:])
