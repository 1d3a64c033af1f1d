"""If this fails, a vote or a release that a packet shows is not seen, or is taken for one of another position."""

from __future__ import annotations

from scenefold.base.ids import NodeId
from scenefold.peer.modes.packets import said_in
from scenefold.wire import (
    Ballot,
    DecidedLog,
    DecidedValue,
    LogValue,
    Member,
    Phase,
    ProposalId,
    ProposeValue,
    Release,
    RequestTable,
    RespondSceneLog,
    Vote,
)

MEMBER = Member(NodeId(1), bytes(16))
BALLOT = Ballot(1, NodeId(1))
VALUE = LogValue(b"value")


def vote(position: int) -> Vote:
    return Vote(position, BALLOT, VALUE.digest, MEMBER, bytes(64))


def test_votes_of_what_was_decided_are_those_of_one_position_and_releases_all() -> None:
    releases = tuple(Release(position, MEMBER, bytes(64)) for position in (4, 5))
    values = tuple(
        DecidedValue(position, VALUE, BALLOT, (vote(position),), (release,)) for position, release in zip((4, 5), releases, strict=True)
    )
    packet = RespondSceneLog(None, DecidedLog(bytes(32), 9, values))
    assert said_in(packet, 4) == (4, (vote(4),), releases)
    assert said_in(packet, 6) == (6, (), releases)


def test_a_proposal_shows_the_facts_of_its_position() -> None:
    proposal = ProposalId(7, BALLOT, Phase.ACCEPT)
    packet = ProposeValue(bytes(32), proposal, (NodeId(1),), (vote(7),), None, VALUE, False)
    assert said_in(packet, 4) == (7, (vote(7),), ())
    assert said_in(RequestTable(), 4) == (0, (), ())
