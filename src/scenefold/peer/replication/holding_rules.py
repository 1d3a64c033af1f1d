"""Who may ask a holder for what (specs/20-copies.md, Custody, Recovery)."""

from __future__ import annotations

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId, address_of
from scenefold.base.location import Arc
from scenefold.base.reasons import RejectReason
from scenefold.peer.handlers import node_of
from scenefold.peer.line.parts import Parts
from scenefold.peer.membership.roster import Roster
from scenefold.wire import Member


def require_sender(peer: str, member: Member) -> None:
    """Refused (12) if it speaks in the name of another."""
    if node_of(peer) != member.node:
        raise Refused(RejectReason.NOT_AUTHORISED, f"{peer} speaks in the name of {address_of(member.node)}")


def require_member(parts: Parts, peer: str) -> None:
    """Refused (12) for nodes that are none of the cluster's."""
    node = node_of(peer)
    if node is None or parts.cluster_log.registry.current(node) is None:
        raise Refused(RejectReason.NOT_AUTHORISED, f"{peer} is no member of this cluster, as far as is known here")


def require_meant(parts: Parts, holder: Member) -> None:
    """Refused (18) if another incarnation is meant: what was said to the one before must not reach this one."""
    if holder != parts.own.member:
        raise Refused(RejectReason.WRONG_INCARNATION, "another incarnation of this node is meant")


async def require_owner(parts: Parts, roster: Roster, owner: Member, scope: Arc) -> None:
    """Refused (16) unless it is registered, and owns the scope by its own newest word."""
    if not parts.cluster_log.registry.is_current(owner):
        await parts.cluster_log.pull_from(owner.node)
    if not parts.cluster_log.registry.is_current(owner):
        raise _not_ready(f"{address_of(owner.node)} is not registered so, as far as is known here")
    arc = roster.arcs().get(owner.node)
    if arc is None or not (arc.first <= scope.first and scope.last <= arc.last):
        raise _not_ready(f"{address_of(owner.node)} has not said yet that it owns the place")


async def require_let_go(parts: Parts, roster: Roster, owner: Member, scope: Arc) -> None:
    """Refused (16) as long as another one, for whom a part of the scope is held here, says of itself that it owns that.

    Who claims what is not its own would else have this node hold it for nobody, and the owner would count on copies that are none.
    """
    for former in _still_claiming(parts, roster, owner, scope):
        # Its word may be old: who gives a piece away says so at once.
        await parts.claims.ask(former)
    claiming = _still_claiming(parts, roster, owner, scope)
    if claiming:
        raise _not_ready(f"{address_of(claiming[0])} says that a part of the place is its own, and it is held for that node")


def _still_claiming(parts: Parts, roster: Roster, owner: Member, scope: Arc) -> list[NodeId]:
    registry, arcs = parts.cluster_log.registry, roster.arcs()
    found = set()
    for entry in parts.keeper.copies.custody.within(scope):
        claim = arcs.get(entry.owner.node)
        if (
            entry.owner.node != owner.node
            and registry.is_current(entry.owner)
            and claim is not None
            and claim.intersection(entry.arc) is not None
        ):
            found.add(entry.owner.node)
    return sorted(found)


def require_none_own(own: Arc | None, scope: Arc) -> None:
    """Refused (16) if some of it is this node's own: then one of the two is behind."""
    if own is not None and own.intersection(scope) is not None:
        raise _not_ready("a part of the place is this node's own")


def _not_ready(what: str) -> Refused:
    return Refused(RejectReason.NOT_READY, what)
