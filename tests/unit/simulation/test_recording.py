"""If this fails, histories say of an answer more than it proves, or less."""

from __future__ import annotations

import pytest

from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.location import FIRST, LAST, Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import EXPECTS_ANYTHING, SigningKey, seal_record
from scenefold.simulation.history import NEVER_ENDED, Listing, Outcome, Place, Read, Write
from scenefold.simulation.lies import Way
from scenefold.simulation.linearizable import judge
from scenefold.simulation.recording import Recorder
from scenefold.wire import GetMany, PutItem, RecordBytes, RecordKey, ReturnRange

SCENE, SPACE = SceneId(7), SpaceId(1)
HERE = Location.from_number(5 << 100)
PLACE = Place(SCENE, SPACE, HERE)
KEY = SigningKey(bytes(32))
C0, C1 = (Way("node:9", f"user:c{number}") for number in range(2))


def item(seq: int, expects: bytes = EXPECTS_ANYTHING) -> PutItem:
    record = seal_record(
        b"payload",
        scene=SCENE,
        genesis=bytes(32),
        space=SPACE,
        location=HERE,
        epoch=1,
        seq=seq,
        session=1,
        expects=expects,
        nonce=seq.to_bytes(12, "big"),
        symmetric_key=bytes(24),
        signing_key=KEY,
    )
    return PutItem(SCENE, SPACE, HERE, record.signature, record.header_bytes, record.ciphertext)


def recorder() -> Recorder:
    return Recorder(lambda: 1.0, lambda *_: None)


@pytest.mark.parametrize(
    ("reason", "outcome"),
    [
        (0, Outcome.DONE),
        (RejectReason.STALE_VERSION, Outcome.REFUSED),
        (RejectReason.BUSY, Outcome.MAYBE),
        (RejectReason.NOT_READY, Outcome.MAYBE),
        (None, Outcome.MAYBE),
    ],
)
def test_what_an_answer_proves(reason: int | None, outcome: Outcome) -> None:
    book = recorder()
    begin = book.histories.moment()
    book.written(C0, begin, [item(1)], None if reason is None else [reason])
    (event,) = book.histories.of(PLACE)
    assert isinstance(event, Write)
    assert event.outcome is outcome
    assert (event.end == NEVER_ENDED) == (outcome is Outcome.MAYBE)
    assert event.begin == begin < event.end


@pytest.mark.parametrize("reason", [RejectReason.NOT_MY_LOCATION, RejectReason.STORAGE_FULL])
def test_what_was_not_even_looked_at_is_no_event(reason: int) -> None:
    book = recorder()
    book.written(C0, 1, [item(1)], [reason])
    assert book.histories.of(PLACE) == []


@pytest.mark.parametrize("reason", [r for r in RejectReason if r is not RejectReason.STALE_VERSION])
def test_a_refusal_takes_nothing_back_that_an_earlier_try_may_have_done(reason: int) -> None:
    """The first answer was lost: whatever a later one refuses, the record may be there, and may be read."""
    book = recorder()
    put = item(1)
    book.written(C0, book.histories.moment(), [put], None)
    book.written(C0, book.histories.moment(), [put], [reason])
    assert {event.outcome for event in book.histories.of(PLACE) if isinstance(event, Write)} == {Outcome.MAYBE}
    for there in (None, RecordBytes(put.signature, put.header, put.ciphertext)):
        read(book, [there])
        assert judge(book.histories.of(PLACE)).holds


def test_a_lost_try_that_is_refused_for_its_version_was_overtaken_or_never_happened() -> None:
    book = recorder()
    old, new = item(1), item(2)
    book.written(C0, book.histories.moment(), [old], None)
    book.written(C1, book.histories.moment(), [new], [0])
    book.written(C0, book.histories.moment(), [old], [RejectReason.STALE_VERSION])
    read(book, [RecordBytes(new.signature, new.header, new.ciphertext)])
    assert judge(book.histories.of(PLACE)).holds
    read(book, [RecordBytes(old.signature, old.header, old.ciphertext)])
    assert not judge(book.histories.of(PLACE)).holds


def read(book: Recorder, records: list[RecordBytes | None], *, stale: bool = False) -> None:
    keys = tuple(RecordKey(SPACE, HERE) for _ in range(2))
    book.read(C1, book.histories.moment(), GetMany(SCENE, 0, keys), records, stale)


def test_bytes_that_no_client_takes_for_the_record_are_no_read_and_strange() -> None:
    """Who gives them lies, and here nobody did; a client that believed it would be found out by what it does with them."""
    book = recorder()
    put = item(1)
    book.offered(put)
    elsewhere = put.header[:60] + bytes((put.header[60] ^ 1,)) + put.header[61:]
    for record in (
        RecordBytes(put.signature, put.header, put.ciphertext[:-1] + b"!"),
        RecordBytes(put.signature, b"?" + put.header[1:], put.ciphertext),
        RecordBytes(put.signature, put.header[:100], put.ciphertext),
        RecordBytes(put.signature, elsewhere, put.ciphertext),
    ):
        read(book, [record])
    assert book.histories.of(PLACE) == [] and [place for place, _ in book.strange] == [PLACE] * 4


def test_reads_are_of_the_keys_that_were_answered() -> None:
    book = recorder()
    put = item(1)
    book.offered(put)
    read(book, [RecordBytes(put.signature, put.header, put.ciphertext)])
    (event,) = book.histories.of(PLACE)
    assert isinstance(event, Read)
    assert event.digest is not None
    assert not book.strange


def test_a_stale_read_proves_nothing_but_that_it_was_written() -> None:
    book = recorder()
    put = item(1)
    read(book, [RecordBytes(put.signature, put.header, put.ciphertext)], stale=True)
    assert book.histories.of(PLACE) == []
    assert [place for place, _ in book.strange] == [PLACE]


def listing(*locations: Location, stale: bool = False, last: Location = LAST) -> ReturnRange:
    return ReturnRange(SCENE, SPACE, FIRST, last, locations, (), stale)


def test_a_list_is_of_every_place_that_it_covers() -> None:
    book = recorder()
    book.offered(item(1))
    book.listed(C0, 1, listing(HERE))
    book.listed(C0, 3, listing())
    book.listed(C0, 5, listing(last=FIRST))
    book.listed(C0, 7, listing(stale=True))
    assert [event.present for event in book.histories.of(PLACE) if isinstance(event, Listing)] == [True, False]


def test_a_rotten_record_says_nothing_in_lists() -> None:
    book = recorder()
    book.offered(item(1))
    book.now_damaged({PLACE})
    book.listed(C0, 1, listing(HERE))
    begin = book.histories.moment()
    book.now_damaged(set())
    book.listed(C0, begin, listing(HERE))
    assert book.histories.of(PLACE) == [], "it may have been asked while it was rotten"
    book.listed(C0, book.histories.moment(), listing(HERE))
    assert len(book.histories.of(PLACE)) == 1


def test_operations_are_what_was_answered() -> None:
    book = recorder()
    book.written(C0, 1, [item(1)], [0])
    book.written(C0, 2, [item(2)], [RejectReason.STALE_VERSION])
    book.written(C0, 3, [item(3)], None)
    read(book, [None, None])
    book.listed(C0, 5, listing())
    assert book.acknowledged == 4
