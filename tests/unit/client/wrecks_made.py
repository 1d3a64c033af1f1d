"""How a node judges what is put where the record's header has rotted, for tests of clients that meet one."""

from __future__ import annotations

from scenefold.crypto import Record, RecordHeader
from scenefold.store.judging import PutResult
from scenefold.store.layout import HEADER_AT, pack_record
from scenefold.store.wrecks import judge_over_wreck
from scenefold.wire import PutItem


def header_of(item: PutItem | None) -> RecordHeader | None:
    return None if item is None else RecordHeader.decode(item.header)


def judge_of_wreck(new: PutItem, present: PutItem) -> PutResult:
    """A bit of the genesis in the header has turned over, and one of the ciphertext."""
    value = bytearray(pack_record(_record(present)))
    value[HEADER_AT + 7] ^= 1
    value[-1] ^= 1
    return judge_over_wreck(_record(new), memoryview(bytes(value)))


def _record(item: PutItem) -> Record:
    return Record(item.header, item.signature, item.ciphertext)
