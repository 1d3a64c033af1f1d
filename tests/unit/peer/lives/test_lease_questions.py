"""If this fails, somebody asks for a lease in the name of a node, or an old question counts again."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import Refused
from scenefold.base.ids import SceneId
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.lease_grants import Question
from scenefold.peer.cluster_log.lease_questions import packet_of, question_in, signable
from scenefold.peer.cluster_log.numbered_lives import Life
from scenefold.wire import RequestSceneLog, decode_packet, encode_packet
from unit.peer.logs_made import key_of, member, node
from unit.peer.voters_made import GENESIS, Senate

NUMBERS = st.integers(0, 2**64 - 1)
SENATE = Senate()
REGISTRY, HAVE = SENATE.registry, SENATE.registry.position
ASKED = Question(member(3), HAVE, Life(5, 77), 9)


def packet(question: Question = ASKED, key: int = 3, **changes: Any) -> RequestSceneLog:
    return replace(packet_of(question, SceneId(7), GENESIS, key_of(key)), **changes)


def refusal(packet: RequestSceneLog, asker: int = 3) -> RejectReason:
    with pytest.raises(Refused) as caught:
        question_in(packet, node(asker), REGISTRY)
    return caught.value.reason


@given(st.builds(Question, st.just(member(3)), st.integers(HAVE, 2**64 - 1), st.builds(Life, NUMBERS, NUMBERS), NUMBERS))
def test_what_is_asked_comes_as_it_was(question: Question) -> None:
    sent = decode_packet(encode_packet(packet(question)))
    assert isinstance(sent, RequestSceneLog) and question_in(sent, node(3), REGISTRY) == question


@pytest.mark.parametrize(
    "changes",
    [{"have": HAVE + 1}, {"nonce": 10}, {"lives": (6, 77)}, {"lives": (5, 78)}, {"genesis": bytes(32)}, {"proof": bytes(64)}],
    ids=lambda changes: next(iter(changes)),
)
def test_whatever_is_changed_was_not_signed(changes: dict[str, Any]) -> None:
    assert refusal(packet(**changes)) is RejectReason.SIGNATURE_INVALID


def test_a_node_asks_for_itself_with_its_own_key() -> None:
    assert refusal(packet(key=4)) is RejectReason.SIGNATURE_INVALID
    assert refusal(packet(), asker=4) is refusal(packet(member=None)) is RejectReason.NOT_AUTHORISED
    assert refusal(packet(lives=())) is RejectReason.ILL_FORMED
    other = replace(ASKED, member=member(3, life=1))
    assert question_in(packet(other, proof=b""), node(3), REGISTRY) == other, "the voter's rules refuse it"


def test_who_does_not_know_of_voters_is_told_the_log() -> None:
    first = REGISTRY.voting.councils[0].position
    assert question_in(packet(replace(ASKED, have=first)), node(3), REGISTRY) is not None
    assert question_in(packet(replace(ASKED, have=first - 1)), node(3), REGISTRY) is None


def test_the_signed_bytes_are_golden() -> None:
    expected = GENESIS.hex() + f"{HAVE:016x}{9:016x}{node(3):08x}" + member(3).incarnation.hex() + f"{5:016x}{77:016x}"
    assert signable(ASKED, GENESIS).hex() == expected
