"""Who may propose what to the cluster's log, and what a lease request signs (specs/15-cluster-log.md). Pure.

That an entry fits behind the log says the registry; here it is judged whether this asker may propose it at all. A
node registers itself and nobody else, with the keys that it was certified with; a removal may be proposed by every member; what an
administrator orders comes through the voter, which has judged the order (enrol_rules.py).
"""

from __future__ import annotations

import struct

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Card
from scenefold.peer.cluster_log.lives import Lives
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.enrolment.card_rules import check_issued, check_others_administer, check_others_issue, check_trust, credential_of
from scenefold.wire import AddNode, AddParticipant, Found, LogEntry, Member, RemoveNode, RemoveParticipant, RevokeNode
from scenefold.wire.enrol_entries import ANY_NODE, Enrol, Invite, RenewCard, RevokeUser, Trust, Withdraw
from scenefold.world.facts import ClusterFacts

BEGAN_ANEW = "it began anew, with an empty or an older data folder"
"""Why the incarnation before is removed where a node registers under another one."""


def check_proposer(entry: LogEntry, proposer: NodeId, registry: Registry, facts: ClusterFacts, now: float) -> None:
    """Refused (12) if this node may not propose this entry. `now`: seconds since 1970, by the voter's clock.

    What follows was judged when it was ordered, too; but another order may have come in between.
    """
    check_by_log(entry, proposer, registry)
    match entry:
        case AddNode():
            _check_credential(entry, registry, facts)
        case Enrol() | RenewCard():
            check_issued(entry, registry, facts, now)
        case Trust():
            check_trust(entry, registry, facts)
        case RevokeUser(name):
            check_others_administer(name, registry, facts)
        case _:
            pass


def check_by_log(entry: LogEntry, proposer: NodeId, registry: Registry) -> None:
    """As far as the log alone can tell, so that all who know it say the same."""
    match entry:
        case AddNode(member):
            if member.node != proposer:
                raise _not_authorised(f"{address_of(proposer)} registers another node than itself")
        case RemoveNode():
            if registry.current(proposer) is None:
                raise _not_authorised(f"{address_of(proposer)} is no member, and removes nobody")
        case Enrol() | RenewCard():
            pass
        case Trust(node, True, _, sealed) if sealed and registry.is_trusted(node):
            if not registry.is_trusted(proposer):
                raise _not_authorised("only a trusted node seals the authority's key to another one")
        case Trust() | RevokeNode() | Invite() | Withdraw() | RevokeUser() | AddParticipant() | RemoveParticipant():
            if proposer not in registry.voters:
                raise _not_authorised("only a voter takes an administrator's orders into the log, or says who votes")
        case _:
            raise Refused(RejectReason.ILL_FORMED, f"nobody proposes a {type(entry).__name__} to the cluster's log")
    if isinstance(entry, RevokeNode) or (isinstance(entry, Trust) and not entry.trusted):
        check_others_issue(entry.node, registry)


def committed_at(entry: LogEntry, request_id: bytes, registry: Registry) -> int | None:
    """Where this was committed already; a member that registers again, not knowing that it has, is welcome, wherever it would stand.

    Refused (5) if the request's id stands in the log with another entry.
    """
    known = registry.current(entry.member.node) if isinstance(entry, AddNode) else None
    if known is not None and isinstance(entry, AddNode) and known.member == entry.member:
        return known.position
    return registry.committed_at(request_id, entry)


def _check_credential(entry: AddNode, registry: Registry, facts: ClusterFacts) -> None:
    node = entry.member.node
    credential = credential_of(node, registry, facts)
    if credential is not None and (credential.public_key.raw, credential.sealing_key.raw) != (entry.key, entry.sealing_key):
        raise _not_authorised(f"{address_of(node)} was certified with other keys")
    if credential is None and facts.authority:
        raise _not_authorised(f"{address_of(node)} was never enrolled, or its key was revoked")


def predecessor(entry: LogEntry, registry: Registry) -> Member | None:
    """The incarnation that must go before this AddNode can be: that of a node whose disk was made anew."""
    if not isinstance(entry, AddNode):
        return None
    known = registry.current(entry.member.node)
    return None if known is None or known.incarnation == entry.member.incarnation else known.member


def lease_message(genesis: bytes, have: int, head: bytes, nonce: int, member: Member, lives: Lives) -> bytes:
    """What the asker of an owner lease signs: who it is, how far it knows which log, that it asks just now, under which lives."""
    return b"".join((genesis, struct.pack(">Q", have), head, struct.pack(">QI", nonce, member.node), member.incarnation, lives.pack()))


def in_words(entry: LogEntry) -> str:
    """An entry for people: who, what, why."""
    match entry:
        case Found(founders):
            return f"founded with {len(founders)} node{'' if len(founders) == 1 else 's'}"
        case AddNode(member):
            return f"{address_of(member.node)} is a member ({member.incarnation.hex()[:8]})"
        case RemoveNode(member, reason):
            return f"{address_of(member.node)} is removed: {reason}"
        case Trust(node, trusted, _, sealed):
            key = ", and has the key of the authority" if sealed else ""
            return f"{address_of(node)} is {'trusted' if trusted else 'no longer trusted'}{key}"
        case Invite(_, name, _, _, by):
            return f"{by} invites {'any node' if name == ANY_NODE else name}"
        case Withdraw():
            return "an invitation is withdrawn"
        case Enrol(_, _, card):
            return f"{Card.read(card).name} is enrolled"
        case RenewCard(card):
            return f"{Card.read(card).name} has a newer certificate"
        case RevokeUser(name, key):
            return f"the key {key:08x} of {name} is revoked"
        case RevokeNode(node, key):
            return f"the key {key:08x} of {address_of(node)} is revoked"
        case AddParticipant(member) | RemoveParticipant(member):
            return f"{address_of(member.node)} is {'a voter' if isinstance(entry, AddParticipant) else 'no voter any more'}"
        case _:
            return type(entry).__name__


def _not_authorised(what: str) -> Refused:
    return Refused(RejectReason.NOT_AUTHORISED, what)
