"""If this fails, nodes disagree on who is a member or who stands beside whom, or a removed incarnation comes back."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.location import FIRST, LAST
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.registered import NO_INCARNATION
from scenefold.peer.cluster_log.registry import Registry
from scenefold.wire import LogEntry, Member, RemoveNode, RevokeNode, SceneMode, SetMode, Trust
from unit.peer.logs_made import add, folded, found, incarnation, key_of, member, node, record, remove, secrets_of


def refusal(after: Registry, entry: LogEntry) -> RejectReason:
    with pytest.raises(Refused) as caught:
        after.apply(record(after, entry))
    return caught.value.reason


def test_founders_stand_in_id_order_with_even_arcs_before_anybody_registered() -> None:
    registry = folded(found(4))
    assert registry.order == tuple(node(number) for number in range(4)) and registry.members == ()
    arcs = [registry.founding_arc(node(number)) for number in range(4)]
    assert arcs[0] is not None and arcs[0].first == FIRST and arcs[3] is not None and arcs[3].last == LAST
    assert all(left and right and left.last.next() == right.first for left, right in pairwise(arcs))
    assert registry.vacant_seat(node(2)) is not None and registry.current(node(2)) is None


def test_a_founder_takes_its_seat_once_and_only_with_its_keys() -> None:
    registry = folded(found(3), add(1))
    assert registry.members == (node(1),) and registry.is_current(member(1)) and not registry.is_current(member(1, life=1))
    assert registry.vacant_seat(node(1)) is None and registry.founding_arc(node(1)) is not None
    assert refusal(registry, add(1, life=1)) == RejectReason.BUSY, "the id is in use"
    for changed in ({"key": key_of(9).public.raw}, {"sealing_key": secrets_of(9).sealing.public.raw}):
        assert refusal(registry, replace(add(2), **changed)) == RejectReason.NOT_AUTHORISED
    assert [registry.sealing_key_of(node(number)) for number in (1, 2, 7)] == [*(secrets_of(n).sealing.public for n in (1, 2)), None]
    assert refusal(registry, add(7)) == RejectReason.ILL_FORMED, "no founder"
    assert refusal(registry, add(2, left_of=0)) == RejectReason.ILL_FORMED, "a founder has a seat already"


def test_a_newcomer_stands_directly_left_of_whom_it_names() -> None:
    registry = folded(found(3), add(0), add(9, left_of=1), add(8, left_of=1), add(7, left_of=0))
    assert registry.order == tuple(node(number) for number in (7, 0, 9, 8, 1, 2))
    assert registry.neighbours(node(8)) == (node(9), node(1))
    assert registry.neighbours(node(7)) == (None, node(0)) and registry.neighbours(node(2)) == (node(1), None)
    assert registry.founding_arc(node(9)) is None
    assert refusal(registry, add(6, left_of=5)) == RejectReason.ILL_FORMED


def test_a_removed_incarnation_never_comes_back_and_a_new_one_has_no_founding_arc() -> None:
    registry = folded(found(3), add(0), add(1), remove(1, reason="silent for 120 s"))
    assert registry.order == (node(0), node(2)) and not registry.stands(node(1))
    removal = registry.removal(incarnation(1))
    assert removal is not None and (removal.reason, removal.position) == ("silent for 120 s", 4)
    assert refusal(registry, add(1, left_of=0)) == RejectReason.WRONG_INCARNATION
    assert refusal(registry, add(1, life=1)) == RejectReason.ILL_FORMED, "its seat is gone"
    back = registry.apply(record(registry, add(1, left_of=0, life=1)))
    assert back.order == (node(1), node(0), node(2)) and back.is_current(member(1, life=1))
    assert back.founding_arc(node(1)) is None and back.founding_arc(node(2)) is not None


def test_only_the_incarnation_that_is_a_member_can_be_removed_and_no_voter() -> None:
    registry = folded(found(3), add(0), add(1))
    assert refusal(registry, remove(1, life=1)) == RejectReason.WRONG_INCARNATION
    assert refusal(registry, remove(0)) == RejectReason.NOT_AUTHORISED
    assert refusal(registry, remove(5)) == RejectReason.ILL_FORMED
    assert refusal(registry, remove(2)) == RejectReason.WRONG_INCARNATION, "it never registered"
    gone = registry.apply(record(registry, RemoveNode(Member(node(2), NO_INCARNATION), "never came")))
    assert gone.order == (node(0), node(1)) and gone.removal(NO_INCARNATION) is None
    assert refusal(gone, add(2)) == RejectReason.ILL_FORMED, "its seat is gone"


def test_a_revoked_key_opens_nothing() -> None:
    registry = folded(found(3), add(0), RevokeNode(node(1), key_of(1).public.key_id))
    assert registry.is_revoked(node(1), key_of(1).public.key_id)
    assert refusal(registry, add(1)) == RejectReason.KEY_REVOKED


def test_trust_comes_and_goes() -> None:
    registry = folded(found(2), Trust(node(1), True, bytes(32)))
    assert registry.is_trusted(node(1))
    assert not registry.apply(record(registry, Trust(node(1), False))).is_trusted(node(1))


def test_records_follow_each_other_without_gap_or_fork() -> None:
    registry = folded(found(2), add(0))
    good = record(registry, add(1))
    assert registry.apply(good).head == good.hash()
    for bent, reason in (
        (replace(good, position=2), RejectReason.POSITION_BEHIND),
        (replace(good, position=9), RejectReason.PEER_MISSED),
        (replace(good, prev_hash=bytes(32)), RejectReason.ILL_FORMED),
    ):
        with pytest.raises(Refused) as caught:
            registry.apply(bent)
        assert caught.value.reason == reason


def test_a_request_is_committed_once() -> None:
    registry = Registry().apply(record(Registry(), found(2)))
    registry = registry.apply(record(registry, add(0), request=b"r" * 16))
    assert registry.position_of(b"r" * 16) == 2 and registry.position_of(b"s" * 16) is None
    assert registry.committed_at(b"r" * 16, add(0)) == 2 and registry.committed_at(b"s" * 16, add(0)) is None
    with pytest.raises(Refused) as caught:
        registry.apply(record(registry, add(1), request=b"r" * 16))
    assert caught.value.reason == RejectReason.ILL_FORMED


@pytest.mark.parametrize("other", [add(1), add(0, life=1), replace(add(0), left_of=node(1)), replace(add(0), key=bytes(32))])
def test_a_request_is_done_only_if_what_it_says_was_committed(other: LogEntry) -> None:
    registry = Registry().apply(record(Registry(), found(2)))
    registry = registry.apply(record(registry, add(0), request=b"r" * 16))
    with pytest.raises(Refused, match="another entry has this request's id, at position 2") as caught:
        registry.committed_at(b"r" * 16, other)
    assert caught.value.reason == RejectReason.ILL_FORMED


@pytest.mark.parametrize("entry", [add(0), remove(0), SetMode(SceneMode.RENDER), Trust(node(0), True, bytes(32))])
def test_a_log_begins_with_its_founders_and_holds_nothing_of_scenes(entry: LogEntry) -> None:
    assert refusal(Registry(), entry) in (RejectReason.ILL_FORMED, RejectReason.WRONG_INCARNATION)
    if isinstance(entry, SetMode):
        assert refusal(folded(found(1)), entry) == RejectReason.ILL_FORMED


@pytest.mark.parametrize(
    "bent",
    [
        replace(found(3), founders=found(3).founders[::-1]),
        replace(found(3), founders=found(3).founders * 2),
        replace(found(3), founders=()),
        replace(found(3), voters=()),
        replace(found(3), voters=(node(7),)),
        replace(found(3), founders=(replace(found(3).founders[0], address="127.0.0.9"),)),
    ],
)
def test_founders_that_cannot_be_are_refused(bent: LogEntry) -> None:
    assert refusal(Registry(), bent) == RejectReason.ILL_FORMED
    assert refusal(folded(found(2)), found(2)) == RejectReason.ILL_FORMED, "founded once"


def test_a_refused_record_changes_nothing() -> None:
    registry = folded(found(2), add(0))
    first = record(registry, add(1))
    with pytest.raises(Refused):
        registry.extended((first, record(registry, add(1))))
    assert registry.position == 2 and registry.current(node(1)) is None and registry.position_of(first.request_id) is None


steps = st.lists(st.tuples(st.sampled_from("arf"), st.integers(0, 7), st.integers(0, 7), st.integers(0, 2)), max_size=40)


@given(steps)
def test_whatever_happens_order_and_members_fit_each_other(wishes: list[tuple[str, int, int, int]]) -> None:
    """Also: one at a time or all at once is the same, and a removed incarnation is never a member again."""
    registry, kept = Registry(), []
    first = record(registry, found(4))
    registry, kept = registry.apply(first), [first]
    for kind, number, other, life in wishes:
        adding = add(number, left_of=None if kind == "f" else other, life=life)
        entry = remove(number, life=life) if kind == "r" else adding
        step = record(registry, entry)
        before = registry
        try:
            registry = registry.apply(step)
        except Refused:
            assert registry is before
            continue
        kept.append(step)
        check_order(before, registry, entry.member.node)
    again = Registry().extended(kept)
    assert (again.order, again.members, again.head) == (registry.order, registry.members, registry.head)
    assert list(again.removed) == list(registry.removed)


def check_order(before: Registry, after: Registry, moved: NodeId) -> None:
    assert len(set(after.order)) == len(after.order) and set(after.members) <= set(after.order)
    assert [one for one in before.order if one != moved] == [one for one in after.order if one != moved], "nobody else moves"
    assert set(before.removed) <= set(after.removed)
    for one in after.members:
        known = after.current(one)
        assert known is not None and after.removal(known.incarnation) is None and after.order[after.rank(one)] == one
    assert node(0) in after.order, "a voter stays"
