"""If this fails, one node that lies keeps a newcomer out, though others would take its token."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import trio
import trio.testing

from scenefold.base.errors import DamagedData, PeerFault, Refused, ScenefoldError, TurnedAway, Unreachable
from scenefold.base.ids import NodeId, node_id_of
from scenefold.base.reasons import RejectReason
from scenefold.client import enrolling
from scenefold.client.enrolling import AT_ONCE, LOOKS_MAX
from scenefold.crypto import InvitedKind, Token
from scenefold.wire.enrol_packets import Enrolled
from unit.peer.members_made import NOW

HERE = [node_id_of(f"127.0.0.{number}") for number in (2, 3, 4)]
GOOD, BAD = (Enrolled(certificate=what, authority=b"", charter=b"") for what in (b"good", b"bad"))


class Someone:
    """A newcomer that believes one answer only."""

    node = NodeId(0)
    asked_before = False
    token = Token(InvitedKind.USER, bytes(32), bytes(16), 0, 1, 2, ())

    def request(self) -> None:
        return None

    def check(self, answer: Enrolled, _now: datetime.datetime) -> None:
        if answer is not GOOD:
            raise DamagedData("the answer is of another cluster than the token")


async def asked(answers: Sequence[Enrolled | ScenefoldError], monkeypatch: pytest.MonkeyPatch) -> Enrolled:
    by_node = dict(zip(HERE, answers, strict=False))

    async def request_enrolment(_network: object, node: NodeId, *_: object) -> Enrolled:
        await trio.lowlevel.checkpoint()
        answer = by_node[node]
        if isinstance(answer, ScenefoldError):
            raise answer
        return answer

    monkeypatch.setattr("scenefold.client.enrolling.request_enrolment", request_enrolment)
    asking = enrolling._Asking(SimpleNamespace(network=None), Someone(), NOW)  # type: ignore[arg-type]
    answer = await asking.of(HERE[: len(answers)])
    if answer is None:
        raise asking.error()
    return answer.answer


LIES = [Refused(RejectReason.NOT_AUTHORISED, "the token was used already"), Refused(RejectReason.ILL_FORMED, "no"), BAD]
NEUTRAL = [Unreachable("nobody there"), PeerFault("gibberish"), TurnedAway("another cluster"), Refused(RejectReason.NOT_READY, "later")]


@pytest.mark.parametrize("other", [*LIES, *NEUTRAL])
async def test_one_node_does_not_keep_a_newcomer_out(other: Enrolled | ScenefoldError, monkeypatch: pytest.MonkeyPatch) -> None:
    assert await asked([other, GOOD], monkeypatch) is GOOD


@pytest.mark.parametrize("other", NEUTRAL)
async def test_the_first_refusal_is_told_if_nobody_takes_the_token(other: ScenefoldError, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(Refused, match="used already"):
        await asked([other, LIES[0], LIES[1]], monkeypatch)
    with pytest.raises(DamagedData, match="another cluster"):
        await asked([BAD, LIES[0], other], monkeypatch)


async def test_a_node_of_another_cluster_is_told_rather_than_a_closed_port(monkeypatch: pytest.MonkeyPatch) -> None:
    for answers in ([NEUTRAL[2], NEUTRAL[0]], [NEUTRAL[0], NEUTRAL[2]]):
        with pytest.raises(TurnedAway, match="another cluster"):
            await asked(answers, monkeypatch)


async def test_nobody_there_is_not_a_refusal(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(Unreachable, match="no node of the cluster takes the token: later"):
        await asked([NEUTRAL[0], NEUTRAL[3]], monkeypatch)


async def test_it_is_told_who_refused_with_which_words(monkeypatch: pytest.MonkeyPatch) -> None:
    used, no = (Refused(RejectReason.NOT_AUTHORISED, words) for words in ("the token was used already", "no"))
    with pytest.raises(Refused) as alone:
        await asked([used, NEUTRAL[0]], monkeypatch)
    assert str(alone.value) == "the token was used already (127.0.0.2)"
    with pytest.raises(Refused) as several:
        await asked([used, no, Refused(RejectReason.BUSY, "no")], monkeypatch)
    assert several.value.reason is RejectReason.NOT_AUTHORISED
    words = "127.0.0.2: the token was used already; 127.0.0.3, 127.0.0.4: no"
    assert str(several.value) == f"the nodes turned the token down: {words}"


class Town:
    """Nodes on the local network, found in looks around; all but GOOD_NODE turn every token down, or are silent for a minute."""

    GOOD_NODE = NodeId(500)
    CLOSED, BEHIND = NodeId(501), NodeId(502)
    """Of which one cannot be asked, and the other may have handed the request on."""
    SILENT = NodeId(1_000)
    """And all above."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *looks: list[NodeId]) -> None:
        self.looks, self.passed, self.asked = list(looks), list[list[NodeId]](), list[NodeId]()
        self.admitted: list[Token] = []
        self.forgotten = 0
        self.silent = self.silent_most = 0
        monkeypatch.setattr(enrolling, "look_around", self.look_around)
        monkeypatch.setattr(enrolling, "request_enrolment", self.request_enrolment)
        monkeypatch.setattr(enrolling, "Newcomer", SimpleNamespace(at=self.newcomer))

    def newcomer(self, _profile: Path, token: Token, node: NodeId, **_: object) -> Guest:
        return Guest(token=token, town=self, node=node)

    async def look_around(self, _network: object, _key: object, _entropy: object, *, passed: Sequence[NodeId]) -> list[NodeId]:
        await trio.lowlevel.checkpoint()
        self.passed.append(list(passed))
        return self.looks.pop(0) if self.looks else []

    async def request_enrolment(self, _network: object, node: NodeId, _mark: object, request: Any) -> Enrolled:
        await trio.lowlevel.checkpoint()
        self.asked.append(node)
        if node == self.CLOSED:
            raise Unreachable("no connection")
        await request()
        if node == self.GOOD_NODE:
            return GOOD
        if node == self.BEHIND:
            raise Refused(RejectReason.NOT_READY, "no trusted node answers")
        if node >= self.SILENT:
            self.silent += 1
            self.silent_most = max(self.silent, self.silent_most)
            try:
                await trio.sleep(60)
            finally:
                self.silent -= 1
            raise Unreachable("the node does not answer")
        raise Refused(RejectReason.NOT_AUTHORISED, f"lie {node}")

    async def run(self, _lane: str, function: Any, *args: object) -> Any:
        await trio.lowlevel.checkpoint()
        return function(*args)

    def world(self) -> Any:
        clock, entropy = SimpleNamespace(wall=NOW.timestamp), SimpleNamespace(token=bytes)
        return SimpleNamespace(network=None, workers=self, clock=clock, entropy=entropy)

    async def enrol(self, *named: NodeId) -> object:
        token = Token(InvitedKind.USER, bytes(32), bytes(16), 0, 1, 2, named)
        return await enrolling.enrol(Path("profile"), token, world=self.world())

    async def enrol_here(self) -> NodeId:
        token = Token(InvitedKind.NODE, bytes(32), bytes(16), 0, 1, 2, ())
        return (await enrolling.enrol_here(Path("profile"), token, world=self.world()))[1]


@dataclass(frozen=True, kw_only=True)
class Guest(Someone):
    token: Token
    town: Town
    node: NodeId

    def admitted(self, _answer: Enrolled, _now: datetime.datetime) -> None:
        self.town.admitted.append(self.token)

    def forget(self) -> None:
        self.town.forgotten += 1


def liars(*numbers: int) -> list[NodeId]:
    return [NodeId(number) for number in numbers]


async def test_liars_that_answer_first_do_not_keep_a_newcomer_out(monkeypatch: pytest.MonkeyPatch) -> None:
    town = Town(monkeypatch, liars(1, 2, 3), liars(4), [NodeId(5), Town.GOOD_NODE])
    await town.enrol()
    assert town.asked == [*liars(1, 2, 3, 4, 5), Town.GOOD_NODE]
    assert town.passed == [[], liars(1, 2, 3), liars(1, 2, 3, 4)], "who was asked takes no place in the next look"
    assert [token.addresses for token in town.admitted] == [(Town.GOOD_NODE,)], "and nobody looks for the cluster where liars are"


async def test_the_looks_are_bounded_and_end_when_nobody_new_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    always = Town(monkeypatch, *(liars(number) for number in range(1, 100)))
    with pytest.raises(Refused, match=r"0\.0\.0\.1: lie 1; 0\.0\.0\.2: lie 2"):
        await always.enrol()
    assert len(always.passed) == 1 + LOOKS_MAX
    once = Town(monkeypatch, liars(1))
    with pytest.raises(Refused, match="lie 1"):
        await once.enrol()
    assert len(once.passed) == 2


async def test_whom_the_token_names_speaks_for_the_cluster(monkeypatch: pytest.MonkeyPatch) -> None:
    town = Town(monkeypatch, [Town.GOOD_NODE])
    with pytest.raises(Refused, match="lie 7"):
        await town.enrol(NodeId(7))
    assert town.passed == []


async def test_who_says_nothing_holds_up_nobody_else(autojump_clock: trio.testing.MockClock, monkeypatch: pytest.MonkeyPatch) -> None:
    town = Town(monkeypatch, [*liars(1_000, 1_001), Town.GOOD_NODE, NodeId(1_002)])
    with trio.fail_after(30):
        await town.enrol()
    assert town.asked == [*liars(1_000, 1_001), Town.GOOD_NODE]
    assert town.silent == 0, "who is not needed any more is not talked to"
    assert [token.addresses for token in town.admitted] == [(Town.GOOD_NODE,)]


async def test_only_a_few_are_asked_at_once(autojump_clock: trio.testing.MockClock, monkeypatch: pytest.MonkeyPatch) -> None:
    town = Town(monkeypatch, liars(*range(1_000, 1_000 + 3 * AT_ONCE)))
    with trio.fail_after(4 * 60), pytest.raises(Unreachable, match="does not answer"):
        await town.enrol()
    assert town.silent_most == AT_ONCE and len(town.asked) == 3 * AT_ONCE


async def test_a_node_has_the_address_that_leads_to_who_takes_it_not_to_who_answers_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the way to a liar a newcomer would use up its token for an address at which nobody reaches it."""
    town, ways = Town(monkeypatch, [*liars(1, 2), Town.GOOD_NODE]), list[NodeId]()

    async def own_address(node: NodeId, _token: Token) -> NodeId:
        await trio.lowlevel.checkpoint()
        ways.append(node)
        return NodeId(node + 1)

    monkeypatch.setattr(enrolling, "own_address", own_address)
    assert await town.enrol_here() == Town.GOOD_NODE + 1
    assert ways == [*liars(1, 2), Town.GOOD_NODE], "each is asked under the address that leads to it"


async def test_a_node_does_not_ask_itself_for_its_own_address(monkeypatch: pytest.MonkeyPatch) -> None:
    async def own_address(node: NodeId, _token: Token) -> NodeId:
        await trio.lowlevel.checkpoint()
        return node

    town = Town(monkeypatch, [Town.GOOD_NODE])
    monkeypatch.setattr(enrolling, "own_address", own_address)
    with pytest.raises(Unreachable, match="runs on this computer"):
        await town.enrol_here()
    assert town.admitted == []


# ------------------------------------------------------------------------------------------------ keys that nobody certified


@pytest.mark.parametrize(
    ("named", "asked_before", "forgotten"),
    [
        (liars(1), False, True),
        (liars(1, 2), True, False),  # whoever certified them in that try was perhaps found, and these have not heard of it
        ([], True, False),
        ([*liars(1), Town.CLOSED], False, True),
        ([*liars(1), Town.CLOSED], True, False),
        ([*liars(1), Town.BEHIND], False, False),
        ([Town.BEHIND], False, False),
        ([Town.CLOSED], False, True),  # nobody was told of them
        ([Town.CLOSED], True, False),
        ([*liars(1), Town.SILENT], False, False),
    ],
)
async def test_keys_stay_as_long_as_they_may_be_certified_and_no_longer(
    named: list[NodeId],
    asked_before: bool,
    forgotten: bool,
    autojump_clock: trio.testing.MockClock,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    town = Town(monkeypatch, *([] if named else [liars(1)]))
    monkeypatch.setattr(Guest, "asked_before", asked_before)
    with pytest.raises((Refused, Unreachable)):
        await town.enrol(*named)
    assert bool(town.forgotten) is forgotten


async def test_keys_in_an_answer_that_is_not_to_be_believed_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    """The certificate in it may be theirs, and this computer's clock the one that is wrong."""
    town = Town(monkeypatch, [Town.GOOD_NODE])
    monkeypatch.setattr(Guest, "check", lambda *_: (_ for _ in ()).throw(DamagedData("the certificate counts from tomorrow")))
    with pytest.raises(DamagedData):
        await town.enrol(Town.GOOD_NODE)
    assert not town.forgotten
