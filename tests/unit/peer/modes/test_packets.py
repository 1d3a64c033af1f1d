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
    members = MEMBER, Member(NodeId(2), bytes(16))
    releases = tuple(Release(position, member, bytes(64)) for position, member in zip((4, 5), members, strict=True))
    values = tuple(
        DecidedValue(position, VALUE, BALLOT, (vote(position),), (release,)) for position, release in zip((4, 5), releases, strict=True)
    )
    packet = RespondSceneLog(None, DecidedLog(bytes(32), 9, values))
    assert said_in(packet, 4) == (4, (vote(4),), releases)
    assert said_in(packet, 6) == (6, (), releases)


def test_a_packet_full_of_them_costs_few_checks() -> None:
    """All of its votes and releases would hold up a node for seconds: of each member one release, and of one value the votes."""
    other = Member(NodeId(2), bytes(16))
    releases = tuple(Release(position, member, bytes(64)) for position in (7, 9, 8) for member in (MEMBER, other))
    values = tuple(
        DecidedValue(
            5, VALUE, Ballot(count, NodeId(1)), tuple(Vote(5, Ballot(count, NodeId(1)), VALUE.digest, MEMBER) for _ in "12"), releases
        )
        for count in range(1, 257)
    )
    position, votes, found = said_in(RespondSceneLog(None, DecidedLog(bytes(32), 9, values)), 5)
    assert (position, votes) == (5, values[0].votes)
    assert sorted((release.member.node, release.position) for release in found) == [(1, 9), (2, 9)]


def test_a_proposal_shows_the_facts_of_its_position() -> None:
    proposal = ProposalId(7, BALLOT, Phase.ACCEPT)
    packet = ProposeValue(bytes(32), proposal, (NodeId(1),), (vote(7),), None, VALUE, False)
    assert said_in(packet, 4) == (7, (vote(7),), ())
    assert said_in(RequestTable(), 4) == (0, (), ())
