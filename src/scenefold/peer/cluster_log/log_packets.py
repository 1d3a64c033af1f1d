"""Packets of the cluster's log, built (specs/15-cluster-log.md; specs/03-wire.md, Packets)."""

from __future__ import annotations

from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.wire import (
    AcceptSceneProposal,
    LogRecord,
    ProposeSceneLog,
    RejectSceneProposal,
    SceneLogAnswer,
    SceneLogPublic,
)
from scenefold.world.facts import ClusterFacts

GRANT = 1
COMMIT = 2


def proposal_of(record: LogRecord, facts: ClusterFacts) -> ProposeSceneLog:
    """Packet 118: please have this record's entry committed."""
    return ProposeSceneLog(facts.genesis_header.genesis, facts.genesis_header, record.encode())


def accepted(position: int, record_hash: bytes) -> AcceptSceneProposal:
    """Packet 119: it is committed, at this position."""
    return AcceptSceneProposal(position, record_hash)


def rejected(reason: RejectReason, node: NodeId) -> RejectSceneProposal:
    """Packet 120: it never will be."""
    return RejectSceneProposal(reason, node)


def answer_of(public: SceneLogPublic, nonce: int, part: bytes | None, *, is_granted: bool = False) -> SceneLogAnswer:
    """The body of packet 6: the header, a part of the log, and perhaps a lease."""
    flags = COMMIT | (GRANT if is_granted else 0)
    return SceneLogAnswer(nonce, flags, public.position, public, part)
