"""May this newcomer be enrolled, may this order be carried out (specs/15-cluster-log.md). Pure.

Newcomers and administrators sign what they want, so every node can judge it and none can alter it; what the log has decided comes
from the roll, what the cluster began with from the facts. `now` is seconds since 1970, by the judging node's clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from scenefold.base.errors import Refused
from scenefold.base.ids import address_of
from scenefold.base.reasons import RejectReason
from scenefold.crypto import ORDER_DOMAIN, Card, InvalidSignature, node_named
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.enrolment.card_rules import (
    card_of,
    check_not_expired,
    check_others_administer,
    check_others_issue,
    check_trust,
    credential_of,
    in_utc,
    is_original,
)
from scenefold.wire import AddParticipant, RemoveNode, RemoveParticipant, RevokeNode
from scenefold.wire.enrol_entries import Invite, RevokeUser, Trust, Withdraw
from scenefold.wire.orders import Order
from scenefold.world.enrol_forms import Wanted, check_signed, form_in, wanted
from scenefold.world.facts import ClusterFacts
from scenefold.world.roll import Invitation, InvitationState, Roll, check_invited

ORDER_S_MAX = 3600.0
"""An order counts so long, and clocks may differ by as much: what was refused once is not carried out a week later."""
INVITATION_S_MAX = 30 * 86400.0


@dataclass(frozen=True, slots=True)
class IssuedBefore:
    """The same newcomer has asked before, and has not heard the answer."""

    card: Card


Judged: TypeAlias = Wanted | IssuedBefore
"""A certificate to be made, or one that was."""


# ------------------------------------------------------------------------------------------------------------- newcomers


def judge_form(data: bytes, signature: bytes, registry: Registry, facts: ClusterFacts, now: float) -> Judged:
    """What a newcomer's request comes to; Refused, in words for the newcomer."""
    form = form_in(data)
    invitation = registry.roll.invitations.get(form.invitation)
    if invitation is None:
        raise _forbidden("no such token was given out in this cluster", "ask for another one: scenectl cluster invite")
    check_signed(data, signature, form.invitation)
    asked = wanted(form, invitation.entry)
    if invitation.state is not InvitationState.OPEN:
        return _again(invitation, asked, registry.roll)
    check_not_expired(invitation.entry, now)
    check_invited(registry.roll, invitation.entry, asked.name, asked.keys.signing.key_id)
    asked.check_possible()
    node = node_named(asked.name)
    if node is None:
        if card_of(asked.name, registry, facts) is not None:
            raise _forbidden(f"{asked.name} is a member already", "ask for a token under another name")
    elif is_original(node, registry, facts):
        raise _forbidden(f"{address_of(node)} has been one of this cluster's nodes from the start", "use another address")
    else:
        check_others_issue(node, registry)
    return asked


def _again(invitation: Invitation, asked: Wanted, roll: Roll) -> IssuedBefore:
    card = invitation.card
    if card is None:
        raise _forbidden("the token was withdrawn", "ask for another one")
    if not asked.is_in(card):
        raise _forbidden("the token was used already", "ask for another one; if nobody of yours used it, have that member revoked")
    if roll.is_revoked(card.name, card.signing_id):
        raise Refused(RejectReason.KEY_REVOKED, f"the key of {card.name} is revoked", remedy="ask an administrator for a new invitation")
    return IssuedBefore(card)


# ---------------------------------------------------------------------------------------------------------------- orders


def judge_order(data: bytes, signature: bytes, registry: Registry, facts: ClusterFacts, now: float) -> Order:
    """An administrator's order that may be carried out; Refused, or MalformedPacket."""
    order = Order.decode(data)
    if order.cluster != facts.cluster_id:
        raise _forbidden("the order is for another cluster", "")
    card = card_of(order.by, registry, facts)
    if card is None or not card.keys.is_administrator:
        raise _forbidden(f"{order.by} is no administrator of this cluster", "ask one who is")
    try:
        card.keys.signing.verify(signature, ORDER_DOMAIN, data)
    except InvalidSignature as problem:
        raise Refused(RejectReason.SIGNATURE_INVALID, str(problem)) from None
    if registry.committed_at(order.request, order.entry) is not None:
        return order
    if abs(now - order.issued) > ORDER_S_MAX:
        clocks = f"it was given at {in_utc(order.issued)}, and this node's clock says {in_utc(now)}"
        raise _forbidden(f"the order is out of date: {clocks}", "set the clocks right, then give it again")
    _check_ordered(order, registry, facts, now)
    return order


def _check_ordered(order: Order, registry: Registry, facts: ClusterFacts, now: float) -> None:
    """Whether an administrator may order this at all, and whether the cluster could live with it."""
    match order.entry:
        case Invite():
            _check_invite(order.entry, order.by, registry, facts, now)
        case Withdraw():
            return
        case RevokeUser() | RevokeNode():
            _check_revocation(order.entry, registry, facts)
        case RemoveNode(member, _):
            if not registry.is_barred(member.node):
                raise _forbidden(f"{address_of(member.node)} leaves by itself, or once it is silent", "use `scenectl node drain`")
        case AddParticipant() | RemoveParticipant():
            registry.voting.after(registry, order.entry, registry.position + 1)
        case Trust(node, trusted):
            check_trust(order.entry, registry, facts)
            if not trusted:
                check_others_issue(node, registry)
        case _:
            raise Refused(RejectReason.ILL_FORMED, f"nobody orders a {type(order.entry).__name__}")


def _check_invite(entry: Invite, by: str, registry: Registry, facts: ClusterFacts, now: float) -> None:
    node = node_named(entry.name)
    if entry.by != by:
        raise _forbidden("an invitation names who gave it")
    # Who gave the order may have another clock, as far as an order's may be off.
    if entry.expires > now + INVITATION_S_MAX + ORDER_S_MAX:
        raise _forbidden(f"an invitation is open for 30 days at most, and this one until {in_utc(entry.expires)}", "set the clocks right")
    if node is None and card_of(entry.name, registry, facts) is not None:
        raise _forbidden(f"{entry.name} is a member already", "choose another name")
    if node is not None and is_original(node, registry, facts):
        raise _forbidden(f"{address_of(node)} has been one of this cluster's nodes from the start", "use another address")
    if node is not None:  # Whoever uses this takes the trust in it: asked here too, so that nobody hands out a token that serves nobody.
        check_others_issue(node, registry)


def _check_revocation(entry: RevokeUser | RevokeNode, registry: Registry, facts: ClusterFacts) -> None:
    if isinstance(entry, RevokeUser):
        card = card_of(entry.name, registry, facts)
        if card is None or card.signing_id != entry.key:
            raise _forbidden(f"{entry.name} is no member with such a key", "see `scenectl cluster users`")
        check_others_administer(entry.name, registry, facts)
        return
    known = credential_of(entry.node, registry, facts)
    if known is None or known.public_key.key_id != entry.key:
        raise _forbidden(f"{address_of(entry.node)} is no node with such a key", "see `scenectl cluster nodes`")
    if entry.node in registry.voters:
        remedy = (
            f"take it from the voters first: scenectl cluster remove-voter {address_of(entry.node)}" if len(registry.voters) > 1 else ""
        )
        raise _forbidden(f"{address_of(entry.node)} decides the cluster's log, which cannot do without it", remedy)
    check_others_issue(entry.node, registry)


def _forbidden(what: str, remedy: str = "") -> Refused:
    return Refused(RejectReason.NOT_AUTHORISED, what, remedy=remedy)
