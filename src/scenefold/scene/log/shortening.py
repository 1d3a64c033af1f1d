"""When a log begins with a snapshot, and of which position (specs/16-scene-log.md, Snapshots). Pure.

The author of a record sees to it, for all who come after. It leaves the newest records behind the snapshot: whoever has read the log a while
ago still finds the position there up to which it did.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from scenefold.base.limits import LOG_TAIL_BYTES_KEPT, LOG_TAIL_BYTES_MAX, LOG_TAIL_RECORDS_KEPT, LOG_TAIL_RECORDS_MAX
from scenefold.crypto import SigningKey
from scenefold.scene.log.bytes import OpenedLog, sign_snapshot
from scenefold.scene.log.states import unpacked_state
from scenefold.wire import SignedRecord


def shortened(log: OpenedLog, genesis: bytes, signer: SigningKey) -> OpenedLog:
    """The log as it is proposed: with a newer snapshot if it has grown too long. `signer`: the header key of its newest position.

    Takes time where it does something, with the number of its records.
    """
    is_long = len(log.records) > LOG_TAIL_RECORDS_MAX or sum(map(_size, log.records)) > LOG_TAIL_BYTES_MAX
    if is_long:
        return cut_at(log, len(log.records) - _kept(log.records), genesis, signer)
    if log.snapshot is not None and log.state.grants.header_keyed_at == log.state.position:
        # The word of the key before counts no longer.
        return replace(log, snapshot=sign_snapshot(log.beginning(), genesis, signer))
    return log


def cut_at(log: OpenedLog, count: int, genesis: bytes, signer: SigningKey) -> OpenedLog:
    """The log with its first `count` records in a snapshot; one at least must stay behind it."""
    assert 0 < count < len(log.records)
    state = log.beginning().extended(record.decoded() for record in log.records[:count])
    snapshot = sign_snapshot(state, genesis, signer)
    # What nobody can read would end the scene.
    assert unpacked_state(snapshot.state) == state
    return OpenedLog(log.state, log.records[count:], snapshot)


def _kept(records: Sequence[SignedRecord]) -> int:
    """How many of the newest stay."""
    size, kept = 0, 0
    for record in reversed(records[-LOG_TAIL_RECORDS_KEPT:]):
        size += _size(record)
        if size > LOG_TAIL_BYTES_KEPT and kept:
            break
        kept += 1
    return kept


def _size(record: SignedRecord) -> int:
    return len(record.record) + len(record.signature)
