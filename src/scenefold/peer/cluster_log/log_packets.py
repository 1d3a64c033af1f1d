"""Packets of the cluster's log, built (design of the consensus §3; specs/03-wire.md, Packets).

Fields that only several voters need are empty: ballots, routes, Highest and MACs. The bytes are final all the same.
"""

from __future__ import annotations

from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.wire import (
    AcceptSceneProposal,
    Ballot,
    LogRecord,
    Member,
    Phase,
    ProposalId,
    ProposeSceneLog,
    RejectSceneProposal,
    SceneLogAnswer,
    SceneLogPublic,
)
from scenefold.world.facts import ClusterFacts

GRANT = 1
COMMIT = 2
NO_BALLOT = Ballot(0, NodeId(0))


def proposal_of(record: LogRecord, facts: ClusterFacts) -> ProposeSceneLog:
    """Packet 118: please have this record's entry committed."""
    return ProposeSceneLog(
        genesis=facts.genesis_header.genesis,
        proposal=ProposalId(record.position, Ballot(1, record.origin), Phase.ACCEPT),
        route=(facts.voter,),
        nodes=(),
        highest=None,
        takeover=False,
        public=facts.genesis_header,
        private=record.encode(),
        mac_epoch=0,
        mac=b"",
    )


def accepted(packet: ProposeSceneLog, position: int, record_hash: bytes, voter: Member) -> AcceptSceneProposal:
    """Packet 119: it is committed, at this position."""
    proposal = ProposalId(position, packet.proposal.ballot, packet.proposal.phase)
    return AcceptSceneProposal(packet.genesis, proposal, record_hash, (voter,), None, 0, b"")


def rejected(packet: ProposeSceneLog, reason: RejectReason, node: NodeId) -> RejectSceneProposal:
    """Packet 120: it never will be."""
    return RejectSceneProposal(packet.genesis, packet.proposal, reason, (), NO_BALLOT, node, 0, b"")


def answer_of(public: SceneLogPublic, nonce: int, part: bytes | None, *, is_granted: bool = False) -> SceneLogAnswer:
    """The body of packet 6: the header, a part of the log, and perhaps a lease."""
    flags = COMMIT | (GRANT if is_granted else 0)
    return SceneLogAnswer(nonce, flags, public.position, NO_BALLOT, (), public, part, 0, b"")
