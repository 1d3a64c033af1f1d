"""Who belongs to a cluster, and what its administrators order (specs/15-cluster-log.md, Enrolling).

An order is signed by the administrator's own key, so whatever node takes it to the voter can neither alter it nor give it again.
Who is a member, and by which keys, says the cluster's log, whoever shows it (known_log.py).
"""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from scenefold.base.errors import DamagedData, LocalFault, PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.client.calls import Calls
from scenefold.client.contacts import named_in_a_token
from scenefold.client.known_log import KnownLog
from scenefold.client.orders import Orders
from scenefold.client.participants import Deciders
from scenefold.client.trusted import participants_of
from scenefold.crypto import (
    AUTHORITY_PURPOSE,
    Card,
    InvitedKind,
    MemberSecrets,
    SealingPublicKey,
    SigningKey,
    Token,
    mark_of,
    node_named,
    pem_of,
)
from scenefold.crypto.invitations import ADDRESSES_MAX
from scenefold.wire import ParticipantEntry, RemoveNode, RevokeNode
from scenefold.wire.enrol_entries import Invite, RevokeUser, Trust, Withdraw
from scenefold.wire.enrol_packets import (
    Enrolled,
    RequestCard,
    RequestRenewal,
    RespondCard,
)
from scenefold.world import Priority
from scenefold.world.keyring import checked_name
from scenefold.world.log_view import LogView, NodeKeys
from scenefold.world.profile import ClusterProfile
from scenefold.world.roll import Invitation, InvitationState

FRESH_S = 5.0
"""What was learnt of the log so lately serves for a question, unless it says no."""


@dataclass(frozen=True, slots=True)
class Roll:
    """Who belongs to the cluster. `cards`: users, and nodes that were enrolled by a token; `revoked`: names of those whose key counts no longer."""

    cards: tuple[Card, ...]
    invitations: tuple[Invitation, ...]
    trusted: tuple[NodeId, ...]
    revoked: tuple[str, ...]

    @property
    def users(self) -> list[Card]:
        return [card for card in self.cards if card.name.startswith("user:")]


class Revoked(NamedTuple):
    """What a revocation had to do: whether the keys counted until now, and whether a node of theirs stood on the line."""

    keys: bool
    line: bool = False


class Membership:
    """Of one cluster, under the keys of one user."""

    def __init__(self, calls: Calls, profile: ClusterProfile, secrets: MemberSecrets, log: KnownLog, orders: Orders) -> None:
        self._calls = calls
        self._profile = profile
        self._secrets = secrets
        self._cluster_log = log
        self._me = f"user:{profile.user}"
        self._orders = orders

    async def roll(self) -> Roll:
        """Users, invitations, trusted nodes, as the cluster's log says. A card that the authority did not issue is nobody's."""
        view = await self._cluster_log.newest()
        authority = self._profile.authority_certificate()
        # Also those that ran out: one member that was away for long must not hide the others.
        cards = tuple(Card.verified(card.der, authority) for card in view.cards(self._profile.owners()))
        revoked = tuple(sorted({name for name, _ in view.roll.revoked}))
        return Roll(cards, tuple(view.roll.invitations.values()), tuple(sorted(view.roll.trusted)), revoked)

    async def card_of(self, name: str) -> Card:
        """The card of "user:<name>" or "node:<id>": whose signature counts, and what to seal to. LocalFault if there is no such member."""
        owners = self._profile.owners()
        view = await self._cluster_log.newest(age_s_max=FRESH_S)
        if not _is_member(name, view, owners):
            view = await self._cluster_log.newest()
        card = view.card_of(name, owners)
        if card is not None:
            return self._believed(card.der, name)
        node = node_named(name)
        keys = None if node is None else view.keys_of(node)
        if node is None or keys is None:
            raise self._no_member(name, view)
        # It was there from the start, so the log has its keys and no card: it shows its own.
        shown = await self._calls.ask(address_of(node), RequestCard(), RespondCard, priority=Priority.HIGH)
        card = self._believed(shown.card, name)
        if (card.keys.signing.raw, card.keys.sealing.raw) != keys:
            raise DamagedData(f"{name} shows a card for other keys than the cluster's log has", where=address_of(node))
        return card

    async def judged(self, deciders: Deciders) -> Deciders:
        """Who of those that decide a scene votes no more."""
        return deciders.judged((await self._cluster_log.newest(age_s_max=FRESH_S)).registered)

    async def participants(self, nodes: Sequence[NodeId]) -> tuple[ParticipantEntry, ...]:
        """These nodes, as they may decide a scene's log. LocalFault if one is no member, or not trusted."""
        return participants_of(await self._cluster_log.newest(), nodes, self._profile.voters[0])

    def _believed(self, der: bytes, name: str) -> Card:
        card = Card.verified(der, self._profile.authority_certificate(), self._now())
        if card.name != name:
            raise DamagedData(f"a node shows the card of {card.name} as that of {name}")
        return card

    def _no_member(self, name: str, view: LogView) -> LocalFault:
        node = node_named(name)
        is_none = f"{name} is no member of {self._profile.name}" if node is None else "no node of this cluster has this address"
        what = f"the key of {name} is revoked" if _was_revoked(name, view) else is_none
        where = name if node is None else address_of(node)
        return LocalFault(what, where=where, remedy=f"see `scenectl cluster {'users' if node is None else 'nodes'}`")

    # ------------------------------------------------------------------------------------------------------------ orders

    async def invite(
        self, name: str, *, seconds: float, is_administrator: bool = False, addresses: Sequence[NodeId] | None = None
    ) -> Token:
        """A token for one newcomer. `name`: "user:<name>", "node:<id>" or ANY_NODE. `addresses`: of nodes to ask; by default the first ones that the profile and the cluster's log name."""
        if name.startswith("user:"):
            checked_name(name.removeprefix("user:"), "user")
        key = SigningKey.generate()
        expires = int(self._calls.world.clock.wall() + seconds)
        await self._orders.give(Invite(key.public.raw, name, is_administrator, expires, self._me))
        nodes = named_in_a_token(self._profile, self._cluster_log.view) if addresses is None else addresses
        ports = self._profile.ports
        kind = InvitedKind.USER if name.startswith("user:") else InvitedKind.NODE
        mark = mark_of(self._profile.authority_certificate())
        return Token(kind, key.seed, mark, expires, ports.low, ports.high, tuple(nodes[:ADDRESSES_MAX]))

    async def withdraw(self, invitation: bytes) -> None:
        """Let an invitation count no longer: its key, or as much of the beginning as tells it from others. LocalFault if there is not just one."""
        open_ones = [
            one.entry.key
            for one in (await self.roll()).invitations
            if one.state is InvitationState.OPEN and one.entry.key.startswith(invitation)
        ]
        if len(open_ones) != 1:
            what = "no open invitation has this id" if not open_ones else "several invitations begin so"
            raise LocalFault(what, where=invitation.hex(), remedy="see `scenectl cluster invitations`")
        await self._orders.give(Withdraw(open_ones[0]))

    async def revoke_user(self, user: str) -> Revoked:
        """Let a user's key count no longer, anywhere in the cluster. That it counts no longer already is no error."""
        name, view = f"user:{user}", await self._cluster_log.newest()
        known = view.card_of(name, self._profile.owners())
        if known is None:
            if _was_revoked(name, view):
                return Revoked(keys=False)
            raise self._no_member(name, view)
        # Also one that has run out: its keys may be in a newer certificate that the log does not have (reissue.py).
        card = Card.verified(known.der, self._profile.authority_certificate())
        await self._orders.give(RevokeUser(card.name, card.signing_id))
        return Revoked(keys=True)

    async def revoke_node(self, node: NodeId) -> Revoked:
        """Let a node's key count no longer, and take it off the line, in the incarnation that the cluster's log gives it by then.

        Whatever of this was done before is no error, so what failed between the two may be given again.
        """
        view = await self._cluster_log.newest()
        keys = self.known_keys(node, view)
        if keys is None and not _was_revoked(f"node:{node}", view):
            raise self._no_member(f"node:{node}", view)
        position = view.position if keys is None else await self._orders.give(RevokeNode(node, keys.signing_id))
        try:
            is_removed = await self._removed_behind(position, node)
        except ScenefoldError as problem:
            problem.what = f"the keys of {address_of(node)} count no longer, but it may stand on the line still: {problem.what}"
            problem.remedy = "revoke it again, which goes on from there"
            raise
        return Revoked(keys is not None, is_removed)

    async def _removed_behind(self, position: int, node: NodeId) -> bool:
        """Take a node whose key was revoked there off the line; whether it stood on it."""

        async def shown() -> LogView:
            view = await self._cluster_log.newest()
            if view.position < position:
                remedy = "see `scenectl cluster status`"
                raise Refused(RejectReason.NOT_READY, "no node shows the cluster's log so far", where=address_of(node), remedy=remedy)
            return view

        member = (await self._calls.patiently(shown, refresh=False)).on_line(node)
        if member is not None:
            await self._orders.give(RemoveNode(member, "its key was revoked"))
        return member is not None

    async def trust(self, node: NodeId, *, trusted: bool = True) -> None:
        """Trust a node with the authority's key, or no longer. Who has that key seals it to the node; else a trusted node will."""
        if not trusted:
            await self._orders.give(Trust(node, False))
            return
        to, sealed = SealingPublicKey((await self._keys_of(node)).sealing), b""
        if (self._profile.folder / "authority" / "key.pem").exists():
            key = self._profile.authority().key_der()
            sealed = to.seal(key, AUTHORITY_PURPOSE, self._profile.cluster_id, self._calls.world.entropy.token)
        await self._orders.give(Trust(node, True, to.raw, sealed))

    async def trust_all(self) -> list[NodeId]:
        """Trust all nodes on the line; those that were not trusted before. If one cannot be, the error names those that are by now.

        Who stands there says the cluster's log: a table is what one node says, and may name one that was given away with its disk.
        """
        view = await self._cluster_log.newest()
        added: list[NodeId] = []
        for node in view.members:
            if node in view.roll.trusted or view.keys_of(node) is None:
                continue
            try:
                await self.trust(node)
            except ScenefoldError as problem:
                so_far = ", ".join(map(address_of, added)) or "nobody"
                problem.where = f"{address_of(node)}; trusted before it: {so_far}"
                raise
            added.append(node)
        return added

    async def renew(self) -> Card | None:
        """Have this user's certificate renewed, if two thirds of its time are over, and keep it; the newer one's card, None if none is due."""
        authority = self._profile.authority_certificate()
        card = Card.verified(self._profile.user_certificate(), authority)
        if self._now() < card.renew_from:
            return None
        last: ScenefoldError | None = None
        for node in (await self.roll()).trusted:
            try:
                packet = RequestRenewal(certificate=card.der)
                answer = await self._calls.ask(address_of(node), packet, Enrolled, priority=Priority.HIGH)
                newer = card.check_renewed(answer.certificate, authority, self._now())
            except (Refused, Unreachable, PeerFault, DamagedData) as problem:
                last = problem
                continue
            pem = pem_of(newer.der)
            await self._calls.world.workers.run("import", self._profile.keep_user_certificate, pem)
            self._calls.world.network.show(pem)
            return newer
        raise last or LocalFault("no node is trusted to renew certificates", remedy="see `scenectl cluster nodes`")

    async def _keys_of(self, node: NodeId) -> NodeKeys:
        """What a node signs with, and what is sealed to it, as the log says; of one that was certified and never came, as the profile does."""
        view = await self._cluster_log.newest()
        keys = self.known_keys(node, view)
        if keys is None:
            raise self._no_member(f"node:{node}", view)
        return keys

    def known_keys(self, node: NodeId, view: LogView) -> NodeKeys | None:
        """By the log; those of a node that was certified and never came, by the profile. None if it has none that count."""
        if (keys := view.keys_of(node)) is not None:
            return keys
        known = next((member for member in self._profile.members if member.node_id == node and node not in view.nodes), None)
        if known is None or view.roll.is_revoked(f"node:{node}", known.public_key.key_id):
            return None
        return NodeKeys(known.public_key.raw, known.sealing_key.raw)

    def _now(self) -> datetime.datetime:
        return datetime.datetime.fromtimestamp(self._calls.world.clock.wall(), datetime.UTC)


def _is_member(name: str, view: LogView, owners: Sequence[bytes]) -> bool:
    node = node_named(name)
    return view.card_of(name, owners) is not None or (node is not None and view.keys_of(node) is not None)


def _was_revoked(name: str, view: LogView) -> bool:
    return any(revoked == name for revoked, _ in view.roll.revoked)
