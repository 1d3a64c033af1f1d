"""Newcomers, certificates, and administrators' orders, as a node serves them (specs/15-cluster-log.md, Enrolling).

Any node takes a newcomer's request, and judges it; a trusted one, which can open the authority's key, issues the certificate, has the log
say so, and only then answers. Orders go to the voter. What is judged how stands in enrol_rules.py, without any of this.
"""

from __future__ import annotations

import datetime
import logging
from collections.abc import Callable

import trio

from scenefold.base.errors import DamagedData, Refused, ScenefoldError, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.crypto import AUTHORITY_PURPOSE, Authority, Card, MemberSecrets, authority_der
from scenefold.peer.cluster_log.asking_voters import ask_in_turn
from scenefold.peer.cluster_log.cluster_log import ClusterLog
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.enrolment.card_rules import check_renewable, credential_of, not_due
from scenefold.peer.enrolment.discovery import Allowance
from scenefold.peer.enrolment.enrol_rules import IssuedBefore, Judged, judge_form, judge_order
from scenefold.peer.enrolment.papers import Papers
from scenefold.peer.handlers import Handlers, Senders
from scenefold.peer.peers import Peers
from scenefold.wire import Fault, FrameReader, MalformedPacket, Packet, decode_packet, encode_frame
from scenefold.wire.enrol_entries import Enrol, RenewCard, Trust
from scenefold.wire.enrol_packets import (
    Administer,
    Administered,
    Enrolled,
    Greeting,
    RequestCard,
    RequestEnrolment,
    RequestRenewal,
    RespondCard,
)
from scenefold.wire.orders import Order
from scenefold.world import Connection, ConnectionLost, Priority, QuietLog, World
from scenefold.world.enrol_forms import Wanted, form_in
from scenefold.world.facts import ClusterFacts
from scenefold.world.surviving import BUG, ends_the_node, say_bug

ASK_S_MAX = 10.0
"""Another node has so long to answer for us."""
REQUEST_S_MAX = 3.0
"""A newcomer, to say what it wants: it has prepared that before it came."""
SHARE_AGAIN_S = 10.0
"""After the authority's key could not be sealed to a node."""
NEWS_S_MAX = 5.0
NEWS_PER_S_MAX = 2
"""For tokens that nobody here has heard of the log is asked for so often: strangers make up as many as they like."""
REQUEST_BYTES_MAX = 8192
RECEIVE_BYTES = 4096
_CERTIFY = "crypto"

_log = logging.getLogger("scenefold.peer.enrolment.enrolling")


class Enrolling:
    """All that a node does about who belongs to the cluster."""

    def __init__(
        self, world: World, facts: ClusterFacts, me: NodeId, secrets: MemberSecrets, cluster_log: ClusterLog, peers: Peers, papers: Papers
    ) -> None:
        self._world = world
        self._facts = facts
        self._me = me
        self._secrets = secrets
        self._cluster_log = cluster_log
        self._peers = peers
        self.papers = papers
        """Replaced by who renews the certificate."""
        self._quiet = QuietLog(_log)
        self._news = Allowance(NEWS_PER_S_MAX)

    @property
    def _registry(self) -> Registry:
        return self._cluster_log.registry

    def register(self, handlers: Handlers) -> None:
        handlers.add(RequestEnrolment, self._on_enrolment, senders=Senders.NODES)
        handlers.add(RequestRenewal, self._on_renewal)
        handlers.add(Administer, self._on_order)
        handlers.add(RequestCard, self._on_card)

    # ------------------------------------------------------------------------------------------------------- newcomers

    async def serve_newcomer(self, connection: Connection, expected: Callable[[bytes], None]) -> None:
        """Greet who has no certificate, take one request, answer it. Who has shown an open invitation is expected."""
        if not self._facts.authority:
            return
        await connection.send(encode_frame(Greeting(authority=authority_der(self._facts.authority))))
        try:
            answer: Packet = await self._enrolled(await self._request_of(connection), expected)
        except (ScenefoldError, MalformedPacket) as problem:
            reason = problem.reason if isinstance(problem, Refused) else RejectReason.ILL_FORMED
            reason = RejectReason.NOT_READY if isinstance(problem, Unreachable) else reason
            self._quiet.say(self._world.clock.now(), "newcomers", reason.name, f"a newcomer is refused: {problem}")
            answer = Fault(reason=reason, text=str(problem)[:400])
        except ConnectionLost:
            raise
        except Exception as bug:  # who has no certificate yet is no reason to be away for all others
            if ends_the_node(bug):
                raise
            say_bug(self._quiet, self._world.clock.now(), "newcomers", bug)
            answer = Fault(reason=RejectReason.NOT_READY, text=str(BUG))
        await connection.send(encode_frame(answer))

    async def _request_of(self, connection: Connection) -> RequestEnrolment:
        frames = FrameReader(REQUEST_BYTES_MAX)
        with trio.move_on_after(REQUEST_S_MAX):
            while data := await connection.receive(RECEIVE_BYTES):
                for frame in frames.feed(data):
                    packet = decode_packet(frame)
                    if not isinstance(packet, RequestEnrolment):
                        raise Refused(RejectReason.NOT_AUTHORISED, "who has no certificate may only ask for one")
                    return packet
        raise Refused(RejectReason.ILL_FORMED, "no request came")

    async def _on_enrolment(self, packet: RequestEnrolment, _peer: str) -> Packet:
        if self._authority() is None:
            raise Refused(RejectReason.NOT_READY, f"{address_of(self._me)} does not have the authority's key")
        return await self._enrolled(packet, lambda _invitation: None)

    async def _enrolled(self, packet: RequestEnrolment, expected: Callable[[bytes], None]) -> Enrolled:
        invitation = form_in(packet.form).invitation
        is_news = await self._hear_of(invitation)
        try:
            judged = self._judged(packet)
        except Refused as refusal:
            if is_news or refusal.reason is not RejectReason.NOT_AUTHORISED:
                raise
            # Whoever makes tokens up must not have those refused that were given out.
            what = "too many ask here with tokens that this node does not know"
            raise Refused(RejectReason.NOT_READY, what, remedy="try again in a moment") from refusal
        if isinstance(judged, IssuedBefore):
            return self._answer(judged.card.der)
        expected(invitation)
        if (authority := self._authority()) is None:
            return await self._of_a_trusted_node(packet)
        try:
            return self._answer(await self._issue(judged, packet, authority))
        except Refused:
            # Somebody was faster: then what was issued to the same newcomer is the answer, and else the refusal says why.
            judged = self._judged(packet)
            if not isinstance(judged, IssuedBefore):
                raise
            return self._answer(judged.card.der)

    async def _hear_of(self, invitation: bytes) -> bool:
        """An invitation that this node does not know may stand in the log of others: tokens are used as soon as they are given.

        False if it may not be asked for now.
        """
        if invitation in self._registry.roll.invitations:
            return True
        if not self._news.take(self._world.clock.now()):
            return False
        with trio.move_on_after(NEWS_S_MAX):
            await self._cluster_log.pull()
        return True

    def _judged(self, packet: RequestEnrolment) -> Judged:
        if not self._registry.position:
            raise Refused(RejectReason.NOT_READY, "this node does not know the cluster's log yet", remedy="try again in a moment")
        return judge_form(packet.form, packet.signature, self._registry, self._facts, self._world.clock.wall())

    async def _issue(self, asked: Wanted, packet: RequestEnrolment, authority: Authority) -> bytes:
        der = await self._certified(authority, asked.name, asked.addresses, asked)
        await self._cluster_log.propose(Enrol(packet.form, packet.signature, der))
        _log.info("%s is enrolled", asked.name)
        return der

    async def _certified(self, authority: Authority, name: str, addresses: tuple[str, ...], what: Wanted | Card) -> bytes:
        now = datetime.datetime.fromtimestamp(self._world.clock.wall(), datetime.UTC)

        def certify() -> bytes:
            pem = authority.certify(name, list(addresses), what.tls_key, keys=what.keys, now=now)
            return Card.verified(pem, authority.certificate).der

        try:
            return await self._world.workers.run(_CERTIFY, certify)
        except DamagedData as problem:
            raise Refused(RejectReason.ILL_FORMED, str(problem)) from problem

    async def _of_a_trusted_node(self, packet: Packet) -> Enrolled:
        """The answer of one that has the authority's key."""
        last: ScenefoldError | None = None
        for node in sorted(self._registry.roll.trusted - {self._me}):
            try:
                return await self._peers.ask(node, Priority.HIGH, packet, Enrolled, ASK_S_MAX)
            except Unreachable as problem:
                last = problem
            except Refused as refusal:
                if refusal.reason is not RejectReason.NOT_READY:
                    raise
                last = refusal
        trusted = ", ".join(map(address_of, sorted(self._registry.roll.trusted)))
        why = "" if last is None else f": {last.what}"
        raise Refused(RejectReason.NOT_READY, f"no trusted node ({trusted}) answers{why}", remedy="start one of them, then try again")

    def _answer(self, certificate: bytes) -> Enrolled:
        return Enrolled(certificate=certificate, authority=authority_der(self._facts.authority), charter=self._facts.charter)

    # ------------------------------------------------------------------------------------------------------ the authority

    def _authority(self) -> Authority | None:
        """The authority, if the cluster trusts this node with it, and its key was sealed to us."""
        registry = self._registry
        sealed = registry.roll.sealed.get(self._me, self.papers.sealed)
        if not sealed or not registry.is_trusted(self._me):
            return None
        try:
            key = self._secrets.sealing.open(sealed, AUTHORITY_PURPOSE, self._facts.cluster_id)
            return Authority.from_key(self._facts.authority, key)
        except DamagedData as problem:
            self._quiet.say(self._world.clock.now(), "authority", "sealed", f"the authority's key cannot be opened: {problem}")
            return None

    async def share_authority(self) -> None:
        """Seal the authority's key to whoever is trusted and does not have it yet, until cancelled."""
        while True:
            registry = self._registry
            if await self._shared(registry):
                await self._cluster_log.changed_after(registry.position)
            else:
                await self._world.clock.sleep(SHARE_AGAIN_S)

    async def _shared(self, registry: Registry) -> bool:
        """Whether nothing is left to do."""
        authority = self._authority()
        wanting = registry.roll.trusted - registry.issuers - {self._me}
        if authority is None or not wanting:
            return True
        try:
            for node in sorted(wanting):
                known = credential_of(node, registry, self._facts)
                if known is not None:
                    key, cluster = authority.key_der(), self._facts.cluster_id
                    sealed = known.sealing_key.seal(key, AUTHORITY_PURPOSE, cluster, self._world.entropy.token)
                    await self._cluster_log.propose(Trust(node, True, known.sealing_key.raw, sealed))
        except (Refused, Unreachable) as problem:
            self._quiet.say(self._world.clock.now(), "authority", "share", f"the authority's key cannot be shared: {problem}")
            return False
        return True

    async def _on_renewal(self, packet: RequestRenewal, peer: str) -> Packet:
        card = check_renewable(packet.certificate, peer, self._registry, self._facts)
        good = not_due(card, self._registry, self._facts, self._world.clock.wall())
        der = await self.renewed(card) if good is None else good.der
        if der is None:
            trusted = ", ".join(map(address_of, sorted(self._registry.roll.trusted)))
            what = f"{address_of(self._me)} does not have the authority's key"
            raise Refused(RejectReason.NOT_READY, what, remedy=f"ask one of {trusted}")
        return self._answer(der)

    async def renewed(self, card: Card) -> bytes | None:
        """A newer certificate (DER) of a member, which the log knows from now on; None if this node cannot make one."""
        authority = self._authority()
        if authority is None:
            return None
        der = await self._certified(authority, card.name, card.addresses, card)
        await self._cluster_log.propose(RenewCard(der))
        return der

    # ------------------------------------------------------------------------------------------------------------- orders

    async def _on_order(self, packet: Administer, _peer: str) -> Packet:
        voters = self._registry.voters if self._cluster_log.is_by_votes else (self._facts.voter,)
        Order.decode(packet.order)  # What is none is not passed on: the voter would take it for ours.
        if self._me not in voters:

            async def ask(voter: NodeId) -> Packet:
                return await self._peers.ask(voter, Priority.HIGH, packet, Administered, ASK_S_MAX)

            return await ask_in_turn([node for node in self._peers.others() if node in voters] or voters, ask)
        order = judge_order(packet.order, packet.signature, self._registry, self._facts, self._world.clock.wall())
        position = await self._cluster_log.propose(order.entry, order.request)
        return Administered(position=position)

    async def _on_card(self, _packet: RequestCard, _peer: str) -> Packet:
        certificate = self.papers.certificate
        return RespondCard(card=Card.verified(certificate, self._facts.authority).der if certificate else b"")
