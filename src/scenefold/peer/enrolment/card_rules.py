"""Whose card and keys count, and what cards get into the log (specs/15-cluster-log.md). Pure.

What the log has decided comes from the roll, what the cluster began with from the facts.
"""

from __future__ import annotations

import datetime

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import KeyId, NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Card, OutOfDate, PublicKey, node_named
from scenefold.peer.cluster_log.registry import Registry
from scenefold.wire import SceneLogPublic
from scenefold.wire.enrol_entries import Enrol, Invite, RenewCard, Trust
from scenefold.world.enrol_forms import check_place, form_in
from scenefold.world.facts import ClusterFacts, Credential

CARD_LIFE_MAX = datetime.timedelta(days=366)
"""From the moment when it comes into the log."""


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


def is_administrator(user: str, registry: Registry, facts: ClusterFacts) -> bool:
    """Whether a user may give orders. In a cluster in memory, which has no authority, anybody may."""
    card = card_of(user, registry, facts) if facts.authority else None
    return not facts.authority or (card is not None and card.keys.is_administrator)


def is_user_key(key: PublicKey, registry: Registry, facts: ClusterFacts) -> bool:
    """Whether some user signs with this key. In a cluster in memory, which has no authority, nobody can tell, and any may be."""
    if not facts.authority:
        return True
    names = (*registry.roll.cards, *(Card.read(owner).name for owner in facts.owners))
    cards = (card_of(name, registry, facts) for name in names if node_named(name) is None)
    return any(card is not None and card.keys.signing == key for card in cards)


def is_scene_member(user: str, header: SceneLogPublic, registry: Registry, facts: ClusterFacts) -> bool:
    """Whether a scene's keys are sealed to a user. In a cluster in memory, which has no authority, nobody can tell, and anybody may be."""
    if not facts.authority:
        return True
    card = card_of(user, registry, facts)
    return card is not None and any(lockbox.recipient == card.keys.sealing.key_id for lockbox in header.lockboxes)


def refusal_of(name: str, key: KeyId | None, registry: Registry, facts: ClusterFacts) -> Refused | None:
    """Why a peer whose certificate has this signing key (None: none) is not talked to; None if it is, or is a node that nobody knows.

    17: the key counts no longer. 16: it is not the member's key as far as this log goes, and a newer one may say otherwise.
    """
    node = node_named(name)
    if (key is not None and registry.roll.is_revoked(name, key)) or (node is not None and key is None and registry.is_barred(node)):
        return Refused(RejectReason.KEY_REVOKED, f"the key of {name} is revoked", remedy="ask an administrator for a new invitation")
    if not facts.authority or is_unknown(name, registry, facts):
        return None
    if node is None:
        card = card_of(name, registry, facts)
        known = None if card is None else card.signing_id
    else:
        known = _node_key(node, registry, facts)
    if known is not None and known == key:
        return None
    remedy = "if it has just become one, try again in a moment"
    return Refused(RejectReason.NOT_READY, f"{name} is no member by this key, as far as this node knows the cluster's log", remedy=remedy)


def is_unknown(name: str, registry: Registry, facts: ClusterFacts) -> bool:
    """Whether neither log nor facts know any key of a node. It may be a newcomer of which the log tells more elsewhere, or one that
    somebody certified who should not have: it is told the log, and may register itself, which the voter judges (log_rules.py).
    """
    node = node_named(name)
    return bool(facts.authority) and node is not None and _node_key(node, registry, facts) is None


def _node_key(node: NodeId, registry: Registry, facts: ClusterFacts) -> KeyId | None:
    """What a node signs with: by its card, else as it was certified when the cluster was made, else as it has registered."""
    certified, registered = credential_of(node, registry, facts), registry.key_of(node)
    if certified is not None:
        return certified.public_key.key_id
    return None if registered is None or registry.is_revoked(node, registered.key_id) else registered.key_id


def is_original(node: NodeId, registry: Registry, facts: ClusterFacts) -> bool:
    """Whether a node has keys that count since the cluster was made: those are given no others."""
    known = facts.credential(node)
    return known is not None and not registry.is_revoked(node, known.public_key.key_id)


def check_issued(entry: Enrol | RenewCard, registry: Registry, facts: ClusterFacts, now: float) -> None:
    """Refused unless our authority issued the card, for somebody that it may name, and it counts today, as the invitation does. That it fits
    the log, and that the holder of the invitation asked for it, says the roll.

    `now`: seconds since 1970, by the voter's clock. So a trusted node whose clock is wrong makes no card that others cannot use, and
    what a wrong clock of the voter let in is replaced once that clock is right.
    """
    today = datetime.datetime.fromtimestamp(now, datetime.UTC)
    try:
        card = Card.verified(entry.card, facts.authority, today)
    except OutOfDate as problem:
        raise _forbidden(problem.what, problem.remedy) from problem
    except (DamagedData, ValueError) as problem:
        raise Refused(RejectReason.SIGNATURE_INVALID, str(problem)) from problem
    if card.not_after > today + CARD_LIFE_MAX:
        raise _forbidden(f"the certificate of {card.name} counts for more than a year", "set the clocks right")
    node = node_named(card.name)
    if node is not None:
        check_place(node, card.addresses)
    if isinstance(entry, Enrol):
        if _owner(card.name, facts) is not None or (node is not None and is_original(node, registry, facts)):
            raise _forbidden(f"{card.name} was not enrolled, it was there from the start")
        invitation = registry.roll.invitations.get(form_in(entry.form).invitation)
        if invitation is not None:
            check_not_expired(invitation.entry, now)
        if node is not None:
            # It takes the trust in the node, which may be the last one since it was invited.
            check_others_issue(node, registry)
        return
    if _keys_of(card.name, registry, facts) != (card.keys.signing, card.keys.sealing):
        raise _forbidden(f"{card.name} is known by other keys")
    known = card_of(card.name, registry, facts)
    if known is not None and known.counts(today) and known.not_after >= card.not_after:
        raise Refused(RejectReason.ILL_FORMED, f"the card of {card.name} is no newer one")


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


def not_due(card: Card, registry: Registry, facts: ClusterFacts, now: float) -> Card | None:
    """The newest card of who shows this one, if it counts, and will for long enough; None if it is time for another.

    So whoever asks for certificates all day makes no record of the log by it.
    """
    today = datetime.datetime.fromtimestamp(now, datetime.UTC)
    known = card_of(card.name, registry, facts)
    mine = [card] if known is None or known.tls_key != card.tls_key else [card, known]
    good = [one for one in mine if one.counts(today) and today < one.renew_from]
    return max(good, key=lambda one: one.not_after, default=None)


def check_trust(entry: Trust, registry: Registry, facts: ClusterFacts) -> None:
    """Refused unless this is a node of the cluster, and what may be sealed to, if anything, the key that it has."""
    known = credential_of(entry.node, registry, facts)
    if known is None:
        raise _forbidden(f"{address_of(entry.node)} is no node of this cluster", "see `scenectl cluster nodes`")
    if entry.trusted and entry.sealing_key != known.sealing_key.raw:
        raise _forbidden(f"{address_of(entry.node)} opens with another key than the one that was sealed to", "trust it again")


def check_others_administer(name: str, registry: Registry, facts: ClusterFacts) -> None:
    """Refused if nobody could give orders any more without this user."""
    if administrators(registry, facts) == [name]:
        raise _forbidden(f"{name} is the only administrator", "invite another one first, with --admin")


def check_others_issue(node: NodeId, registry: Registry) -> None:
    """Refused if nobody could be enrolled any more, and no certificate renewed, without this node. Who has left the line helps nobody."""
    if node in registry.issuers and not any(registry.stands(other) for other in registry.issuers - {node}):
        what = f"{address_of(node)} is the only trusted node that has the authority's key"
        waiting = ", ".join(address_of(other) for other in sorted(registry.roll.trusted - {node}) if registry.stands(other))
        if waiting:
            raise Refused(RejectReason.NOT_READY, what, remedy=f"wait until it was sealed to {waiting}")
        raise _forbidden(what, "trust another one first: scenectl cluster trust ADDRESS")


def check_not_expired(invite: Invite, now: float) -> None:
    """Refused once an invitation is open no longer. The node that issues asks, and the voter again: so no slow clock of the one revives it."""
    if now > invite.expires:
        until, clock = in_utc(invite.expires), in_utc(now)
        raise _forbidden(f"the token was valid until {until}, and this node's clock says {clock}", "ask for another one")


def in_utc(moment: float) -> str:
    """Seconds since 1970, for people."""
    return f"{datetime.datetime.fromtimestamp(moment, datetime.UTC):%Y-%m-%d %H:%M} UTC"


def _keys_of(name: str, registry: Registry, facts: ClusterFacts) -> tuple[object, object] | None:
    node = node_named(name)
    if node is not None:
        known = credential_of(node, registry, facts)
        return None if known is None else (known.public_key, known.sealing_key)
    card = card_of(name, registry, facts)
    return None if card is None else (card.keys.signing, card.keys.sealing)


def _owner(name: str, facts: ClusterFacts) -> Card | None:
    return next((card for card in map(Card.read, facts.owners) if card.name == name), None)


def _forbidden(what: str, remedy: str = "") -> Refused:
    return Refused(RejectReason.NOT_AUTHORISED, what, remedy=remedy)
