"""Who was invited, who is enrolled, whose key was revoked, whom the cluster trusts: a part of the log's fold (specs/15-cluster-log.md).

Members that the cluster began with do not stand here: the charter has its first user, and the facts have the nodes' credentials. That a
card was issued by the authority, and while the invitation counted, is judged before it is committed (peer/enrolment/card_rules.py); that the
holder of the invitation asked for it is judged here, by everybody who folds the log. Values, all of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from functools import lru_cache

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import KeyId, NodeId
from scenefold.base.reasons import RejectReason
from scenefold.crypto import NAME_PATTERN, Card, check_tls_key, node_named
from scenefold.wire.enrol_entries import ANY_NODE, Enrol, EnrolEntry, Invite, RenewCard, RevokeUser, Trust, Withdraw
from scenefold.world.enrol_forms import check_signed, form_in, wanted

LISTED_MAX = 2048
"""Open invitations, and members that were enrolled and count."""


class InvitationState(Enum):
    OPEN = auto()
    USED = auto()
    WITHDRAWN = auto()


@dataclass(frozen=True, slots=True)
class Invitation:
    """As the log has it. `card`: what was issued for it. Whether an open one is out of date, the reader's clock says."""

    entry: Invite
    state: InvitationState = InvitationState.OPEN
    card: Card | None = None


@dataclass(frozen=True, slots=True)
class Roll:
    """`cards`: the newest of each member that was enrolled, or renewed. `sealed`: the authority's key, by the node that can open it."""

    invitations: Mapping[bytes, Invitation] = field(default_factory=dict)
    cards: Mapping[str, Card] = field(default_factory=dict)
    revoked: frozenset[tuple[str, KeyId]] = frozenset()
    trusted: frozenset[NodeId] = frozenset()
    sealed: Mapping[NodeId, bytes] = field(default_factory=dict)

    def card_of(self, name: str) -> Card | None:
        """The card of a member whose key was not revoked, if the log has it."""
        card = self.cards.get(name)
        return None if card is None or self.is_revoked(name, card.signing_id) else card

    def is_revoked(self, name: str, key: KeyId) -> bool:
        return (name, key) in self.revoked

    def after(self, entry: EnrolEntry) -> Roll:
        """The roll after one more entry; Refused if that does not fit."""
        match entry:
            case Invite():
                return self._invited(entry)
            case Enrol():
                return self._enrolled(entry)
            case RenewCard(der):
                return self._renewed(card_in(der))
            case Withdraw(key):
                return self._with(replace(self._open_invitation(key), state=InvitationState.WITHDRAWN))
            case RevokeUser(name, key):
                if not name.startswith("user:"):
                    raise _ill_formed(f"{name!r} is no user")
                return self.without(name, key)
            case Trust():
                return self._trusting(entry)

    def without(self, name: str, key: KeyId) -> Roll:
        """The roll once a key of a member counts no longer. Nor do the invitations that it has given: one may be for itself."""
        node = node_named(name)
        sealed = {other: box for other, box in self.sealed.items() if other != node}
        trusted = self.trusted if node is None else self.trusted - {node}
        given = {
            mark: replace(one, state=InvitationState.WITHDRAWN)
            for mark, one in self.invitations.items()
            if one.entry.by == name and one.state is InvitationState.OPEN
        }
        invitations = {**self.invitations, **given}
        return replace(self, invitations=invitations, revoked=self.revoked | {(name, key)}, trusted=trusted, sealed=sealed)

    def _invited(self, entry: Invite) -> Roll:
        if entry.key in self.invitations:
            raise _ill_formed("an invitation is given once")
        is_user = entry.name.startswith("user:")
        if entry.name != ANY_NODE and not NAME_PATTERN.fullmatch(entry.name):
            raise _ill_formed(f"{entry.name!r} names no member")
        if entry.is_administrator and not is_user:
            raise _ill_formed("nodes do not administer a cluster")
        if is_user and self.card_of(entry.name) is not None:
            raise _forbidden(f"{entry.name} is a member already")
        if sum(invitation.state is InvitationState.OPEN for invitation in self.invitations.values()) >= LISTED_MAX:
            raise Refused(RejectReason.LIMIT_EXCEEDED, f"{LISTED_MAX} invitations are open", remedy="withdraw those that nobody needs")
        return self._with(Invitation(entry))

    def _enrolled(self, entry: Enrol) -> Roll:
        form, card = form_in(entry.form), card_in(entry.card)
        invitation = self._open_invitation(form.invitation)
        check_signed(entry.form, entry.signature, form.invitation)
        asked = wanted(form, invitation.entry)
        check_invited(self, invitation.entry, asked.name, asked.keys.signing.key_id)
        asked.check_possible()
        if not asked.is_in(card):
            raise _forbidden(f"the card of {card.name} is not what the holder of the invitation asked for")
        node = node_named(card.name)
        used = self._with(replace(invitation, state=InvitationState.USED, card=card))
        # Trust, and the key that was sealed to it, were those of the keys that the node had before.
        trusted = used.trusted if node is None else used.trusted - {node}
        sealed = {other: box for other, box in used.sealed.items() if other != node}
        known = self.cards.get(card.name)
        # Else the disk that was lost, say, could come back as the member that it was; or somebody could put its card back.
        is_replaced = known is not None and known.signing_id != card.signing_id
        revoked = used.revoked | {(known.name, known.signing_id)} if known is not None and is_replaced else used.revoked
        return replace(used, cards={**self.cards, card.name: card}, trusted=trusted, sealed=sealed, revoked=revoked)

    def _renewed(self, card: Card) -> Roll:
        if self.is_revoked(card.name, card.signing_id):
            raise Refused(RejectReason.KEY_REVOKED, f"the key of {card.name} is revoked")
        known = self.cards.get(card.name)
        if known is not None and known.keys != card.keys:
            raise _forbidden(f"{card.name} is known by other keys")
        if known is not None and known.serial == card.serial:
            raise _ill_formed(f"the card of {card.name} is no newer one")
        return replace(self, cards={**self.cards, card.name: card})

    def _trusting(self, entry: Trust) -> Roll:
        if entry.trusted != bool(entry.sealing_key) or (entry.sealed and not entry.trusted):
            raise _ill_formed("trust names the key that may be sealed to, and its end none")
        sealed = {node: box for node, box in self.sealed.items() if node != entry.node}
        if not entry.trusted:
            return replace(self, trusted=self.trusted - {entry.node}, sealed=sealed)
        if entry.sealed:
            sealed[entry.node] = entry.sealed
        return replace(self, trusted=self.trusted | {entry.node}, sealed=sealed)

    def _open_invitation(self, key: bytes) -> Invitation:
        invitation = self.invitations.get(key)
        if invitation is None:
            raise _forbidden("nobody gave this invitation")
        if invitation.state is not InvitationState.OPEN:
            raise _forbidden(f"the invitation was {'used' if invitation.state is InvitationState.USED else 'withdrawn'} already")
        return invitation

    def _with(self, invitation: Invitation) -> Roll:
        return replace(self, invitations={**self.invitations, invitation.entry.key: invitation})


def check_invited(roll: Roll, invite: Invite, name: str, key: KeyId) -> None:
    """Refused unless this invitation is one for this name, which is free, under this key."""
    is_meant = node_named(name) is not None if invite.name == ANY_NODE else name == invite.name
    if not is_meant:
        raise _forbidden(f"the invitation is for {'a node' if invite.name == ANY_NODE else invite.name}, not for {name}")
    if roll.is_revoked(name, key):
        raise Refused(RejectReason.KEY_REVOKED, f"the key of {name} is revoked")
    known = roll.card_of(name)
    # An invitation that names a node may give it new keys: its disk was lost, say.
    if known is not None and (invite.name == ANY_NODE or node_named(name) is None):
        raise _forbidden(f"{name} is a member already")
    if known is None and sum(roll.card_of(member) is not None for member in roll.cards) >= LISTED_MAX:
        raise Refused(
            RejectReason.LIMIT_EXCEEDED, f"{LISTED_MAX} members are enrolled already", remedy="revoke those that are none any more"
        )


@lru_cache(maxsize=4096)
def card_in(der: bytes) -> Card:
    """The card in a certificate; Refused (5) if it is none, or of no TLS key that the authority certifies."""
    try:
        card = Card.read(der)
        check_tls_key(card.tls_key)
        return card
    except DamagedData as problem:
        raise _ill_formed(str(problem)) from problem


def _ill_formed(what: str) -> Refused:
    return Refused(RejectReason.ILL_FORMED, what)


def _forbidden(what: str) -> Refused:
    return Refused(RejectReason.NOT_AUTHORISED, what)
