"""What a commit is made of. Each change is applied inside the transaction, and may be applied again if that restarts."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.reasons import RejectReason
from scenefold.crypto import RecordHeader, RecordPlace
from scenefold.store.judging import Outcome, Put, PutResult, judge
from scenefold.store.layout import RECORDS, pack_record, record_key, stored_header
from scenefold.store.statistics import Tally
from scenefold.world.ports import WriteTransaction

_log = logging.getLogger("scenefold.store")

R_co = TypeVar("R_co", covariant=True)


class Change(Protocol[R_co]):
    """`size_bytes`: about what it writes; `uses_reserve`: whether it is allowed when the disk is nearly full."""

    @property
    def size_bytes(self) -> int: ...

    @property
    def uses_reserve(self) -> bool: ...

    def apply(self, transaction: WriteTransaction, tally: Tally, /) -> R_co: ...

    def when_full(self) -> R_co:
        """The answer if the disk is full, or Refused."""
        ...


def storage_full() -> Refused:
    remedy = "free some space on the node's disk, or add a node"
    return Refused(RejectReason.STORAGE_FULL, "the node's disk is full", remedy=remedy)


@dataclass(frozen=True, slots=True)
class PutRecords:
    """Records, each judged on its own against what is there."""

    puts: Sequence[tuple[RecordHeader, Put]]

    @property
    def size_bytes(self) -> int:
        return sum(len(put.record.ciphertext) + 512 for _, put in self.puts)

    @property
    def uses_reserve(self) -> bool:
        return False

    def apply(self, transaction: WriteTransaction, tally: Tally, /) -> list[PutResult]:
        return [_put(transaction, tally, header, put) for header, put in self.puts]

    def when_full(self) -> list[PutResult]:
        return [PutResult(Outcome.FULL)] * len(self.puts)


def _put(transaction: WriteTransaction, tally: Tally, new: RecordHeader, put: Put) -> PutResult:
    key = record_key(RecordPlace(new.scene, new.space, new.location))
    value = transaction.get(RECORDS, key)
    present = _present(value) if value is not None else None
    result = judge(new, put.expect, present)
    if result.outcome is Outcome.STORED and present != new:
        replaced_bytes = len(value) if value is not None else 0
        packed = pack_record(put.record)
        transaction.put(RECORDS, key, packed)
        tally.add((new.scene, new.space), 0 if value is not None else 1, len(packed) - replaced_bytes)
    return result


@dataclass(frozen=True, slots=True)
class PutValue:
    """A scene's public header, or a service's note: the last one written stays."""

    table: str
    key: bytes
    value: bytes

    @property
    def size_bytes(self) -> int:
        return len(self.key) + len(self.value)

    @property
    def uses_reserve(self) -> bool:
        return True

    def apply(self, transaction: WriteTransaction, _tally: Tally, /) -> None:
        transaction.put(self.table, self.key, self.value)

    def when_full(self) -> None:
        raise storage_full()


def _present(value: memoryview) -> RecordHeader | None:
    """The header of what is there. Damaged data is nothing: the record that arrives heals it."""
    try:
        return RecordHeader.decode(stored_header(value))
    except DamagedData as error:
        _log.error("a damaged record is replaced: %s", error)
        return None
