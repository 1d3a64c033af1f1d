"""If this fails, one node that lies keeps a newcomer out, though others would take its token."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from types import SimpleNamespace

import pytest
import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, ScenefoldError, TurnedAway, Unreachable
from scenefold.base.ids import NodeId, node_id_of
from scenefold.base.reasons import RejectReason
from scenefold.client import enrolling
from scenefold.crypto import InvitedKind, Token
from scenefold.wire.enrol_packets import Enrolled
from unit.peer.members_made import NOW

HERE = [node_id_of(f"127.0.0.{number}") for number in (2, 3, 4)]
GOOD, BAD = (Enrolled(certificate=what, authority=b"", charter=b"") for what in (b"good", b"bad"))


class Someone:
    """A newcomer that believes one answer only."""

    node = NodeId(0)
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
    return await enrolling._ask(SimpleNamespace(network=None), Someone(), HERE[: len(answers)], NOW)  # type: ignore[arg-type]


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
