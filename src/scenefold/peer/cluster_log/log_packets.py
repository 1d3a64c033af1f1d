"""Packets of the cluster's log, built (specs/15-cluster-log.md; specs/03-wire.md, Packets)."""

from __future__ import annotations

from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.crypto import LEASE_DOMAIN
from scenefold.peer.cluster_log.lives import Lives
from scenefold.peer.cluster_log.log_rules import lease_message
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.membership.status import OwnStatus
from scenefold.wire import (
    AcceptSceneProposal,
    LogRecord,
    ProposeSceneLog,
    RejectSceneProposal,
    RequestSceneLog,
    SceneLogAnswer,
    SceneLogPublic,
    Want,
)
from scenefold.world.facts import ClusterFacts

GRANT = 1
COMMIT = 2


def proposal_of(record: LogRecord, facts: ClusterFacts) -> ProposeSceneLog:
    """Packet 118: please have this record's entry committed."""
    return ProposeSceneLog(facts.genesis_header.genesis, facts.genesis_header, record.encode())


def lease_question(own: OwnStatus, facts: ClusterFacts, registry: Registry, nonce: int, lives: Lives) -> RequestSceneLog:
    """Packet 5 (LEASE) to the one voter, signed by the node that asks."""
    genesis, member, have = facts.genesis_header.genesis, own.member, registry.position
    proof = own.key.sign(LEASE_DOMAIN, lease_message(genesis, have, registry.head, nonce, member, lives))
    return RequestSceneLog(facts.genesis_header.scene, genesis, have, nonce, Want.LEASE, member, proof, lives, mini_status=own.mini())


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
