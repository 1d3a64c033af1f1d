"""If this fails, what too few holders say is taken for read, or what enough of them say is never judged."""

from __future__ import annotations

from dataclasses import replace

from scenefold.base.ids import NodeId
from scenefold.simulation.heard_copies import Counted, HeardCopies, Shape
from scenefold.wire import Configuration, CopiesFound, Copy, CopyState, GetCopies, Member, RecordBytes, RecordKey
from unit.simulation.test_watch import HERE, PLACE, SCENE, SPACE, record, version

MEMBERS = tuple(Member(NodeId(100 + number), bytes([number]) * 16) for number in range(3))
ASKED = GetCopies(SCENE, 1, (RecordKey(SPACE, HERE, b""),), False, False)


THREE, ALONE = Shape(3, 2), Shape(1, 1)


def says(copy: Copy, *, number: int = 7, needed: int = 2) -> CopiesFound:
    return CopiesFound((Configuration(number, MEMBERS, needed),), (copy,))


def it_is(seq: int) -> Copy:
    found = record(seq)
    return Copy(CopyState.RECORD, 0, b"", RecordBytes(found.signature, found.header_bytes, found.ciphertext))


NOTHING = Copy(CopyState.NOTHING, 0, b"", None)
UNKNOWN = Copy(CopyState.NO_CUSTODY, 0, b"", None)
LOST = Copy(CopyState.DAMAGED, 0, b"", None)


def heard(*answers: CopiesFound, shape: Shape = THREE, by: tuple[str, ...] = ("n1", "n2")) -> list[Counted]:
    """What the last of these answers makes known; they were asked one after the other."""
    copies = HeardCopies(lambda _place: shape)
    for seq in (1, 2):
        copies.offered(record(seq).header_bytes, version(seq))
    found: list[Counted] = []
    for moment, answer in enumerate(answers, 1):
        found = copies.heard("c", by[(moment - 1) % len(by)], moment, ASKED, answer)
    return found


def test_what_enough_say_alike_counts_from_the_first_question_on() -> None:
    assert heard(says(it_is(1)), says(it_is(1))) == [Counted(PLACE, version(1), 1)]
    assert heard(says(NOTHING), says(NOTHING)) == [Counted(PLACE, None, 1)]
    assert heard(says(it_is(1)), says(it_is(1)), says(it_is(1))) == [Counted(PLACE, version(1), 2)]


def test_an_owner_counts_alone_and_who_is_asked_for_bytes_only_not_at_all() -> None:
    owner = Configuration(0, MEMBERS[:1], 1)
    assert heard(CopiesFound((owner,), (it_is(1),))) == [Counted(PLACE, version(1), 1)]
    copies = HeardCopies(lambda _place: ALONE)
    copies.offered(record(1).header_bytes, version(1))
    assert [copies.heard("c", name, 1, replace(ASKED, any_copy=True), says(it_is(1))) for name in ("n1", "n2")] == [[], []]
    assert [len(copies.heard("c", name, 1, ASKED, says(it_is(1)))) for name in ("n1", "n2")] == [0, 1]


def test_one_alone_or_twice_the_same_does_not_count() -> None:
    assert heard(says(it_is(1))) == []
    assert heard(says(it_is(1)), says(it_is(1)), by=("n1",)) == []
    assert heard(says(it_is(1), needed=3), shape=ALONE) == [], "it and the owner are two, and three must have it"
    assert heard(says(it_is(1), needed=3), says(it_is(1), needed=3), shape=ALONE) == [Counted(PLACE, version(1), 1)]


def test_where_they_differ_the_newest_counts_in_which_order_it_comes() -> None:
    assert heard(says(it_is(1)), says(it_is(2))) == heard(says(it_is(2)), says(it_is(1))) == [Counted(PLACE, version(2), 1)]
    assert heard(says(NOTHING), says(it_is(1))) == [Counted(PLACE, version(1), 1)]
    assert heard(says(it_is(2)), says(it_is(1)), says(it_is(1))) == [Counted(PLACE, version(1), 2)], (
        "what one said before, it has said no more"
    )
    assert heard(says(it_is(1), needed=3), says(it_is(2), needed=3)) == [], "of these three both must have it"


def test_each_set_of_enough_holders_counts_by_itself() -> None:
    four = Configuration(7, (*MEMBERS, Member(NodeId(103), bytes(16))), 3)
    answers = [CopiesFound((four,), (copy,)) for copy in (it_is(2), it_is(2), it_is(1))]
    assert heard(*answers, shape=Shape(4, 3), by=("n1", "n2", "n3")) == []
    assert heard(*reversed(answers), shape=Shape(4, 3), by=("n1", "n2", "n3")) == [Counted(PLACE, version(2), 2)]


def test_under_two_configurations_they_say_nothing_together() -> None:
    assert heard(says(it_is(1)), says(it_is(1), number=8)) == []
    assert heard(says(UNKNOWN), says(UNKNOWN)) == heard(says(LOST), says(LOST)) == heard(says(it_is(3)), says(it_is(3))) == []


def test_what_counts_only_with_a_liar_is_no_event() -> None:
    copies = HeardCopies(lambda _place: THREE, lambda node, place: (node, place) == ("n2", PLACE))
    copies.offered(record(1).header_bytes, version(1))
    for moment, name in enumerate(("n1", "n2"), 1):
        found = copies.heard("c", name, moment, ASKED, says(it_is(1)))
    assert found == [Counted(PLACE, version(1), 1, is_lied=True)]
    assert Counted(PLACE, version(1), 1) in copies.heard("c", "n3", 3, ASKED, says(it_is(1))), "two others say so as well"
