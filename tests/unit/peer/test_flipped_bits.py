"""If this fails, a record of which a single bit was changed is stored by a node, or something of it is shown to a reader."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from random import Random

import pytest

from scenefold.base.errors import DamagedData, Refused, ScenefoldError
from scenefold.base.ids import SpaceId
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.client.sealing import SceneIdentity, open_all
from scenefold.client.verifying import writers_of
from scenefold.crypto import (
    ED25519,
    HEADER_BYTES,
    RSA3072,
    SUITES,
    IllFormedRecord,
    InvalidSignature,
    Record,
    RecordPlace,
    SigningKey,
    verify_record,
)
from scenefold.peer.records.verification import KnownScene, verify_all, verify_copies
from scenefold.scene.log import EpochKeys
from scenefold.store.layout import pack_record, unpack_record
from scenefold.wire import HandItem, KeyEntry, PutItem, RecordBytes, SpaceEntry, WriterEntry
from unit.crypto.suites_made import SIGNING
from unit.peer.scenes_made import FOR_EVER, HEADER_KEY, PLACE, SPACE, SYMMETRIC_KEY, first_header, sealed

BOTH = pytest.mark.parametrize("suite", [ED25519, RSA3072])
MARKER = b"nobody may see this"
HEADER = first_header(
    spaces=tuple(SpaceEntry(SpaceId(space), SpaceId(0), PLACE, 1, 1, render_output=False, node_managed=False) for space in (SPACE, 11)),
    keys=tuple(KeyEntry(key.suite, key.public.raw) for key in (HEADER_KEY, *SIGNING.values())),
    writers=tuple(WriterEntry(key.key_id, 0, FOR_EVER) for key in SIGNING.values()),
)
SCENE = KnownScene.of(HEADER)
READER = SceneIdentity(HEADER.scene, HEADER.genesis, 1, writers_of(HEADER), EpochKeys.only(SYMMETRIC_KEY))
FLIPS = 10_000


@dataclass(frozen=True)
class Sealed:
    """A record, its parts, and where it belongs."""

    record: Record
    place: RecordPlace
    writer: SigningKey

    @property
    def whole(self) -> bytes:
        return self.record.encode()

    def flipped(self, bit: int) -> Record:
        """Taken apart by position, as disks and wires hold the parts."""
        changed = bytearray(self.whole)
        changed[bit // 8] ^= 1 << bit % 8
        start, end = HEADER_BYTES, HEADER_BYTES + SUITES[self.writer.suite].signature_bytes
        return Record(bytes(changed[:start]), bytes(changed[start:end]), bytes(changed[end:]))


def small(suite: int) -> Sealed:
    writer = SIGNING[suite]
    return Sealed(sealed(HEADER, writer, MARKER, location=PLACE), RecordPlace(HEADER.scene, SPACE, PLACE), writer)


def anything(dice: Random) -> Sealed:
    """A record of random length, place and version, which holds the marker."""
    space, location = SpaceId(dice.choice((SPACE, 11))), Location(dice.randbytes(20))
    writer = SIGNING[dice.choice((ED25519, RSA3072))]
    record = sealed(
        HEADER,
        writer,
        MARKER + dice.randbytes(dice.choice((0, 1, 100, 2_000))),
        space=space,
        location=location,
        seq=dice.getrandbits(64),
        session=dice.getrandbits(64),
        nonce=dice.randbytes(12),
    )
    return Sealed(record, RecordPlace(HEADER.scene, space, location), writer)


def put(record: Record, place: RecordPlace) -> object:
    [verdict] = verify_all([(PutItem(*place, record.signature, record.header_bytes, record.ciphertext), SCENE)])
    return verdict


def copy(record: Record, place: RecordPlace) -> object:
    [verdict] = verify_copies([(HandItem(*place, b"", record.signature, record.header_bytes, record.ciphertext), SCENE)])
    return verdict


def read(record: Record, place: RecordPlace) -> object:
    try:
        return open_all(READER, [(place.space, place.location)], [RecordBytes(record.signature, record.header_bytes, record.ciphertext)])
    except DamagedData as problem:
        return problem


def check_refused(answer: object) -> None:
    """It is an error of ours with words, and nothing of the payload is in them, nor in what caused it."""
    assert isinstance(answer, Refused | DamagedData), answer
    cause: BaseException | None = answer
    while cause is not None:
        shown = f"{cause} {cause!r} {cause.args!r}"
        assert "nobody may" not in shown and MARKER.hex() not in shown
        assert not isinstance(cause, ScenefoldError) or len(cause.what) > 10
        cause = cause.__cause__


# From which byte on a flipped bit is refused how, by whoever verifies; the last may turn one value that is right into another.
WORDS: tuple[tuple[int, type[DamagedData], str], ...] = (
    (0, IllFormedRecord, r"a record of version \d+"),
    (1, IllFormedRecord, r"ill-formed record header: suite \d+"),
    (2, DamagedData, r"ill-formed record header: placement \d+|the signature is not that of key"),
    (3, IllFormedRecord, r"the record belongs elsewhere"),
    (7, InvalidSignature, r"the signature is not that of key"),
    (39, IllFormedRecord, r"the record belongs elsewhere|ill-formed record header: space \d+"),
    (41, IllFormedRecord, r"the record belongs elsewhere"),
    (61, InvalidSignature, r"the signature is not that of key"),
    (77, InvalidSignature, r"the record was written by key"),
    (81, InvalidSignature, r"the signature is not that of key"),
    (145, IllFormedRecord, r"bytes, \d+ were announced|ill-formed record header: a ciphertext of \d+ bytes"),
    (149, InvalidSignature, r"the signature is not that of key"),
    (-1, InvalidSignature, r"the ciphertext is not the one that was signed"),
)


def words_for(byte: int, ciphertext_at: int) -> tuple[type[DamagedData], str]:
    if byte >= ciphertext_at:
        return WORDS[-1][1:]
    return next(row for row in reversed(WORDS[:-1]) if row[0] <= byte)[1:]


@BOTH
def test_every_bit_of_a_small_record_is_guarded_and_says_which_part_is_wrong(suite: int) -> None:
    one = small(suite)
    assert verify_record(one.record, one.writer.public, one.place).suite == suite
    ciphertext_at = len(one.whole) - len(one.record.ciphertext)
    for bit in range(8 * len(one.whole)):
        kind, words = words_for(bit // 8, ciphertext_at)
        with pytest.raises(kind) as caught:
            verify_record(one.flipped(bit), one.writer.public, one.place)
        assert re.search(words, str(caught.value)), (bit // 8, str(caught.value))
        check_refused(caught.value)


@BOTH
@pytest.mark.parametrize("receiver", [put, copy, read], ids=["a node that is asked to store it", "a node that is handed it", "a reader"])
def test_nobody_takes_a_small_record_with_any_bit_flipped(suite: int, receiver: Callable[[Record, RecordPlace], object]) -> None:
    one = small(suite)
    assert not isinstance(receiver(one.record, one.place), ScenefoldError)
    for bit in range(8 * len(one.whole)):
        answer = receiver(one.flipped(bit), one.place)
        check_refused(answer)
        if isinstance(answer, Refused):
            assert answer.reason in {
                RejectReason.ILL_FORMED,
                RejectReason.SIGNATURE_INVALID,
                RejectReason.NOT_AUTHORISED,
                RejectReason.UNKNOWN_SCENE_OR_SPACE,
                RejectReason.MODE_FORBIDS,
                RejectReason.NOT_READY,
            }


@BOTH
def test_every_bit_of_a_record_on_the_disk_is_guarded(suite: int) -> None:
    one = small(suite)
    stored = pack_record(one.record)
    assert unpack_record(memoryview(stored)) == one.record
    for bit in range(8 * len(stored)):
        changed = bytearray(stored)
        changed[bit // 8] ^= 1 << bit % 8
        with pytest.raises(DamagedData) as caught:
            unpack_record(memoryview(bytes(changed)))
        check_refused(caught.value)


def test_ten_thousand_flips_of_random_records() -> None:
    dice = Random(4)
    records = [anything(dice) for _ in range(100)]
    receivers = (put, copy, read)
    for one in records:
        assert not any(isinstance(receiver(one.record, one.place), ScenefoldError) for receiver in receivers)
    for flip in range(FLIPS):
        one = dice.choice(records)
        check_refused(receivers[flip % 3](one.flipped(dice.randrange(8 * len(one.whole))), one.place))
