"""If this fails, a wiped or restored disk speaks as if nothing had happened, or a node never becomes a member."""

from __future__ import annotations

from dataclasses import replace

import pytest

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.log_rules import check_proposer, predecessor
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.enrolment.enrolment import Step, next_step
from scenefold.wire import LogEntry, Member, RevokeNode, Trust
from unit.peer.logs_made import add, facts, folded, found, key_of, member, node, remove, secrets_of

CASES = {
    "nothing is known": (Registry(), member(1), False, Step.WAIT),
    "a founder that never registered": (folded(found(3), add(0)), member(1), False, Step.TAKE_SEAT),
    "registered": (folded(found(3), add(0), add(1)), member(1), False, Step.BE_MEMBER),
    "registered, and its disk was rolled back": (folded(found(3), add(0), add(1)), member(1), True, Step.RENEW),
    "removed": (folded(found(3), add(0), add(1), remove(1)), member(1), False, Step.RENEW),
    "removed, and back under another incarnation": (
        folded(found(3), add(0), add(1), remove(1), add(1, left_of=0, life=1)),
        member(1),
        False,
        Step.RENEW,
    ),
    "a wiped founder": (folded(found(3), add(0), add(1)), member(1, life=1), False, Step.JOIN),
    "a removed founder with a new incarnation": (folded(found(3), add(0), add(1), remove(1)), member(1, life=1), False, Step.JOIN),
    "a spare": (folded(found(3), add(0)), member(7), False, Step.JOIN),
    "the voter, wiped": (folded(found(3), add(0)), member(0, life=1), False, Step.GIVE_UP),
    "the voter at its first start": (folded(found(3)), member(0), False, Step.TAKE_SEAT),
}


@pytest.mark.parametrize("name", CASES)
def test_the_next_step_follows_from_the_log(name: str) -> None:
    registry, me, rolled_back, step = CASES[name]
    assert next_step(registry, me, is_rolled_back=rolled_back) is step


def refusal(entry: LogEntry, proposer: int, registry: Registry) -> RejectReason:
    with pytest.raises(Refused) as caught:
        check_proposer(entry, node(proposer), registry, facts(3, spares=1), 0.0)
    return caught.value.reason


def test_a_node_registers_itself_with_the_keys_that_it_was_certified_with() -> None:
    registry = folded(found(3), add(0))
    check_proposer(add(1), node(1), registry, facts(3), 0.0)
    check_proposer(add(9, left_of=0), node(9), registry, facts(3), 0.0)  # certified later, unknown to these facts
    assert refusal(add(1), 2, registry) == RejectReason.NOT_AUTHORISED
    stolen = add(3, left_of=0)
    for changed in ({"key": key_of(9).public.raw}, {"sealing_key": secrets_of(9).sealing.public.raw}):
        assert refusal(replace(stolen, **changed), 3, registry) == RejectReason.NOT_AUTHORISED


def test_members_propose_removals_and_voters_the_rest() -> None:
    registry = folded(found(3), add(0), add(1))
    check_proposer(remove(1), node(1), registry, facts(3), 0.0)
    check_proposer(remove(2), node(1), registry, facts(3), 0.0)
    assert refusal(remove(1), 2, registry) == RejectReason.NOT_AUTHORISED, "no member yet"
    for entry in (Trust(node(1), True, secrets_of(1).sealing.public.raw), RevokeNode(node(1), key_of(1).public.key_id)):
        check_proposer(entry, node(0), registry, facts(3), 0.0)
        assert refusal(entry, 1, registry) == RejectReason.NOT_AUTHORISED
    assert refusal(found(3), 0, registry) == RejectReason.ILL_FORMED


def test_nothing_is_sealed_to_other_keys_than_the_members() -> None:
    registry = folded(found(3), add(0), add(1))
    for sealed in (b"", b"sealed"):
        assert refusal(Trust(node(1), True, secrets_of(2).sealing.public.raw, sealed), 0, registry) == RejectReason.NOT_AUTHORISED
    trusted = folded(found(3), add(0), add(1), Trust(node(1), True, secrets_of(1).sealing.public.raw))
    check_proposer(Trust(node(1), True, secrets_of(1).sealing.public.raw, b"sealed"), node(0), trusted, facts(3), 0.0)
    assert refusal(Trust(node(1), True, secrets_of(2).sealing.public.raw, b"sealed"), 0, trusted) == RejectReason.NOT_AUTHORISED


def test_only_another_incarnation_of_the_same_node_has_to_go_first() -> None:
    registry = folded(found(3), add(0), add(1))
    assert predecessor(add(1, left_of=0, life=1), registry) == member(1)
    assert predecessor(add(1), registry) is None and predecessor(add(2), registry) is None
    assert predecessor(remove(1), registry) is None


def test_members_are_told_apart_by_incarnation() -> None:
    registry = folded(found(3), add(0), add(1))
    assert registry.is_current(member(1)) and not registry.is_current(Member(node(1), bytes(16)))
