"""May this newcomer be enrolled, may this order be carried out, was this card issued by our authority (specs/15-cluster-log.md). Pure.

Newcomers and administrators sign what they want, so every node can judge it and none can alter it; what the log has decided comes
from the roll, what the cluster began with from the facts. `now` is seconds since 1970, by the judging node's clock.
"""

from __future__ import annotations

import datetime
from dataclasses import dataclass, replace
from typing import TypeAlias

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import KeyId, NodeId, address_of, checked_node_id
from scenefold.base.reasons import RejectReason
from scenefold.crypto import ENROL_DOMAIN, ORDER_DOMAIN, Card, InvalidSignature, MemberKeys, PublicKey, node_named
from scenefold.peer.registry import Registry
from scenefold.peer.roll import Invitation, check_invited
from scenefold.wire import RemoveNode, RevokeNode
from scenefold.wire.enrol_entries import Enrol, Invite, RenewCard, RevokeUser, Trust, Withdraw
from scenefold.wire.enrol_packets import InvitationState
from scenefold.wire.orders import EnrolForm, Order
from scenefold.world.facts import ClusterFacts, Credential

ORDER_S_MAX = 3600.0
"""An order counts so long, and clocks may differ by as much: what was refused once is not carried out a week later."""
_SUITE_OF_NODES = 1


@dataclass(frozen=True, slots=True)
class ToIssue:
    """A certificate to be made."""

    name: str
    addresses: tuple[str, ...]
    tls_key: bytes
    keys: MemberKeys
    invitation: bytes


@dataclass(frozen=True, slots=True)
class IssuedBefore:
    """The same newcomer has asked before, and has not heard the answer."""

    card: Card


Judged: TypeAlias = ToIssue | IssuedBefore


# ------------------------------------------------------------------------------------------------------------ who is who


def card_of(name: str, registry: Registry, facts: ClusterFacts) -> Card | None:
    """The card of a member, newest; None if it has none here, or its key was revoked."""
    known = registry.roll.cards.get(name) or _owner(name, facts)
    if known is None or registry.roll.is_revoked(name, known.signing_id):
        return None
    return known


def credential_of(node: NodeId, registry: Registry, facts: ClusterFacts) -> Credential | None:
    """The keys that a node was certified with, member or not; None if it has none that count."""
    card = registry.roll.cards.get(f"node:{node}")
    known = facts.credential(node) if card is None else Credential(node, address_of(node), card.keys.signing, card.keys.sealing)
    return None if known is None or registry.is_revoked(node, known.public_key.key_id) else known


def administrators(registry: Registry, facts: ClusterFacts) -> list[str]:
    """Names of the users that may give orders."""
    names = sorted({*registry.roll.cards, *(Card.read(owner).name for owner in facts.owners)})
    cards = [card_of(name, registry, facts) for name in names]
    return [card.name for card in cards if card is not None and card.keys.is_administrator]


def refusal_of(name: str, key: KeyId | None, registry: Registry) -> str:
    """Why a peer that shows a certificate with this signing key is not talked to; empty if it is. None: a peer without a known key."""
    node = node_named(name)
    if key is not None and registry.roll.is_revoked(name, key):
        return f"the key of {name} is revoked"
    if node is not None and key is None and registry.is_barred(node):
        return f"the key of {name} is revoked"
    return ""


# ------------------------------------------------------------------------------------------------------------- newcomers


def judge_form(data: bytes, signature: bytes, registry: Registry, facts: ClusterFacts, now: float) -> Judged:
    """What a newcomer's request comes to; Refused, in words for the newcomer, or MalformedPacket."""
    form = EnrolForm.decode(data)
    invitation = registry.roll.invitations.get(form.invitation)
    if invitation is None:
        raise _forbidden("no such token was given out in this cluster", "ask for another one: scenectl cluster invite")
    try:
        PublicKey(form.invitation).verify(signature, ENROL_DOMAIN, data)
        keys = replace(MemberKeys.decode(form.keys), is_administrator=invitation.entry.is_administrator)
    except InvalidSignature:
        raise Refused(RejectReason.SIGNATURE_INVALID, "the request was not signed with the token's key") from None
    except DamagedData as problem:
        raise Refused(RejectReason.ILL_FORMED, str(problem)) from problem
    # A user is told its name by the cluster; a node's is its address.
    form = replace(form, name=form.name or invitation.entry.name)
    if invitation.state is not InvitationState.OPEN:
        return _again(invitation, form, keys)
    if now > invitation.entry.expires:
        until, clock = _date(invitation.entry.expires), _date(now)
        raise _forbidden(f"the token was valid until {until}, and this node's clock says {clock}", "ask for another one")
    check_invited(registry.roll, invitation.entry, form.name, keys.signing.key_id)
    node = node_named(form.name)
    if node is None:
        if form.address or card_of(form.name, registry, facts) is not None:
            raise _forbidden(f"{form.name} is a member already", "ask for a token under another name")
        return ToIssue(form.name, (), form.tls_key, keys, form.invitation)
    _check_place(node, (address_of(form.address),))
    if _is_original(node, registry, facts):
        raise _forbidden(f"{address_of(node)} has been one of this cluster's nodes from the start", "use another address")
    if (keys.signing.suite, keys.sealing.suite) != (_SUITE_OF_NODES, _SUITE_OF_NODES):
        raise Refused(RejectReason.ILL_FORMED, "a node's keys are of suite 1")
    return ToIssue(form.name, (address_of(node),), form.tls_key, keys, form.invitation)


def _again(invitation: Invitation, form: EnrolForm, keys: MemberKeys) -> IssuedBefore:
    card = invitation.card
    if card is None:
        raise _forbidden("the token was withdrawn", "ask for another one")
    if (card.name, card.keys, card.tls_key) != (form.name, keys, form.tls_key):
        raise _forbidden("the token was used already", "ask for another one; if nobody of yours used it, have that member revoked")
    return IssuedBefore(card)


def check_issued(entry: Enrol | RenewCard, registry: Registry, facts: ClusterFacts) -> None:
    """Refused unless our authority issued the card, for somebody that it may name. That it fits the log says the roll."""
    try:
        card = Card.verified(entry.card, facts.authority)
    except (DamagedData, ValueError) as problem:
        raise Refused(RejectReason.SIGNATURE_INVALID, str(problem)) from problem
    node = node_named(card.name)
    if node is not None:
        _check_place(node, card.addresses)
    if isinstance(entry, Enrol):
        if _owner(card.name, facts) is not None or (node is not None and _is_original(node, registry, facts)):
            raise _forbidden(f"{card.name} was not enrolled, it was there from the start")
        return
    if _keys_of(card.name, registry, facts) != (card.keys.signing, card.keys.sealing):
        raise _forbidden(f"{card.name} is known by other keys")


def check_renewable(certificate: bytes, peer: str, registry: Registry, facts: ClusterFacts) -> Card:
    """The card of a member that asks for a newer certificate; Refused unless it is its own, and counts."""
    try:
        card = Card.verified(certificate, facts.authority)
    except (DamagedData, ValueError) as problem:
        raise Refused(RejectReason.SIGNATURE_INVALID, str(problem)) from problem
    if card.name != peer:
        raise _forbidden(f"{peer} asks for a certificate of {card.name}", "")
    if _keys_of(card.name, registry, facts) != (card.keys.signing, card.keys.sealing):
        raise Refused(RejectReason.KEY_REVOKED, f"the keys of {card.name} count no longer")
    return card


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
    if registry.position_of(order.request) is not None:
        return order
    if abs(now - order.issued) > ORDER_S_MAX:
        clocks = f"it was given at {_date(order.issued)}, and this node's clock says {_date(now)}"
        raise _forbidden(f"the order is out of date: {clocks}", "set the clocks right, then give it again")
    _check_ordered(order, registry, facts)
    return order


def _check_ordered(order: Order, registry: Registry, facts: ClusterFacts) -> None:
    """Whether an administrator may order this at all, and whether the cluster could live with it."""
    match order.entry:
        case Invite():
            _check_invite(order.entry, order.by, registry, facts)
        case Withdraw():
            return
        case RevokeUser() | RevokeNode():
            _check_revocation(order.entry, registry, facts)
        case RemoveNode(member, _):
            if not registry.is_barred(member.node):
                raise _forbidden(f"{address_of(member.node)} leaves by itself, or once it is silent", "use `scenectl node drain`")
        case Trust(node, trusted):
            if credential_of(node, registry, facts) is None:
                raise _forbidden(f"{address_of(node)} is no node of this cluster", "see `scenectl cluster nodes`")
            if not trusted and registry.roll.trusted <= {node}:
                raise _forbidden(
                    f"{address_of(node)} is the only trusted node: nobody could be enrolled any more", "trust another one first"
                )
        case _:
            raise Refused(RejectReason.ILL_FORMED, f"nobody orders a {type(order.entry).__name__}")


def _check_invite(entry: Invite, by: str, registry: Registry, facts: ClusterFacts) -> None:
    node = node_named(entry.name)
    if entry.by != by:
        raise _forbidden("an invitation names who gave it")
    if node is None and card_of(entry.name, registry, facts) is not None:
        raise _forbidden(f"{entry.name} is a member already", "choose another name")
    if node is not None and _is_original(node, registry, facts):
        raise _forbidden(f"{address_of(node)} has been one of this cluster's nodes from the start", "use another address")


def _check_revocation(entry: RevokeUser | RevokeNode, registry: Registry, facts: ClusterFacts) -> None:
    if isinstance(entry, RevokeUser):
        card = card_of(entry.name, registry, facts)
        if card is None or card.signing_id != entry.key:
            raise _forbidden(f"{entry.name} is no member with such a key", "see `scenectl cluster users`")
        if administrators(registry, facts) == [entry.name]:
            raise _forbidden(f"{entry.name} is the only administrator", "invite another one first, with --admin")
        return
    known = credential_of(entry.node, registry, facts)
    if known is None or known.public_key.key_id != entry.key:
        raise _forbidden(f"{address_of(entry.node)} is no node with such a key", "see `scenectl cluster nodes`")
    if entry.node in registry.voters:
        raise _forbidden(f"{address_of(entry.node)} decides the cluster's log, which cannot do without it")


def _keys_of(name: str, registry: Registry, facts: ClusterFacts) -> tuple[object, object] | None:
    node = node_named(name)
    if node is not None:
        known = credential_of(node, registry, facts)
        return None if known is None else (known.public_key, known.sealing_key)
    card = card_of(name, registry, facts)
    return None if card is None else (card.keys.signing, card.keys.sealing)


def _check_place(node: NodeId, addresses: tuple[str, ...]) -> None:
    """Refused unless a node is at its own address and nowhere else, and that is one that a machine can have."""
    if addresses != (address_of(node),):
        raise Refused(RejectReason.ILL_FORMED, f"node:{node} cannot be at {', '.join(addresses) or 'no address'}")
    try:
        checked_node_id(address_of(node))
    except ValueError as problem:
        raise Refused(RejectReason.ILL_FORMED, str(problem)) from problem


def _is_original(node: NodeId, registry: Registry, facts: ClusterFacts) -> bool:
    """Whether a node has keys that count since the cluster was made: those are given no others."""
    known = facts.credential(node)
    return known is not None and not registry.is_revoked(node, known.public_key.key_id)


def _owner(name: str, facts: ClusterFacts) -> Card | None:
    return next((card for card in map(Card.read, facts.owners) if card.name == name), None)


def _date(moment: float) -> str:
    return f"{datetime.datetime.fromtimestamp(moment, datetime.UTC):%Y-%m-%d %H:%M} UTC"


def _forbidden(what: str, remedy: str = "") -> Refused:
    return Refused(RejectReason.NOT_AUTHORISED, what, remedy=remedy)
