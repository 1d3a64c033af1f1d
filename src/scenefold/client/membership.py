"""Who belongs to a cluster, and what its administrators order (specs/15-cluster-log.md, Enrolling).

An order is signed by the administrator's own key, so whatever node takes it to the voter can neither alter it nor give it again.
What nodes say of others counts as far as the authority's signature goes.
"""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass

from scenefold.base.errors import DamagedData, LocalFault, PeerFault, Refused, ScenefoldError, Unreachable, UsageFault
from scenefold.base.ids import KeyId, NodeId, address_of, node_id_of
from scenefold.client.calls import Calls
from scenefold.crypto import (
    AUTHORITY_PURPOSE,
    ORDER_DOMAIN,
    Card,
    InvitedKind,
    MemberSecrets,
    SealingPublicKey,
    SigningKey,
    Token,
    mark_of,
    pem_of,
)
from scenefold.wire import RemoveNode, RevokeNode
from scenefold.wire.enrol_entries import Invite, RevokeUser, Trust, Withdraw
from scenefold.wire.enrol_packets import (
    Administer,
    Administered,
    Enrolled,
    InvitationState,
    KnownInvitation,
    RequestRenewal,
    RequestRoll,
    RespondRoll,
)
from scenefold.wire.log_entries import SingleEntry
from scenefold.wire.orders import Order
from scenefold.wire.scene_log_packets import Member
from scenefold.world import Priority
from scenefold.world.keyring import checked_name
from scenefold.world.profile import ClusterProfile


@dataclass(frozen=True, slots=True)
class Roll:
    """Who belongs to the cluster, as a node knows it. `cards`: users, and nodes that were enrolled by a token."""

    cards: tuple[Card, ...]
    invitations: tuple[KnownInvitation, ...]
    trusted: tuple[NodeId, ...]
    revoked: tuple[str, ...]

    @property
    def users(self) -> list[Card]:
        return [card for card in self.cards if card.name.startswith("user:")]


class Membership:
    """Of one cluster, under the keys of one user."""

    def __init__(self, calls: Calls, profile: ClusterProfile, secrets: MemberSecrets) -> None:
        self._calls = calls
        self._profile = profile
        self._secrets = secrets
        self._me = f"user:{profile.user}"

    async def roll(self) -> Roll:
        """Users, invitations, trusted nodes. A card that the authority did not issue is nobody's."""
        answer = await self._calls.ask_any(RequestRoll(name=""), RespondRoll, first=self._profile.voters[0])
        authority = self._profile.authority_certificate()
        # Also those that ran out: one member that was away for long must not hide the others.
        cards = tuple(Card.verified(der, authority) for der in answer.cards)
        return Roll(cards, answer.invitations, answer.trusted, answer.revoked)

    async def card_of(self, name: str) -> Card:
        """The card of "user:<name>" or "node:<id>": whose signature counts, and what to seal to. LocalFault if there is no such member."""
        answer = await self._calls.ask_any(RequestRoll(name=name), RespondRoll, first=self._profile.voters[0])
        if not answer.cards and name.startswith("node:"):
            # It was there from the start, so the log has no card of it: it shows its own.
            address = address_of(NodeId(int(name[5:])))
            if NodeId(int(name[5:])) not in [status.node for status in (await self._calls.refresh(self._profile.voters[0])).statuses]:
                raise LocalFault("no node of this cluster has this address", where=address, remedy="see `scenectl cluster nodes`")
            answer = await self._calls.ask(address, RequestRoll(name=name), RespondRoll, priority=Priority.HIGH)
        if not answer.cards:
            raise LocalFault(f"{name} is no member of {self._profile.name}", where=name, remedy="see `scenectl cluster users`")
        return self._believed(answer.cards[0], name)

    def _believed(self, der: bytes, name: str) -> Card:
        card = Card.verified(der, self._profile.authority_certificate(), self._now())
        if card.name != name:
            raise DamagedData(f"a node shows the card of {card.name} as that of {name}")
        return card

    # ------------------------------------------------------------------------------------------------------------ orders

    async def invite(
        self, name: str, *, seconds: float, is_administrator: bool = False, addresses: Sequence[NodeId] | None = None
    ) -> Token:
        """A token for one newcomer. `name`: "user:<name>", "node:<id>" or ANY_NODE. `addresses`: of nodes to ask; by default the first that the profile names."""
        if name.startswith("user:"):
            checked_name(name.removeprefix("user:"), "user")
        key = SigningKey.generate()
        expires = int(self._calls.world.clock.wall() + seconds)
        seeds = [node_id_of(seed) for seed in self._profile.seeds] if addresses is None else list(addresses)
        await self._order(Invite(key.public.raw, name, is_administrator, expires, self._me))
        ports = self._profile.ports
        kind = InvitedKind.USER if name.startswith("user:") else InvitedKind.NODE
        mark = mark_of(self._profile.authority_certificate())
        return Token(kind, key.seed, mark, expires, ports.low, ports.high, tuple(seeds[:3]))

    async def withdraw(self, invitation: bytes) -> None:
        """Let an invitation count no longer: its key, or as much of the beginning as tells it from others."""
        open_ones = [
            one.key for one in (await self.roll()).invitations if one.state is InvitationState.OPEN and one.key.startswith(invitation)
        ]
        if len(open_ones) != 1:
            what = "no open invitation has this id" if not open_ones else "several invitations begin so"
            raise UsageFault(what, where=invitation.hex(), remedy="see `scenectl cluster invitations`")
        await self._order(Withdraw(open_ones[0]))

    async def revoke_user(self, user: str) -> None:
        """Let a user's key count no longer, anywhere in the cluster."""
        card = await self.card_of(f"user:{user}")
        await self._order(RevokeUser(card.name, card.signing_id))

    async def revoke_node(self, node: NodeId) -> None:
        """Let a node's key count no longer, and take it off the line."""
        key = await self._signing_id(node)
        await self._order(RevokeNode(node, key))
        for status in (await self._calls.refresh(self._profile.voters[0])).statuses:
            if status.node == node:
                await self._order(RemoveNode(Member(node, status.incarnation), "its key was revoked"))

    async def trust(self, node: NodeId, *, trusted: bool = True) -> None:
        """Trust a node with the authority's key, or no longer. Who has that key seals it to the node; else a trusted node will."""
        if not trusted:
            await self._order(Trust(node, False))
            return
        to, sealed = await self._sealing_key(node), b""
        if (self._profile.folder / "authority" / "key.pem").exists():
            key = self._profile.authority().key_der()
            sealed = to.seal(key, AUTHORITY_PURPOSE, self._profile.cluster_id, self._calls.world.entropy.token)
        await self._order(Trust(node, True, to.raw, sealed))

    async def renew(self) -> Card | None:
        """Have this user's certificate renewed, if two thirds of its time are over, and keep it; the newer one's card, None if none is due."""
        authority = self._profile.authority_certificate()
        card = Card.verified(self._profile.user_certificate(), authority)
        if self._now() < card.renew_from:
            return None
        trusted = (await self._calls.ask_any(RequestRoll(name=""), RespondRoll, first=self._profile.voters[0])).trusted
        last: ScenefoldError | None = None
        for node in trusted:
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

    async def _sealing_key(self, node: NodeId) -> SealingPublicKey:
        """What the authority's key may be sealed to, by the voter's word: another node could show a card whose keys were replaced."""
        name, voter = f"node:{node}", address_of(self._profile.voters[0])

        async def ask() -> RespondRoll:
            return await self._calls.ask(voter, RequestRoll(name=name), RespondRoll, priority=Priority.HIGH)

        cards = (await self._calls.patiently(ask, refresh=False)).cards
        if cards:
            return self._believed(cards[0], name).keys.sealing
        known = next((member for member in self._profile.members if member.node_id == node), None)
        if known is None:
            raise LocalFault("no node of this cluster has this address", where=address_of(node), remedy="see `scenectl cluster nodes`")
        return known.sealing_key

    async def _signing_id(self, node: NodeId) -> KeyId:
        known = next((member for member in self._profile.members if member.node_id == node), None)
        answer = await self._calls.ask_any(RequestRoll(name=f"node:{node}"), RespondRoll, first=self._profile.voters[0])
        if answer.cards:
            return self._believed(answer.cards[0], f"node:{node}").signing_id
        if known is None:
            raise LocalFault("no node of this cluster has this address", where=address_of(node), remedy="see `scenectl cluster nodes`")
        return known.public_key.key_id

    async def _order(self, entry: SingleEntry) -> int:
        world = self._calls.world
        issued, request = int(world.clock.wall()), world.entropy.token(16)
        order = Order(self._profile.cluster_id, request, self._me, issued, entry).encode()
        packet = Administer(order=order, signature=self._secrets.signing.sign(ORDER_DOMAIN, order))
        voter = address_of(self._profile.voters[0])

        async def give() -> Administered:
            return await self._calls.ask(voter, packet, Administered, priority=Priority.HIGH)

        return (await self._calls.patiently(give, refresh=False)).position

    def _now(self) -> datetime.datetime:
        return datetime.datetime.fromtimestamp(self._calls.world.clock.wall(), datetime.UTC)
