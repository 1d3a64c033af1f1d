"""If this fails, participants without a scene's key decide what is not the scene's next position, or differ about it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import pytest

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.limits import LOG_BODY_BYTES_MAX
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Ask, Certificate, Decide, Learn, Outcome, Received, Reply, Send, Setting, State, Tell, Value, View, take
from scenefold.consensus.packets import decided_page, decided_value, messages_of, packet_of
from scenefold.crypto import HEADER_DOMAIN, SigningKey
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.scene_log import scene_judge
from scenefold.peer.scene_log.headers import checked_proposal
from scenefold.peer.scene_log.scene_judge import REQUESTS_MAX, SceneJudge
from scenefold.scene.log import CHANGES_MAX, Followed, check_decided, check_log, decided_by_votes, opened_value, value_of, without_log
from scenefold.wire import (
    LogValue,
    RespondSceneLog,
    Role,
    SceneBody,
    SceneLogPublic,
    SceneMode,
    SetMode,
    decode_packet,
    digest_of_header,
    encode_packet,
)
from unit.scene.log.council import Council, added, key_of, node, removed
from unit.scene.log.members import grant
from unit.scene.log.test_grants import KEEPER_KEY


def judge_of(council: Council) -> SceneJudge:
    return SceneJudge.of(council.known)


def signed(council: Council, header: SceneLogPublic, key: SigningKey | None = None) -> SceneLogPublic:
    """By an owner, who may sign what he likes."""
    assert council.keys.header_seed is not None
    key = key or SigningKey.from_seed(council.keys.header_seed)
    return replace(header, signature=key.sign(HEADER_DOMAIN, header.signable()))


def test_the_next_position_may_stand_and_says_who_decides_after_it() -> None:
    council = Council()
    judge = judge_of(council)
    for entry in (grant(1, Role.WRITER), added(4), removed(1), SetMode(SceneMode.RENDER)):
        offered = council.offer(entry)
        value = council.value(offered)
        assert judge.refuses(value) is None
        assert judge.found(value) is None
        judge = judge.after(value)
        council.settle(offered)
        assert judge.found(value) == council.header.position == judge.public.position
        assert {one.member for one in judge.participants.everyone} == {one.member for one in council.header.participants}
    assert judge.changes == judge_of(council).changes == 3
    assert judge_of(council).participants == judge.participants, "whoever meets the scene later says the same"


Bend = Callable[[Council, Followed], SceneLogPublic]

REFUSED: dict[str, tuple[Bend, RejectReason]] = {
    "a position too far": (lambda it, new: replace(new.header, position=new.header.position + 1), RejectReason.ILL_FORMED),
    "the position that is known": (lambda it, new: replace(new.header, position=new.header.position - 1), RejectReason.ILL_FORMED),
    "it follows another header": (lambda it, new: replace(new.header, previous=digest_of_header(new.header)), RejectReason.ILL_FORMED),
    "it follows nothing": (lambda it, new: replace(new.header, previous=b""), RejectReason.ILL_FORMED),
    "no request": (lambda it, new: replace(new.header, request=b""), RejectReason.ILL_FORMED),
    "two join": (lambda it, new: replace(new.header, participants=(*new.header.participants, node(8), node(9))), RejectReason.ILL_FORMED),
    "nobody is left": (lambda it, new: replace(new.header, participants=()), RejectReason.ILL_FORMED),
    "out of order": (lambda it, new: replace(new.header, participants=(node(9), *new.header.participants)), RejectReason.ILL_FORMED),
    "a participant observes": (lambda it, new: replace(new.header, observers=(node(2),)), RejectReason.ILL_FORMED),
    "another log": (lambda it, new: replace(new.header, log_hash=bytes(32)), RejectReason.ILL_FORMED),
    "a write floor from the future": (lambda it, new: replace(new.header, write_floor=new.header.position + 1), RejectReason.ILL_FORMED),
    "the write floor sinks": (lambda it, new: replace(new.header, write_floor=0), RejectReason.POSITION_BEHIND),
    "another origin": (lambda it, new: replace(new.header, origin=NodeId(9)), RejectReason.NOT_AUTHORISED),
    "another maker": (lambda it, new: replace(new.header, writers=()), RejectReason.ILL_FORMED),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_an_owner_signs_is_not_the_next_position_for_that(what: str) -> None:
    council = Council()
    council.decide(SetMode(SceneMode.RENDER))
    bend, reason = REFUSED[what]
    offered = council.offer(grant(1))
    header = signed(council, bend(council, offered))
    assert judge_of(council).refuses(value_of(header, offered.private, council.header)) is reason


def test_what_is_proposed_is_signed_by_an_owner_and_not_decided() -> None:
    council = Council()
    offered, judge = council.offer(grant(1)), judge_of(council)
    stranger = signed(council, offered.header, SigningKey.from_seed(b"s" * 32))
    assert judge.refuses(value_of(stranger, offered.private, council.header)) is RejectReason.SIGNATURE_INVALID
    value = council.value(offered)
    shown = SceneBody(replace(offered.header, decision=council.header.decision), offered.private)
    assert judge.refuses(LogValue(value.data, shown.encode())) is RejectReason.ILL_FORMED
    other = Council(first=(7, 8, 9))
    assert judge.refuses(other.value(other.offer(grant(1)))) is RejectReason.ILL_FORMED


def test_the_data_names_what_the_body_brings() -> None:
    council = Council()
    offered, judge = council.offer(grant(1)), judge_of(council)
    value = council.value(offered)
    other = council.value(council.offer(grant(2)))
    assert judge.refuses(LogValue(value.data, other.body)) is RejectReason.ILL_FORMED
    assert judge.refuses(LogValue(value.data)) is RejectReason.ILL_FORMED
    assert judge.refuses(LogValue(value.data, b"what is that?")) is RejectReason.ILL_FORMED
    assert judge.found(LogValue(value.data)) is None
    for at in range(len(value.data)):
        bent = value.data[:at] + bytes((value.data[at] ^ 1,)) + value.data[at + 1 :]
        assert judge.refuses(LogValue(bent, value.body)) is RejectReason.ILL_FORMED
    lying = SceneBody(offered.header, offered.private + b"\0")
    assert judge.refuses(LogValue(value.data, lying.encode())) is RejectReason.ILL_FORMED
    # Who decides it stands in it, too: of other participants it is another value.
    assert value_of(offered.header, b"", replace(council.header, participants=council.header.participants[:2])) != value


def test_only_what_is_decided_may_lack_its_log() -> None:
    council = Council()
    value, judge = council.value(council.offer(grant(1))), judge_of(council)
    lean = without_log(value)
    assert lean == value and opened_value(lean).private == b""
    assert judge.refuses(lean) is RejectReason.ILL_FORMED
    assert judge.refuses(lean, is_decided=True) is None
    wrong = LogValue(value.data, SceneBody(opened_value(value).public, b"other").encode())
    assert judge.refuses(wrong, is_decided=True) is RejectReason.ILL_FORMED


def test_what_was_found_of_a_value_is_remembered_and_of_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    council = Council()
    value, judge, looked = council.value(council.offer(grant(1))), judge_of(council), list[int]()

    def counting(public: SceneLogPublic, known: KnownScene | None) -> KnownScene:
        looked.append(public.position)
        return checked_proposal(public, known)

    monkeypatch.setattr(scene_judge, "checked_proposal", counting)
    assert [judge.refuses(value) for _ in range(3)] == [None] * 3 and len(looked) == 1
    lean = without_log(value)
    assert judge.refuses(lean, is_decided=True) is None
    assert judge.refuses(lean) is RejectReason.ILL_FORMED, "that it is decided counts where it is shown"
    assert judge.refuses(LogValue(value.data, value.body + b"\0")) is RejectReason.ILL_FORMED
    behind = replace(judge, changes=CHANGES_MAX)
    joined = council.value(council.offer(added(4)))
    assert judge.refuses(joined) is None and behind.refuses(joined) is RejectReason.LIMIT_EXCEEDED, "another judge looks for itself"


def test_a_log_that_is_too_long_for_a_value_is_refused_in_words() -> None:
    council = Council()
    with pytest.raises(Refused, match="longer than what its participants decide at once") as caught:
        value_of(council.offer(grant(1)).header, bytes(LOG_BODY_BYTES_MAX), council.header)
    assert caught.value.reason is RejectReason.LIMIT_EXCEEDED


def test_participants_change_so_often_and_no_more() -> None:
    council = Council()
    judge = replace(judge_of(council), changes=CHANGES_MAX)
    assert judge.refuses(council.value(council.offer(grant(1)))) is None
    assert judge.refuses(council.value(council.offer(added(4)))) is RejectReason.LIMIT_EXCEEDED
    assert replace(judge, changes=CHANGES_MAX - 1).refuses(council.value(council.offer(added(4)))) is None


def test_of_many_requests_the_newest_are_remembered() -> None:
    """A scene's life has no end, and a node that runs for long must not keep all of them."""
    council = Council()
    first, met = council.value(council.offer(grant(1))), {number.to_bytes(16, "big"): 1 for number in range(REQUESTS_MAX - 1)}
    judge = replace(judge_of(council), requests=MappingProxyType({opened_value(first).public.request: 1, **met}))
    offered = council.offer(grant(2))
    value = council.value(offered)
    after = judge.after(value)
    council.settle(offered)
    assert (judge.found(first), judge.found(value), after.found(first), after.found(value)) == (1, None, None, council.header.position)
    assert len(after.requests) == REQUESTS_MAX


# ------------------------------------------------------------------------------------------- with the protocol itself


@dataclass
class Host:
    """A participant: the machine, and what it has kept."""

    setting: Setting
    state: State
    header: SceneLogPublic
    decided: list[tuple[int, Value, Certificate]] = field(default_factory=list)
    replies: list[Reply] = field(default_factory=list)


@dataclass
class Table:
    """Participants of one scene, and packets between them, as bytes."""

    council: Council
    away: set[int] = field(default_factory=set)
    posted: deque[tuple[int, int, bytes]] = field(default_factory=deque)

    def __post_init__(self) -> None:
        start = State(judge_of(self.council), self.council.header.position)
        self.hosts = {
            number: Host(Setting(self.council.header.genesis, node(number).member, key_of(number)), start, self.council.header)
            for number in self.council.first
        }

    def happen(self, number: int, event: Ask | Received) -> None:
        host = self.hosts[number]
        everyone = tuple(map(NodeId, self.hosts))
        here = frozenset(map(NodeId, self.hosts.keys() - self.away))
        step = take(host.setting, host.state, event, View(0.0, everyone, here, here))
        host.state = step.after
        for effect in step.effects:
            match effect:
                case Decide(position, value, certificate):
                    public = opened_value(value).public
                    host.header = decided_by_votes(public, host.header, certificate.ballot, certificate.votes)
                    host.decided.append((position, value, certificate))
                case Send(target, message):
                    self.posted.append((number, target, encode_packet(packet_of(message))))
                case Tell(target, have):
                    self.posted.append((number, target, encode_packet(RespondSceneLog(None, self.page(host, have)))))
                case Reply():
                    host.replies.append(effect)
                case _:
                    pass

    def page(self, host: Host, have: int):  # type: ignore[no-untyped-def]
        """What is above a position: the newest with its log, the others without."""
        newest = host.state.position
        found = [one for one in host.decided if one[0] > have]
        lean = [Learn(host.setting.genesis, at, value if at == newest else without_log(value), proof) for at, value, proof in found]
        return decided_page(host.setting.genesis, newest, map(decided_value, lean))

    def run(self) -> None:
        while self.posted:
            source, target, data = self.posted.popleft()
            if target not in self.away and source not in self.away:
                for message in messages_of(decode_packet(data)):
                    self.happen(target, Received(NodeId(source), message))

    def ask(self, number: int, value: Value) -> Outcome:
        self.happen(number, Ask(value, 30.0))
        self.run()
        return self.hosts[number].replies[-1].outcome


def test_participants_decide_what_an_owner_proposes_and_others_see_that_they_did() -> None:
    council = Council(first=(1, 2, 3, 4, 5))
    table = Table(council)
    values = []
    for entry in (grant(1, Role.WRITER), removed(1), SetMode(SceneMode.RENDER)):
        offered = council.offer(entry)
        values.append(council.value(offered))
        assert table.ask(3, values[-1]) is Outcome.COMMITTED
        for host in (table.hosts[entry.member.node] for entry in council.header.participants):
            assert host.header.signable() == offered.header.signable()
            check_decided(host.header)
            check_log(host.header, opened_value(host.decided[-1][1]).private)
        council.header, council.log, council.keys, council.known = (
            table.hosts[5].header,
            offered.log,
            offered.keys,
            KnownScene.of(table.hosts[5].header),
        )
    assert [table.ask(2, value) for value in values] == [Outcome.COMMITTED] * 3, "asked again, it is found"
    assert table.hosts[2].state.position == 4


def test_who_was_away_learns_what_was_decided_without_all_its_logs() -> None:
    council = Council(first=(1, 2, 3))
    table = Table(council, away={3})
    for number in (1, 2, 4):
        offered = council.offer(grant(number))
        value = council.value(offered)
        if number == 4:
            table.away.clear()
        assert table.ask(1, value) is Outcome.COMMITTED
        council.header, council.log, council.keys = table.hosts[1].header, offered.log, offered.keys
    late = table.hosts[3]
    assert late.state.position == 4
    assert late.header.signable() == table.hosts[1].header.signable()
    privates = [opened_value(value).private for _, value, _ in late.decided]
    assert privates[0] == b"" and privates[-1], "the newest holds what was before"


def test_a_body_that_was_changed_on_its_way_is_refused() -> None:
    council = Council(first=(1, 2, 3))
    table = Table(council)
    value = council.value(council.offer(grant(1)))
    bent = LogValue(value.data, SceneBody(opened_value(value).public, b"another log").encode())
    assert table.ask(1, bent) is Outcome.REJECTED
    assert table.ask(1, value) is Outcome.COMMITTED


def test_the_origin_is_no_participant_unless_it_is_named() -> None:
    council = Council()
    assert KEEPER_KEY.public.raw not in {entry.key for entry in council.header.participants}
    assert not judge_of(council).participants.nodes & {council.header.origin}
