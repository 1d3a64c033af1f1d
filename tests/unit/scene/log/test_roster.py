"""If this fails, two nodes that read one log differ about who decides it, or nobody can decide it any more."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.limits import DECIDERS_MAX
from scenefold.base.reasons import RejectReason
from scenefold.scene.log import SceneLog, first_log
from scenefold.scene.log.roster import Roster, misfit, unlawful
from scenefold.wire import AddObserver, Batch, LogEntry, Member, ParticipantEntry, RemoveObserver, SceneMode, SetMode
from unit.scene.log.council import added, node, removed
from unit.scene.log.members import MAKER

GENESIS = bytes(range(32))
ORIGIN = NodeId(7)


def observer(number: int) -> AddObserver:
    entry = node(number)
    return AddObserver(entry.member, entry.key)


def left(number: int) -> RemoveObserver:
    return RemoveObserver(node(number).member)


def with_entries(log: SceneLog, *entries: LogEntry) -> SceneLog:
    for entry in entries:
        log = log.apply(log.next_record(entry, log.position.to_bytes(16, "big"), ORIGIN))
    return log


def begun(*first: int) -> SceneLog:
    return first_log(GENESIS, ORIGIN, MAKER, copies=1, participants=[node(number) for number in first])


def test_the_first_record_may_name_several() -> None:
    assert begun().roster == Roster()
    assert begun(3, 1, 2).roster == Roster((node(1), node(2), node(3)))
    assert with_entries(begun(), Batch((added(9), added(4)))).roster.participants == (node(4), node(9)), (
        "or a later one, the first that does"
    )


def test_they_come_and_go_one_by_one() -> None:
    log = with_entries(begun(1, 2, 3), added(9), removed(2), observer(2), observer(5), left(2), SetMode(SceneMode.RENDER))
    assert log.roster == Roster((node(1), node(3), node(9)), (node(5),))
    assert with_entries(log, removed(9), added(9, life=1)).roster.participants[-1] == node(9, life=1), (
        "a wiped node, once it is added again"
    )


BAD: dict[str, tuple[tuple[int, ...], list[LogEntry], str]] = {
    "takes part already": ((1, 2), [added(2)], "takes part already"),
    "in another incarnation": ((1, 2), [added(2, life=1)], "takes part already"),
    "an observer, too": ((1, 2), [observer(2)], "takes part already"),
    "a participant, too": ((1, 2), [observer(3), added(3)], "takes part already"),
    "does not take part": ((1, 2), [removed(3)], "does not take part"),
    "left in another incarnation": ((1, 2), [removed(2, life=1)], "does not take part"),
    "no observer": ((1, 2), [left(2)], "does not take part"),
    "the last one": ((1,), [removed(1)], "the last participant stays"),
    "two at once": ((1, 2), [Batch((added(3), added(4)))], "by one node"),
    "one for another": ((1, 2), [Batch((removed(2), added(3)))], "by one node"),
    "from one list to the other": ((1, 2), [Batch((removed(2), observer(2)))], "by one node"),
    "too many": (tuple(range(1, DECIDERS_MAX + 1)), [added(99)], "33 nodes of this kind are the most"),
}


@pytest.mark.parametrize("what", BAD)
def test_what_does_not_fit_is_refused_in_words(what: str) -> None:
    first, entries, words = BAD[what]
    with pytest.raises(Refused, match=words) as caught:
        with_entries(begun(*first), *entries)
    assert caught.value.reason is RejectReason.ILL_FORMED


def test_a_key_is_a_key() -> None:
    broken = ParticipantEntry(Member(NodeId(1), bytes(16)), b"short")
    assert unlawful((broken,), ()) == "the key of node 1 is none"
    assert unlawful((node(1), node(2)), (node(3),)) == ""
    assert unlawful((node(2), node(1)), ()) == "who takes part stands in the order of the nodes' ids"


@dataclass(frozen=True)
class Wish:
    number: int
    life: int
    what: int

    def entry(self) -> LogEntry:
        if self.what == 0:
            return added(self.number, self.life)
        if self.what == 1:
            return removed(self.number, self.life)
        return observer(self.number) if self.what == 2 else left(self.number)


WISHES = st.lists(st.builds(Wish, st.integers(1, 4), st.integers(0, 1), st.integers(0, 3)), max_size=30)


@given(WISHES)
def test_whatever_is_asked_for_the_lists_stay_lawful(wishes: list[Wish]) -> None:
    log, taken = begun(1, 2), 0
    for wish in wishes:
        before = log.roster
        try:
            log = with_entries(log, wish.entry())
        except Refused:
            continue
        taken += 1
        after = log.roster
        assert after != before and after.participants
        assert not unlawful(after.participants, after.observers)
        assert not misfit(before.participants, before.observers, after.participants, after.observers)
    assert log.position == 1 + taken
