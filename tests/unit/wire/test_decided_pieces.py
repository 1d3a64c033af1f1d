"""If this fails, what is kept or signed of decisions is read as something else than it was."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault
from scenefold.base.ids import NodeId
from scenefold.base.limits import DECIDERS_MAX
from scenefold.wire import (
    Ballot,
    LogValue,
    MalformedPacket,
    Member,
    NodeSignature,
    ParticipantEntry,
    SceneBody,
    SceneCertificate,
    digest_of_participants,
)
from scenefold.wire.facts import STRUCTS as FACTS
from scenefold.wire.log_values import LOG_VALUE
from scenefold.wire.scene_certificates import SCENE_BODY, SCENE_CERTIFICATE
from unit.wire.strategies import values

PIECES = {SceneCertificate: SCENE_CERTIFICATE, SceneBody: SCENE_BODY, LogValue: LOG_VALUE}


@pytest.mark.parametrize("piece", PIECES, ids=lambda piece: piece.__name__)
def test_round_trip(piece: Any) -> None:
    @settings(max_examples=40, deadline=None)
    @given(values(PIECES[piece]), st.data())
    def check(value: Any, data: st.DataObject) -> None:
        encoded = value.encode()
        assert piece.decode(encoded) == value
        assert piece.decode(encoded).encode() == encoded
        cut = data.draw(st.integers(0, len(encoded) - 1))
        for wrong in (encoded[:cut], encoded + b"\0"):
            with pytest.raises(MalformedPacket):
                piece.decode(wrong)

    check()


FACT = st.sampled_from(FACTS).flatmap(values)


@given(FACT, FACT)
def test_what_is_signed_is_of_one_fact_alone(one: Any, other: Any) -> None:
    genesis = bytes(range(32))
    signed = {(fact.DOMAIN, fact.signable(genesis)) for fact in (one, other)}
    says = {(type(fact), *(getattr(fact, name) for name in fact.__match_args__ if name != "signature")) for fact in (one, other)}
    assert len(signed) == len(says)
    assert one.signable(genesis) != one.signable(bytes(32))


def participant(node: int) -> ParticipantEntry:
    return ParticipantEntry(Member(NodeId(node), bytes(16)), bytes(32))


def test_bounds() -> None:
    everyone = tuple(map(participant, range(DECIDERS_MAX + 1)))
    assert len({digest_of_participants(everyone[:count]) for count in range(DECIDERS_MAX + 1)}) == DECIDERS_MAX + 1
    with pytest.raises(LocalFault):
        digest_of_participants(everyone)
    votes = tuple(NodeSignature(entry.member.node, bytes(64)) for entry in everyone)
    with pytest.raises(LocalFault):
        SceneCertificate(1, Ballot(1, NodeId(1)), bytes(32), (), votes).encode()
    with pytest.raises(LocalFault):
        SceneCertificate(1, Ballot(1, NodeId(1)), bytes(31), (), votes[1:]).encode()
