"""If one fails, holders of copies speak for an owner who may have said something else, or their word never counts."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.ids import NodeId
from scenefold.client.copy_words import CopyWords, quorum, word_of
from scenefold.crypto import version_of
from scenefold.wire import Configuration, Copy, CopyState, Member, RecordBytes
from unit.store.samples import record as sample

OWNER, ADA, BOB, EVE = (Member(NodeId(number), bytes(16)) for number in range(1, 5))
THREE = Configuration(7, (OWNER, ADA, BOB), 2)
OWNERS = frozenset((OWNER.node,))
OLD, NEW = (RecordBytes(b"s", sample(1, seq=seq).header_bytes, b"c") for seq in (1, 2))


def record(bytes_: RecordBytes) -> Copy:
    return Copy(CopyState.RECORD, 0, b"", bytes_)


def digest(bytes_: RecordBytes) -> Copy:
    return Copy(CopyState.DIGEST, 0, version_of(bytes_.header), None)


NOTHING = Copy(CopyState.NOTHING, 0, b"", None)
DAMAGED = Copy(CopyState.DAMAGED, 0, b"", None)


def words(*said: tuple[Member, Configuration, Copy], shape: tuple[int, int] = (3, 2)) -> CopyWords:
    found = CopyWords(*shape, OWNERS)
    for member, configuration, copy in said:
        found.hear(member.node, configuration, copy)
    return found


def test_two_of_three_that_say_alike_count_like_the_owner() -> None:
    found = words((ADA, THREE, record(NEW)), (BOB, THREE, digest(NEW)))
    assert found.is_here()
    assert found.record == NEW


def test_also_that_nothing_is_there() -> None:
    found = words((ADA, THREE, NOTHING), (BOB, THREE, NOTHING))
    assert found.is_here()
    assert found.record is None


def test_of_what_is_forged_the_version_counts_and_the_bytes_come_from_another() -> None:
    found = CopyWords(3, 2, OWNERS)
    found.hear(ADA.node, THREE, record(replace(NEW, ciphertext=b"forged")), is_forged=True)
    found.hear(BOB.node, THREE, digest(NEW))
    assert found.version == version_of(NEW.header) and not found.is_here()
    found.hear(BOB.node, THREE, record(NEW))
    assert found.record == NEW


def test_what_counts_but_is_not_here_yet_is_known_to_be_missing() -> None:
    found = words((ADA, THREE, digest(NEW)), (BOB, THREE, digest(NEW)))
    assert found.version == version_of(NEW.header)
    assert not found.is_here()


@pytest.mark.parametrize(
    "said",
    [
        [(ADA, THREE, record(NEW))],
        [(ADA, THREE, record(NEW)), (ADA, THREE, record(NEW))],
        [(ADA, THREE, digest(NEW)), (BOB, THREE, record(OLD))],
        [(ADA, THREE, record(NEW)), (BOB, THREE, DAMAGED)],
        [(ADA, THREE, DAMAGED), (BOB, THREE, DAMAGED)],
        [(ADA, THREE, record(NEW)), (BOB, replace(THREE, number=8), record(NEW))],
        [(ADA, THREE, record(NEW)), (EVE, THREE, record(NEW))],
        [(ADA, THREE, record(NEW)), (OWNER, THREE, record(NEW))],
    ],
    ids=[
        "one alone",
        "one twice",
        "one of which nobody knows how new it is",
        "one rotten",
        "both rotten",
        "another number",
        "no member",
        "the owner",
    ],
)
def test_what_is_too_little(said: list[tuple[Member, Configuration, Copy]]) -> None:
    assert words(*said).version is None


@pytest.mark.parametrize("other", [record(OLD), NOTHING], ids=["older", "nothing"])
def test_where_they_differ_the_newest_counts_as_nothing_newer_can_have_been_acknowledged(other: Copy) -> None:
    """As one is owed a write that was acknowledged with the other's word just before its owner died."""
    for said in ([(ADA, THREE, record(NEW)), (BOB, THREE, other)], [(BOB, THREE, other), (ADA, THREE, record(NEW))]):
        found = words(*said)
        assert found.is_here() and found.record == NEW
        assert found.otherwise(version_of(NEW.header)) == {BOB.node}
        assert not found.unordered()


def test_how_new_what_differs_is_has_to_be_shown() -> None:
    found = words((ADA, THREE, digest(NEW)), (BOB, THREE, digest(OLD)))
    assert found.version is None and found.unordered() == {ADA.node, BOB.node}
    found.hear(BOB.node, THREE, record(OLD))
    assert found.version is None and found.unordered() == {ADA.node}
    found.hear(ADA.node, THREE, record(NEW))
    assert found.record == NEW
    forged = words((BOB, THREE, record(OLD)))
    forged.hear(ADA.node, THREE, record(NEW), is_forged=True)
    assert forged.version is None, "whose signature does not hold may claim to be as new as it likes"


def test_what_a_node_says_again_takes_the_place_of_what_it_said() -> None:
    found = words((ADA, THREE, digest(OLD)), (BOB, THREE, digest(OLD)), (ADA, THREE, record(NEW)), (BOB, THREE, record(NEW)))
    assert found.record == NEW and not found.otherwise(version_of(NEW.header))


def test_who_holds_copies_besides_is_named_by_those_who_do() -> None:
    found = words((ADA, THREE, NOTHING), (BOB, replace(THREE, members=(OWNER, BOB, EVE)), NOTHING))
    assert found.named_by(ADA.node) == {ADA.node, BOB.node} and found.named_by(BOB.node) == {BOB.node, EVE.node} and not found.is_silence
    found = words((EVE, THREE, NOTHING))
    assert not found.named_by(EVE.node) and found.is_silence, "who has no part in it names nobody"


def test_who_names_a_configuration_in_which_it_decides_alone_does_not() -> None:
    alone = Configuration(99, (OWNER, EVE), 2)
    assert alone.quorum == 1
    assert words((EVE, alone, NOTHING)).version is None
    assert words((EVE, alone, NOTHING), shape=(2, 2)).version == b"", "with two copies, both of which must be there, it may"


def test_what_is_told_lies_with_as_many_as_what_is_acknowledged() -> None:
    """Where all three must have a record, one holder that has it cannot know whether the other has."""
    strict = replace(THREE, needed=3)
    assert words((ADA, strict, record(NEW)), shape=(2, 2)).version is None
    assert words((ADA, strict, record(NEW)), (BOB, strict, record(NEW)), shape=(2, 2)).record == NEW
    assert words((ADA, strict, record(NEW)), (BOB, strict, record(OLD)), shape=(2, 2)).version is None
    assert [quorum(*shape) for shape in [(3, 2), (3, 3), (2, 2), (2, 1), (3, 1), (5, 3)]] == [2, 1, 1, 2, 3, 3]


def test_who_names_another_owner_than_is_known_does_not_count() -> None:
    theirs = Configuration(99, (EVE, ADA, BOB), 2)
    assert words((ADA, theirs, NOTHING), (BOB, theirs, NOTHING)).version is None


members = st.sampled_from([ADA, BOB, EVE])


@given(st.integers(2, 4), st.integers(1, 4), st.data())
def test_never_older_than_what_was_acknowledged(copies: int, needed: int, data: st.DataObject) -> None:
    """Any set of holders that lacks a version which `needed` of the members have cannot make an older one count."""
    needed = min(needed, copies)
    holders = [Member(NodeId(10 + index), bytes(16)) for index in range(copies - 1)]
    configuration = Configuration(1, (OWNER, *holders), needed)
    have = data.draw(st.sets(st.sampled_from([OWNER, *holders]), min_size=needed, max_size=copies))
    said = data.draw(st.permutations(holders))
    found = CopyWords(copies, needed, OWNERS)
    for holder in said[: data.draw(st.integers(0, len(said)))]:
        newest = st.sampled_from([record(NEW), digest(NEW)])
        found.hear(holder.node, configuration, data.draw(newest if holder in have else st.sampled_from([record(OLD), NOTHING])))
        assert found.version in (None, version_of(NEW.header))


def test_what_cannot_be_said_is_no_word() -> None:
    assert word_of(DAMAGED) is None
    assert word_of(Copy(CopyState.NO_CUSTODY, 0, b"", None)) is None
