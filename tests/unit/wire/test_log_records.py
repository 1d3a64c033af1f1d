"""If this fails, nodes fold different logs from the same bytes, or a signed record says two things."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault
from scenefold.base.ids import NodeId, SpaceId
from scenefold.base.location import FIRST
from scenefold.wire import (
    NO_RECORD,
    Batch,
    CreateSpace,
    CurveKind,
    LogRecord,
    MalformedPacket,
    ScaleSpace,
    SceneMode,
    SetCopies,
    SetMode,
    SignedRecord,
    hash_of_record,
    pack_log,
    unpack_log,
)
from scenefold.wire.log_entries import LOG_ENTRY
from scenefold.wire.log_records import LOG_RECORD
from unit.wire.strategies import values

SPACE = CreateSpace(SpaceId(1), 3, CurveKind.HILBERT, False, SpaceId(0), FIRST, 1, 1, False, "rooms", (0.0,) * 3, (1.0,) * 3)


def record_of(entry: object) -> LogRecord:
    return LogRecord(1, NO_RECORD, bytes(16), NodeId(7), entry)  # type: ignore[arg-type]


def plain_record(entry: list[object]) -> bytes:
    packed: bytes = msgpack.packb([1, NO_RECORD, bytes(16), 7, entry])
    return packed


@pytest.mark.parametrize("number", list(LOG_ENTRY.structs), ids=lambda number: f"{number}-{LOG_ENTRY.structs[number].name}")
def test_round_trip(number: int) -> None:
    @settings(max_examples=40)
    @given(values(LOG_ENTRY.structs[number]))
    def check(entry: object) -> None:
        record = record_of(entry)
        data = record.encode()
        assert LogRecord.decode(data) == record
        assert msgpack.unpackb(data)[4][0] == number
        assert record.hash() == hash_of_record(data) == hashlib.new("sha512_256", data).digest()

    check()


@given(values(LOG_RECORD), st.data())
@settings(max_examples=150)
def test_mutated_records_are_refused_or_have_exactly_this_encoding(record: LogRecord, data: st.DataObject) -> None:
    mutated = bytearray(record.encode())
    mutated[data.draw(st.integers(0, len(mutated) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    try:
        found = LogRecord.decode(bytes(mutated))
    except MalformedPacket as malformed:
        assert malformed.field.startswith("LogRecord")  # noqa: PT017
    else:
        assert found.encode() == mutated
        assert found.hash() != record.hash()


@given(st.lists(st.tuples(values(LOG_RECORD), st.binary(min_size=64, max_size=64)), max_size=5))
@settings(max_examples=40)
def test_a_log_travels_whole(pairs: list[tuple[LogRecord, bytes]]) -> None:
    log = tuple(SignedRecord(record.encode(), signature) for record, signature in pairs)
    assert unpack_log(pack_log(log)) == log
    assert [signed.decoded() for signed in log] == [record for record, _ in pairs]


@pytest.mark.parametrize(
    ("entry", "where"),
    [
        (replace(SPACE, low=(0.0, 0.0)), "LogRecord.entry(CreateSpace)"),
        (replace(SPACE, low=(1.0, 0.0, 0.0)), "LogRecord.entry(CreateSpace)"),
        (replace(SPACE, dimensions=9), "LogRecord.entry(CreateSpace).dimensions"),
        (replace(SPACE, name="é" * 33), "LogRecord.entry(CreateSpace).name"),
        (SetCopies(SpaceId(1), 0, 0), "LogRecord.entry(SetCopies).copies"),
        (SetCopies(SpaceId(1), 9, 2), "LogRecord.entry(SetCopies).copies"),
        (SetCopies(SpaceId(1), 2, 3), "LogRecord.entry(SetCopies)"),
        (ScaleSpace(SpaceId(1), 0.0), "LogRecord.entry(ScaleSpace).factor"),
        (ScaleSpace(SpaceId(1), -1.0), "LogRecord.entry(ScaleSpace).factor"),
        (Batch((Batch(()),)), "LogRecord.entry(Batch).entries[0]"),  # type: ignore[arg-type]
        ("text", "LogRecord.entry"),
    ],
    ids=str,
)
def test_what_fits_no_log_is_not_signed(entry: object, where: str) -> None:
    with pytest.raises(LocalFault) as caught:
        record_of(entry).encode()
    assert caught.value.where == where


@pytest.mark.parametrize(
    ("data", "field"),
    [
        (plain_record([9, bytes(16)]), "LogRecord.entry"),
        (plain_record([]), "LogRecord.entry"),
        (plain_record([4]), "LogRecord.entry(SetMode)"),
        (plain_record([4, 0, 0]), "LogRecord.entry(SetMode)"),
        (plain_record([13, [[13, []]]]), "LogRecord.entry(Batch).entries[0]"),
        (plain_record([14, 1, 2, 3]), "LogRecord.entry(SetCopies)"),
        (plain_record([14, 1, 2, 0]), "LogRecord.entry(SetCopies).copies_min"),
        (plain_record([17]), "LogRecord.entry"),
        (plain_record([12, 1, 2, 2]), "LogRecord.entry"),
        (plain_record([3, 1, -0.5]), "LogRecord.entry(ScaleSpace).factor"),
        (plain_record([4, 0]) + b"\0", "LogRecord"),
        (plain_record([4, 0])[:-1], "LogRecord.entry"),
        (b"", "LogRecord"),
        (bytes(300_000), "LogRecord"),
    ],
)
def test_the_error_names_the_field(data: bytes, field: str) -> None:
    with pytest.raises(MalformedPacket) as caught:
        LogRecord.decode(data)
    assert caught.value.field.startswith(field)


def test_a_log_that_is_too_long_for_a_packet_is_not_made() -> None:
    signed = SignedRecord(record_of(SetMode(SceneMode.EDIT)).encode(), bytes(64))
    with pytest.raises(LocalFault, match="at most 4194304"):
        pack_log([signed] * 40_000)
