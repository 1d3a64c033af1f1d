"""If this fails, a record can be forged, changed, moved or put back, or its content read without the key."""

from __future__ import annotations

import secrets
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.limits import PAYLOAD_BYTES_MAX
from scenefold.base.location import FIRST, LAST, Location
from scenefold.crypto import (
    EXPECTS_ANYTHING,
    EXPECTS_NOTHING,
    HEADER_BYTES,
    IllFormedRecord,
    InvalidSignature,
    Record,
    RecordHeader,
    RecordPlace,
    SigningKey,
    new_symmetric_key,
    open_record,
    seal_record,
    verify_record,
    verify_records,
    version_key,
)
from scenefold.crypto.record_header import ASSOCIATED_BYTES

WRITER = SigningKey.from_seed(b"w" * 32)
KEY = b"k" * 24
PLACE = RecordPlace(SceneId(7), SpaceId(2), Location.from_number(1 << 150))


def seal(payload: bytes = b"payload", *, place: RecordPlace = PLACE, **changes: object) -> Record:
    fields: dict[str, object] = {
        "genesis": b"g" * 32,
        "epoch": 3,
        "seq": 4,
        "session": 5,
        "nonce": b"n" * 12,
        "symmetric_key": KEY,
        "signing_key": WRITER,
    }
    return seal_record(payload, scene=place.scene, space=place.space, location=place.location, **(fields | changes))  # type: ignore[arg-type]


RECORD = seal()


@given(
    st.binary(max_size=200), st.integers(1, 2**32 - 1), st.integers(1, 8191), st.binary(min_size=20, max_size=20), st.integers(0, 2**64 - 1)
)
def test_what_is_sealed_verifies_and_opens(payload: bytes, scene: int, space: int, location: bytes, seq: int) -> None:
    place = RecordPlace(SceneId(scene), SpaceId(space), Location(location))
    record = seal(payload, place=place, seq=seq)
    header = verify_record(record, WRITER.public, place)
    assert (header.scene, header.space, header.location, header.seq, header.writer) == (*place, seq, WRITER.key_id)
    assert open_record(record, KEY) == payload
    assert Record.decode(record.encode()) == record
    assert RecordHeader.decode(header.encode()) == header


def test_the_largest_payload() -> None:
    payload = bytes(PAYLOAD_BYTES_MAX)
    assert open_record(seal(payload), KEY) == payload
    with pytest.raises(LocalFault, match="split it"):
        seal(payload + b"x")


def apart(whole: bytes) -> Record:
    """Taken apart by position, as the wire does it, so that a changed length reaches the verification."""
    start = HEADER_BYTES + 64
    return Record(whole[:HEADER_BYTES], whole[HEADER_BYTES:start], whole[start:])


def changed(at: int, bits: int = 1) -> Record:
    whole = bytearray(RECORD.encode())
    whole[at] ^= bits
    return apart(bytes(whole))


def test_any_changed_byte_is_noticed() -> None:
    for at in range(len(RECORD.encode())):
        for bits in (1, 0x80):
            with pytest.raises((InvalidSignature, IllFormedRecord)):
                verify_record(changed(at, bits), WRITER.public)


def test_content_belongs_to_its_header() -> None:
    for at in (*range(ASSOCIATED_BYTES), *range(HEADER_BYTES + 64, len(RECORD.encode()))):
        with pytest.raises(DamagedData):
            open_record(changed(at), KEY)


@pytest.mark.parametrize(
    "place",
    [
        PLACE._replace(scene=SceneId(8)),
        PLACE._replace(space=SpaceId(3)),
        PLACE._replace(location=FIRST),
        PLACE._replace(location=LAST),
    ],
)
def test_a_record_cannot_be_moved(place: RecordPlace) -> None:
    with pytest.raises(IllFormedRecord, match="belongs elsewhere"):
        verify_record(RECORD, WRITER.public, place)
    # Nor by writing the other place into its header.
    moved = RECORD.header._replace(scene=place.scene, space=place.space, location=place.location).encode()
    with pytest.raises(InvalidSignature):
        verify_record(replace(RECORD, header_bytes=moved), WRITER.public, place)


@given(
    st.sampled_from([EXPECTS_ANYTHING, EXPECTS_NOTHING, b"e" * 32]),
    st.one_of(st.just(EXPECTS_ANYTHING), st.binary(min_size=32, max_size=32)),
)
def test_what_a_record_expects_cannot_be_changed(expects: bytes, other: bytes) -> None:
    record = seal(expects=expects)
    assert verify_record(record, WRITER.public, PLACE).expects == expects
    bent = replace(record, header_bytes=record.header._replace(expects=other).encode())
    if other == expects:
        assert bent == record
        return
    with pytest.raises(InvalidSignature):
        verify_record(bent, WRITER.public, PLACE)
    with pytest.raises(DamagedData):
        open_record(bent, KEY)


def test_a_record_of_the_version_before_is_said_to_be_one() -> None:
    before = b"\x01" + RECORD.header_bytes[1:89] + RECORD.header_bytes[121:]
    for data in (before, before + RECORD.signature + RECORD.ciphertext):
        with pytest.raises(IllFormedRecord, match="a record of version 1, and this program knows version 2"):
            Record.decode(data)
    with pytest.raises(IllFormedRecord, match="version 1"):
        verify_record(replace(RECORD, header_bytes=before), WRITER.public)


def test_cutting_or_lengthening_the_ciphertext() -> None:
    for ciphertext in (b"", RECORD.ciphertext[:-1], RECORD.ciphertext + b"\0"):
        with pytest.raises(IllFormedRecord, match="announced"):
            verify_record(replace(RECORD, ciphertext=ciphertext), WRITER.public)
    for whole in (RECORD.encode()[:-1], RECORD.encode() + b"\0", b"", bytes(400)):
        with pytest.raises(IllFormedRecord):
            Record.decode(whole)


def test_another_writer() -> None:
    with pytest.raises(InvalidSignature, match="written by key"):
        verify_record(RECORD, SigningKey.generate().public)
    forged = replace(RECORD, signature=SigningKey.generate().sign(b"scenefold/record", RECORD.header_bytes))
    with pytest.raises(InvalidSignature):
        verify_record(forged, WRITER.public)


def test_a_signature_for_another_purpose() -> None:
    with pytest.raises(InvalidSignature):
        verify_record(replace(RECORD, signature=WRITER.sign(b"scenefold/header", RECORD.header_bytes)), WRITER.public)


def test_another_scene_key() -> None:
    with pytest.raises(DamagedData, match="cannot be opened"):
        open_record(RECORD, new_symmetric_key(secrets.token_bytes))
    for wrong in (b"", b"k" * 16, b"k" * 32):
        with pytest.raises(LocalFault, match="24 bytes"):
            open_record(RECORD, wrong)


def test_many_at_once() -> None:
    other = SigningKey.generate()
    claims = [
        (RECORD, WRITER.public, PLACE),
        (RECORD, other.public, PLACE),
        (RECORD, WRITER.public, None),
        (Record(b"", b"", b""), WRITER.public, None),
    ]
    good, stranger, anywhere, nothing = verify_records(claims)
    assert good is None
    assert anywhere is None
    assert isinstance(stranger, InvalidSignature)
    assert isinstance(nothing, IllFormedRecord)
    assert verify_records([]) == []


@given(st.binary(max_size=300))
def test_any_bytes_as_a_header(data: bytes) -> None:
    with pytest.raises(IllFormedRecord):
        RecordHeader.decode(data)


@given(st.binary(min_size=HEADER_BYTES, max_size=HEADER_BYTES))
def test_any_header_of_the_right_length(data: bytes) -> None:
    data = b"\x02\x01\x00" + data[3:]
    try:
        header = RecordHeader.decode(data)
    except IllFormedRecord:
        return
    assert header.encode() == data


@pytest.mark.parametrize(
    "changes",
    [
        {"genesis": b"short"},
        {"nonce": b"n" * 11},
        {"expects": b""},
        {"expects": b"e" * 31},
        {"place": PLACE._replace(scene=SceneId(0))},
        {"place": PLACE._replace(scene=SceneId(1 << 32))},
        {"place": PLACE._replace(space=SpaceId(8192))},
        {"place": PLACE._replace(location=b"short")},
        {"seq": 1 << 64},
        {"epoch": -1},
        {"placement": 2},
        {"symmetric_key": b"k" * 32},
    ],
    ids=str,
)
def test_what_cannot_be_written(changes: dict[str, object]) -> None:
    with pytest.raises(LocalFault):
        seal(**changes)  # type: ignore[arg-type]


def test_versions_are_ordered_as_the_spec_says() -> None:
    base = RECORD.header
    ascending = [
        base,
        base._replace(digest=b"\xff" * 32),
        base._replace(session=6),
        base._replace(writer=base.writer + 1, session=0),
        base._replace(seq=5, writer=0),
        base._replace(epoch=4, seq=0),
    ]
    assert all(version_key(lower) < version_key(higher) for lower, higher in pairwise(ascending))


def test_a_record_is_its_bytes_whether_its_header_was_looked_at_or_not() -> None:
    seen, unseen = seal(), seal()
    assert seen.header is seen.header
    assert seen == unseen and hash(seen) == hash(unseen) and repr(seen) == repr(unseen)
    moved = replace(seen, header_bytes=seen.header._replace(seq=9).encode())
    assert moved.header.seq == 9 and seen.header.seq == 4
