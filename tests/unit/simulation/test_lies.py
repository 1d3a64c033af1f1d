"""If this fails, the judge excuses more than what a lying node said, or blames the store for it, or lets it pass in silence."""

from __future__ import annotations

from dataclasses import replace

import pytest

from scenefold.base.location import FIRST, LAST
from scenefold.base.reasons import RejectReason
from scenefold.crypto import RecordHeader
from scenefold.peer.line.ends import Side
from scenefold.peer.line.holding import Holding, handover_id
from scenefold.simulation import laws
from scenefold.simulation.history import Listing, Loss, Outcome, Read, Write
from scenefold.simulation.liar import SINGLE_SCOPES, Scope, scopes_of
from scenefold.simulation.lies import Manner, Way, whole
from scenefold.simulation.recording import Recorder
from scenefold.wire import DAMAGED_RECORD, GetMany, RecordBytes, RecordKey, ReturnRange
from unit.simulation.test_recording import C0, C1, HERE, PLACE, SCENE, SPACE, item, recorder
from unit.simulation.test_watch import PLACE as WATCHED
from unit.simulation.test_watch import RIGHT, Stage, member, record, version

LIAR = 1


def bytes_of(seq: int) -> RecordBytes:
    put = item(seq)
    return RecordBytes(put.signature, put.header, put.ciphertext)


def digest_of(seq: int) -> bytes:
    return RecordHeader.decode(item(seq).header).digest


def written(book: Recorder, *seqs: int) -> None:
    for seq in seqs:
        book.written(C0, book.histories.moment(), [item(seq)], [0])


def read(book: Recorder, begin: int, answer: RecordBytes | None) -> None:
    book.read(C0, begin, GetMany(SCENE, 1, (RecordKey(SPACE, HERE),)), [answer], False)


def reads_of(book: Recorder) -> list[bytes | None]:
    return [event.digest for event in book.histories.of(PLACE) if isinstance(event, Read)]


def test_an_older_version_is_excused_for_who_was_told_it_and_counted() -> None:
    book = recorder()
    written(book, 1, 2)
    begin = book.histories.moment()
    book.lies.tells(LIAR, C0, PLACE, Manner.OLDER, digest_of(1))
    read(book, begin, bytes_of(1))
    assert reads_of(book) == []
    assert book.lies.reported == {Manner.OLDER.value: 1}


def test_what_is_withheld_is_excused_and_counted() -> None:
    book = recorder()
    written(book, 1)
    begin = book.histories.moment()
    book.lies.tells(LIAR, C0, PLACE, Manner.WITHHELD, None)
    read(book, begin, None)
    assert reads_of(book) == [] and book.lies.reported.total() == 1


@pytest.mark.parametrize("lie", [(Manner.OLDER, 1), (Manner.NONSENSE, None), (Manner.DROPPED, None)])
def test_a_lie_in_other_words_excuses_nothing(lie: tuple[Manner, int | None]) -> None:
    manner, seq = lie
    book = recorder()
    written(book, 1, 2)
    begin = book.histories.moment()
    book.lies.tells(LIAR, C0, PLACE, manner, b"" if seq is None else digest_of(seq))
    read(book, begin, None)
    assert reads_of(book) == [None] and not book.lies.reported


def test_a_lie_told_before_the_question_or_about_another_place_excuses_nothing() -> None:
    book = recorder()
    written(book, 1)
    book.lies.tells(LIAR, C0, PLACE, Manner.WITHHELD, None)
    begin = book.histories.moment()
    book.lies.tells(LIAR, C0, PLACE._replace(location=LAST), Manner.WITHHELD, None)
    read(book, begin, None)
    assert reads_of(book) == [None] and not book.lies.reported


def test_what_is_left_out_of_a_list_is_excused_for_that_place_only() -> None:
    book = recorder()
    written(book, 1)
    book.offered(item(1))
    begin = book.histories.moment()
    answer = ReturnRange(SCENE, SPACE, FIRST, LAST, ())
    book.listed(C0, begin, answer)
    book.lies.tells(LIAR, C0, PLACE, Manner.WITHHELD, None)
    book.listed(C0, begin, answer)
    listings = [event for event in book.histories.of(PLACE) if isinstance(event, Listing)]
    assert [event.present for event in listings] == [False] and book.lies.reported.total() == 1


@pytest.mark.parametrize(
    ("manner", "reason"),
    [
        (Manner.DROPPED, 0),
        (Manner.MISJUDGED, 0),
        (Manner.MISJUDGED, RejectReason.STALE_VERSION),
        (Manner.MISJUDGED, RejectReason.DAMAGED),
    ],
)
def test_a_write_that_was_lied_about_may_have_happened_whatever_it_expects(manner: Manner, reason: int) -> None:
    book = recorder()
    begin = book.histories.moment()
    put = item(2, digest_of(1))
    book.lies.tells(LIAR, C0, PLACE, manner, RecordHeader.decode(put.header).digest)
    book.written(C0, begin, [put], [reason])
    (event,) = book.histories.of(PLACE)
    assert isinstance(event, Write) and event.outcome is Outcome.MAYBE and event.expect is None
    assert book.lies.reported == {manner.value: 1}


def test_another_write_to_the_same_place_is_not_excused() -> None:
    book = recorder()
    begin = book.histories.moment()
    book.lies.tells(LIAR, C0, PLACE, Manner.DROPPED, digest_of(2))
    book.written(C0, begin, [item(1)], [0])
    (event,) = book.histories.of(PLACE)
    assert isinstance(event, Write) and event.outcome is Outcome.DONE and not book.lies.reported


def test_made_up_bytes_that_come_back_to_a_client_are_no_read_but_only_while_a_liar_says_so() -> None:
    book = recorder()
    written(book, 1)
    begin = book.histories.moment()
    book.lies.tells(LIAR, C0, PLACE, Manner.NONSENSE, whole(bytes_of(7)))
    assert book.lies.is_nonsense(PLACE, C0, begin) and not book.lies.is_nonsense(PLACE, C1, begin)
    read(book, begin, bytes_of(7))
    assert not book.strange
    begin = book.histories.moment()
    read(book, begin, bytes_of(7))
    assert book.strange and not book.lies.is_nonsense(PLACE, C0, begin)


HANDOVER = handover_id(2, bytes(8))


def release_without(stage: Stage) -> None:
    """0 is given all that 1 owns, but for the record in it."""
    holding = Holding().found(RIGHT)
    stage.machines[1].store(record(2))
    offered = holding.offer(HANDOVER, Side.LEFT, member(0), RIGHT)
    stage.change(1, offered)
    stage.change(0, stage.machines[0].holding.note(HANDOVER, Side.RIGHT, member(1), RIGHT))
    stage.change(1, offered.release(HANDOVER))


def test_a_version_that_was_lied_about_in_this_handover_may_be_lost_and_is_reported() -> None:
    stage = Stage()
    lies = stage.watch.recorder.lies
    lies.loses(LIAR, HANDOVER, WATCHED, version(2).digest)
    release_without(stage)
    assert stage.laws == []
    assert lies.reported == {Manner.LOST.value: 1}
    (loss,) = stage.watch.recorder.histories.of(WATCHED)
    assert isinstance(loss, Loss) and loss.newest == version(2)


@pytest.mark.parametrize("lie", [(bytes(16), 2), (HANDOVER, 1)])
def test_another_handover_or_another_version_is_a_violation(lie: tuple[bytes, int]) -> None:
    stage = Stage()
    stage.watch.recorder.lies.loses(LIAR, lie[0], WATCHED, version(lie[1]).digest)
    release_without(stage)
    assert stage.laws == [laws.CARRIED] and not stage.watch.recorder.lies.reported


def test_every_scope_is_drawn_alone_and_with_all_others() -> None:
    assert [scopes_of(amount) for amount in range(1, 7)] == [(scope,) for scope in SINGLE_SCOPES]
    assert all(scopes_of(amount) == tuple(Scope) for amount in range(7, 13))


def test_a_lie_excuses_one_answer() -> None:
    book = recorder()
    written(book, 1)
    begin = book.histories.moment()
    book.lies.tells(LIAR, C0, PLACE, Manner.WITHHELD, None)
    for _ in range(5):
        read(book, begin, None)
    assert reads_of(book) == [None] * 4 and book.lies.reported.total() == 1


@pytest.mark.parametrize("way", [C1, Way("node:8", C0.to)], ids=["another client", "another node"])
def test_a_lie_told_to_another_client_or_by_another_node_excuses_nothing(way: Way) -> None:
    book = recorder()
    written(book, 1)
    begin = book.histories.moment()
    book.lies.tells(LIAR, way, PLACE, Manner.WITHHELD, None)
    read(book, begin, None)
    assert reads_of(book) == [None] and not book.lies.reported


def test_a_lie_told_to_the_node_that_has_asked_for_a_client_is_excused() -> None:
    book = recorder()
    written(book, 1)
    begin = book.histories.moment()
    book.lies.tells(LIAR, Way("node:8", C0.by), PLACE, Manner.WITHHELD, None)
    read(book, begin, None)
    assert reads_of(book) == [] and book.lies.reported.total() == 1


ALTERED = replace(bytes_of(2), ciphertext=bytes(len(bytes_of(2).ciphertext)))


@pytest.mark.parametrize("answer", [ALTERED, DAMAGED_RECORD], ids=["altered", "damaged"])
def test_bytes_that_cannot_be_read_are_strange_where_nobody_lied_and_nothing_rotted(answer: RecordBytes) -> None:
    book = recorder()
    written(book, 1, 2)
    read(book, book.histories.moment(), answer)
    assert [place for place, _ in book.strange] == [PLACE] and reads_of(book) == []


def test_damage_is_excused_by_rot_and_by_a_lie_and_altered_bytes_by_these_very_bytes_only() -> None:
    book = recorder()
    written(book, 1, 2)
    book.now_damaged({PLACE})
    read(book, book.histories.moment(), DAMAGED_RECORD)
    book.now_damaged(set())
    begin = book.histories.moment()
    book.lies.tells(LIAR, C0, PLACE, Manner.WITHHELD, None)
    read(book, begin, DAMAGED_RECORD)
    assert book.lies.reported.total() == 1
    book.lies.tells(LIAR, C0, PLACE, Manner.NONSENSE, whole(ALTERED))
    read(book, begin, ALTERED)
    assert not book.strange and reads_of(book) == []
    book.lies.tells(LIAR, C0, PLACE, Manner.NONSENSE, whole(replace(bytes_of(1), signature=bytes(64))))
    read(book, begin, bytes_of(1))
    assert reads_of(book) == [digest_of(1)], "an older version is none of the nonsense that was told"


def test_one_place_twice_in_a_question_is_one_answer() -> None:
    """A node that asks a liar for a client, once, gives what it was told for both."""
    book = recorder()
    written(book, 1)
    begin = book.histories.moment()
    book.lies.tells(LIAR, C0, PLACE, Manner.WITHHELD, None)
    book.read(C0, begin, GetMany(SCENE, 1, (RecordKey(SPACE, HERE),) * 2), [None, None], False)
    assert reads_of(book) == []
