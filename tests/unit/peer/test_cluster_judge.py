"""If this fails, voters of one cluster decide what does not fit its log, differ about it, or lose count of who decides."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.limits import VOTERS_MAX
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Ask, Decide, Learn, Outcome, Received, Reply, Send, Setting, State, Tell, Value, View, take
from scenefold.consensus.packets import decided_page, decided_value, messages_of, packet_of
from scenefold.peer.cluster_log.cluster_judge import ClusterJudge, record_in
from scenefold.peer.cluster_log.log_book import verified
from scenefold.peer.cluster_log.registry import Registry
from scenefold.wire import (
    LogEntry,
    RemoveNode,
    RespondSceneLog,
    RevokeNode,
    SceneMode,
    SetMode,
    Trust,
    decode_packet,
    encode_packet,
    hash_of_record,
)
from scenefold.wire.enrol_entries import Withdraw
from unit.peer.logs_made import LOG_KEY, add, folded, found, key_of, member, node, record, remove, signed
from unit.peer.voters_made import GENESIS, Senate, dismissed, named, request_of, trusted

NOT_AUTHORISED, ILL_FORMED, WRONG_INCARNATION = RejectReason.NOT_AUTHORISED, RejectReason.ILL_FORMED, RejectReason.WRONG_INCARNATION


def refusal(senate: Senate, entry: LogEntry, origin: int = 0) -> RejectReason | None:
    return senate.judge.refuses(senate.value(entry, origin))


def folding(after: Registry, entry: LogEntry) -> RejectReason:
    with pytest.raises(Refused) as caught:
        after.apply(record(after, entry))
    return caught.value.reason


# ---------------------------------------------------------------------------------------------------- who decides


def test_who_has_decided_by_the_logs_key_is_the_first_voter() -> None:
    begun = folded(found(3), add(0), add(1), trusted(1))
    assert begun.voting.deciders is None and begun.voters == (node(0),)
    assert folding(begun, named(1)) is ILL_FORMED, "another one has decided until now"
    assert folding(begun, dismissed(0)) is NOT_AUTHORISED, "nobody is named yet, so this would be the last"
    after = begun.apply(record(begun, named(0)))
    assert after.voters == (node(0),) and after.voting.certified_from == after.position
    deciders = after.voting.deciders
    assert deciders is not None and deciders.key_of(member(0)) == key_of(0).public and deciders.majority == 1


@pytest.mark.parametrize(
    ("entry", "reason"),
    [
        (named(9), WRONG_INCARNATION),
        (named(3, life=1), WRONG_INCARNATION),
        (replace(named(3), key=key_of(4).public.raw), NOT_AUTHORISED),
        (named(2), ILL_FORMED),
        (dismissed(3), ILL_FORMED),
        (dismissed(2, life=1), WRONG_INCARNATION),
    ],
)
def test_voters_are_members_as_they_are_registered(entry: LogEntry, reason: RejectReason) -> None:
    senate = Senate()
    assert refusal(senate, entry) is folding(senate.registry, entry) is reason


def test_only_who_is_trusted_and_has_a_key_that_counts_votes() -> None:
    senate = Senate()
    senate.decide(Trust(node(3), False))
    assert refusal(senate, named(3)) is NOT_AUTHORISED
    senate.decide(RevokeNode(node(4), key_of(4).public.key_id))
    assert refusal(senate, named(4)) is RejectReason.KEY_REVOKED
    senate.decide(trusted(3))
    senate.decide(named(3))
    assert senate.registry.voters == tuple(map(node, (0, 1, 2, 3)))


def test_there_are_seven_voters_at_most_and_one_at_least() -> None:
    senate = Senate(members=VOTERS_MAX + 1, voters=VOTERS_MAX)
    assert refusal(senate, named(VOTERS_MAX)) is RejectReason.LIMIT_EXCEEDED
    for number in range(1, VOTERS_MAX):
        senate.decide(dismissed(number))
    assert senate.judge.participants.nodes == {node(0)} and refusal(senate, dismissed(0)) is NOT_AUTHORISED


def test_a_voter_keeps_key_trust_and_place_until_it_is_none() -> None:
    senate = Senate()
    takings: list[LogEntry] = [RevokeNode(node(1), key_of(1).public.key_id), Trust(node(1), False), remove(1)]
    for entry in takings:
        assert refusal(senate, entry) is folding(senate.registry, entry) is NOT_AUTHORISED
    senate.decide(dismissed(1))
    for entry in takings:
        assert refusal(senate, entry) is None
    # One that decides by the log's key is bound by what is asked of orders, and by nothing new.
    begun = folded(found(2), add(0), trusted(0))
    assert not begun.apply(record(begun, Trust(node(0), False))).is_trusted(node(0))


def test_the_councils_say_who_decided_which_position() -> None:
    senate = Senate(members=4, voters=2)
    first = senate.registry.voting.certified_from
    senate.decide(named(2))
    senate.decide(dismissed(0))
    councils = senate.registry.voting.councils
    assert [council.position for council in councils] == [first, first + 1, first + 2, first + 3]
    assert [sorted(one - node(0) for one in council.voters.nodes) for council in councils] == [[0], [0, 1], [0, 1, 2], [1, 2]]
    assert senate.registry.voters == (node(1), node(2))


def test_the_key_that_was_sealed_at_first_counts_until_the_node_begins_anew() -> None:
    senate = Senate()
    assert senate.registry.issuers == {node(number) for number in range(5)}
    only = folded(found(3), add(0), add(1), Trust(node(1), True, trusted(1).sealing_key), named(0))
    assert only.issuers == {node(0)}
    two = only.apply(record(only, named(1)))
    assert two.voters == (node(0), node(1)) and two.issuers == {node(0)}, "to vote is not to have the authority's key"


# -------------------------------------------------------------------------------------------------------- values


def test_a_value_is_a_record_and_its_digest_the_hash_that_the_next_names() -> None:
    senate = Senate()
    value = senate.decide(remove(4))
    assert value.body == b"" and value.digest == hash_of_record(value.data) == senate.registry.head
    assert record_in(senate.value(add(4, left_of=0, life=1), origin=4)).prev_hash == value.digest


def test_what_is_no_record_for_the_next_position_is_ill_formed() -> None:
    senate = Senate()
    good = senate.record(remove(4))
    for bad in (replace(good, position=good.position + 1), replace(good, position=good.position - 1), replace(good, prev_hash=bytes(32))):
        assert senate.judge.refuses(Value(bad.encode())) is ILL_FORMED
    assert senate.judge.refuses(Value(good.encode())) is None
    for data in (b"", b"what is that?", good.encode() + b"\0", good.encode()[:-1], bytes(1000)):
        assert senate.judge.refuses(Value(data)) is ILL_FORMED and senate.judge.found(Value(data)) is None
    assert senate.judge.refuses(Value(good.encode(), b"besides")) is ILL_FORMED
    assert senate.judge.refuses(Value(good.encode(), b"besides"), is_decided=True) is ILL_FORMED
    assert refusal(senate, SetMode(SceneMode.RENDER)) is ILL_FORMED and refusal(senate, found(3)) is ILL_FORMED


@given(st.data())
def test_whatever_comes_is_judged(data: st.DataObject) -> None:
    """A record with bytes changed, cut off or put in: it is refused, or it is another record that fits; nothing else is raised."""
    senate = _SENATE
    entries: list[LogEntry] = [remove(4), named(3), trusted(2), dismissed(1)]
    good = senate.value(data.draw(st.sampled_from(entries))).data
    at = data.draw(st.integers(0, len(good)))
    until = data.draw(st.integers(at, min(len(good), at + 8)))
    value = Value(good[:at] + data.draw(st.binary(max_size=8)) + good[until:])
    if senate.judge.refuses(value) is None:
        after = senate.judge.after(value)
        assert after.registry.position == senate.registry.position + 1 and after.registry.head == value.digest
        assert after.found(value) == after.registry.position
        assert record_in(value).encode() == value.data, "a record has one encoding"


_SENATE = Senate()


def test_who_proposes_what_is_judged_as_far_as_the_log_tells() -> None:
    senate = Senate()
    senate.decide(remove(4), origin=4)
    assert refusal(senate, add(4, left_of=0, life=1), origin=4) is None
    assert refusal(senate, add(4, left_of=0, life=1), origin=0) is NOT_AUTHORISED, "a node registers itself"
    assert refusal(senate, remove(3), origin=4) is NOT_AUTHORISED, "no member any more"
    assert refusal(senate, remove(3), origin=3) is None
    orders: list[LogEntry] = [Trust(node(3), False), RevokeNode(node(3), key_of(3).public.key_id), named(3), dismissed(2)]
    for entry in orders:
        assert refusal(senate, entry, origin=3) is NOT_AUTHORISED and refusal(senate, entry, origin=1) is None
    assert refusal(senate, Withdraw(bytes(32)), origin=3) is NOT_AUTHORISED
    assert refusal(senate, trusted(3), origin=3) is None, "who is trusted seals to who is"


def test_the_last_one_that_can_issue_is_not_stripped() -> None:
    senate = Senate()
    for number in (1, 2):
        senate.decide(dismissed(number))
    for number in (1, 2, 3, 4):
        senate.decide(Trust(node(number), False))
    senate.decide(Trust(node(1), True, trusted(1).sealing_key))
    senate.decide(named(1))
    senate.decide(dismissed(0), origin=1)
    assert senate.registry.issuers == {node(0)}
    assert refusal(senate, Trust(node(0), False), origin=1) is RejectReason.NOT_READY, "the key is still to be sealed to the other one"


def test_a_request_is_found_wherever_it_stands() -> None:
    senate = Senate()
    request = request_of("gone")
    value = senate.value(remove(4), request=request)
    assert senate.judge.found(value) is None
    after = senate.judge.after(value)
    later = Value(record(after.registry, remove(4), request).encode())
    assert after.found(value) == after.found(later) == after.registry.position
    other = Value(record(after.registry, remove(3), request).encode())
    assert after.found(other) is None and after.refuses(other) is ILL_FORMED, "under a request's id stands one entry"
    known = senate.registry.current(node(2))
    assert known is not None and senate.judge.found(senate.value(add(2, left_of=1), origin=2)) == known.position, "it is registered already"
    assert senate.judge.found(senate.value(add(2, left_of=1, life=1), origin=2)) is None


# ---------------------------------------------------------------------------------------- from the key to votes


def test_the_logs_key_decides_nothing_behind_the_first_voter() -> None:
    senate = Senate(voters=1)
    whole, fresh = verified(Registry(), senate.records, LOG_KEY.public)
    assert whole.head == senate.registry.head and len(fresh) == len(senate.records)
    late = signed(senate.record(remove(4)))
    for known, brought in ((Registry(), [*senate.records, late]), (whole, [late]), (whole, [*senate.records[-3:], late])):
        with pytest.raises(Refused) as caught:
            verified(known, brought, LOG_KEY.public)
        assert caught.value.reason is NOT_AUTHORISED
    assert verified(whole, senate.records, LOG_KEY.public)[1] == []
    senate.decide(remove(4))
    assert verified(senate.registry, senate.records, LOG_KEY.public)[1] == [], "who knows more is not held up by what was before"


def test_a_certificate_is_of_those_who_decide_its_position() -> None:
    senate = Senate(voters=3)
    (second, by_one), (third, by_two) = senate.decided
    key = senate.registry.voting.councils
    assert by_one.proves(second, GENESIS, key[0].voters) and by_two.proves(third, GENESIS, key[1].voters)
    assert not by_one.proves(third, GENESIS, key[0].voters), "of another value"
    assert not by_two.proves(third, bytes(32), key[1].voters), "of another log"
    value = senate.value(remove(4))
    for enough, voters in ((False, (0,)), (True, (0, 2)), (False, (0, 3, 4)), (True, (0, 1, 2))):
        assert senate.certificate(value, voters).proves(value, GENESIS, senate.judge.participants) is enough


# ------------------------------------------------------------------------------------------- with the protocol itself


@dataclass
class Table:
    """Voters and others who only learn, and packets between them, as bytes."""

    senate: Senate
    away: set[int] = field(default_factory=set)
    posted: deque[tuple[NodeId, NodeId, bytes]] = field(default_factory=deque)

    def __post_init__(self) -> None:
        judge, everyone = self.senate.judge, range(self.senate.members)
        self.settings = {node(number): Setting(GENESIS, member(number), key_of(number)) for number in everyone}
        self.states = {node(number): State(judge, self.senate.registry.position) for number in everyone}
        self.decided: dict[NodeId, list[Learn]] = {one: [] for one in self.states}
        self.replies: list[Reply] = []

    def happen(self, at: NodeId, event: Ask | Received) -> None:
        everyone = tuple(sorted(self.states))
        here = frozenset(everyone) - {node(number) for number in self.away}
        step = take(self.settings[at], self.states[at], event, View(0.0, everyone, here, here))
        self.states[at] = step.after
        for effect in step.effects:
            match effect:
                case Decide(position, value, certificate):
                    self.decided[at].append(Learn(GENESIS, position, value, certificate))
                case Send(target, message):
                    self.posted.append((at, target, encode_packet(packet_of(message))))
                case Tell(target, have):
                    lacking = [decided_value(one) for one in self.decided[at] if one.position > have]
                    page = decided_page(GENESIS, self.states[at].position, lacking)
                    self.posted.append((at, target, encode_packet(RespondSceneLog(None, page))))
                case Reply():
                    self.replies.append(effect)
                case _:
                    pass

    def run(self) -> None:
        while self.posted:
            source, target, data = self.posted.popleft()
            if not {source, target} & {node(number) for number in self.away}:
                for message in messages_of(decode_packet(data)):
                    self.happen(target, Received(source, message))

    def ask(self, number: int, entry: LogEntry, origin: int, request: str) -> Outcome:
        registry = self.registry(number)
        value = Value(record(registry, entry, request_of(request), origin).encode())
        self.happen(node(number), Ask(value, 30.0))
        self.run()
        return self.replies[-1].outcome

    def registry(self, number: int) -> Registry:
        judge = self.states[node(number)].judge
        assert isinstance(judge, ClusterJudge)
        return judge.registry


def test_voters_come_and_go_by_their_own_votes() -> None:
    """The log's first voter alone, then two more by votes; then the first one goes, and the others go on without it."""
    table = Table(Senate(members=4, voters=1))
    assert table.ask(0, named(1), 0, "one") is Outcome.COMMITTED
    assert table.ask(1, named(2), 1, "two") is Outcome.COMMITTED
    assert table.ask(2, dismissed(0), 2, "gone") is Outcome.COMMITTED
    table.away.add(0)
    assert table.ask(1, remove(3), 1, "away") is Outcome.COMMITTED
    assert table.ask(2, remove(3), 1, "away") is Outcome.COMMITTED, "asked again elsewhere, it is found"
    assert table.registry(1).head == table.registry(2).head and not table.registry(1).stands(node(3))
    assert table.registry(1).voters == (node(1), node(2))
    assert table.ask(1, named(3), 1, "back") is Outcome.REJECTED, "it is no member any more"


def test_two_voters_that_are_asked_for_the_same_decide_it_once() -> None:
    table = Table(Senate(members=4, voters=3))
    registry, request = table.registry(1), request_of("twice")
    value = Value(record(registry, RemoveNode(member(3), "gone"), request, 0).encode())
    for number in (1, 2):
        table.happen(node(number), Ask(value, 30.0))
    table.run()
    assert [reply.outcome for reply in table.replies if reply.outcome is Outcome.COMMITTED]
    assert table.registry(0).position_of(request) == registry.position + 1 and table.registry(0).position == registry.position + 1
