"""A node's certificate is renewed while the old one still counts (specs/15-cluster-log.md, Enrolling)."""

from __future__ import annotations

import datetime
import logging
from dataclasses import replace

from scenefold.base.errors import DamagedData, LocalFault, PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.ids import address_of
from scenefold.crypto import Card, pem_of
from scenefold.peer.cluster_log.cluster_log import ClusterLog
from scenefold.peer.enrolment.enrolling import Enrolling
from scenefold.peer.enrolment.papers import Papers
from scenefold.peer.peers import Peers
from scenefold.wire.enrol_packets import Enrolled, RequestRenewal
from scenefold.world import Priority, QuietLog, World
from scenefold.world.facts import ClusterFacts

ASK_S_MAX = 10.0
LOOK_S = 6 * 3600.0
"""Between two looks at the calendar: clocks are set, and machines sleep."""
TRY_AGAIN_S = 600.0

_log = logging.getLogger("scenefold.peer.enrolment.renewal")


class Renewal:
    """`papers` as this node was started with; those of a renewed certificate are kept by them, and shown by the world's network."""

    def __init__(
        self, world: World, facts: ClusterFacts, cluster_log: ClusterLog, peers: Peers, enrolling: Enrolling, papers: Papers
    ) -> None:
        self._world = world
        self._facts = facts
        self._cluster_log = cluster_log
        self._peers = peers
        self._enrolling = enrolling
        self._papers = papers
        self._quiet = QuietLog(_log)

    async def run(self) -> None:
        """Look after the certificate until cancelled."""
        if not self._papers.certificate:
            return
        card = Card.verified(self._papers.certificate, self._facts.authority)
        while True:
            if self._today() < card.renew_from:
                await self._world.clock.sleep(LOOK_S)
                continue
            try:
                card = await self._renewed(card)
            except (Refused, Unreachable, PeerFault, DamagedData, LocalFault) as problem:
                text = f"the certificate of this node, which counts until {card.not_after:%Y-%m-%d}, is not renewed yet: {problem}"
                self._quiet.say(self._world.clock.now(), "certificate", "renewal", text)
                await self._world.clock.sleep(TRY_AGAIN_S)

    async def _renewed(self, card: Card) -> Card:
        newer = await self._answer(card)
        pem = pem_of(newer.der)
        await self._world.workers.run("import", self._papers.keep, pem)
        self._world.network.show(pem)
        self._papers = replace(self._papers, certificate=pem)
        self._enrolling.papers = self._papers
        _log.info("the certificate of this node is renewed, until %s", f"{newer.not_after:%Y-%m-%d}")
        return newer

    async def _answer(self, card: Card) -> Card:
        """A newer certificate that counts today: of our own making, if we are trusted with that, else that of another trusted node."""
        await self._cluster_log.changed_after(0)
        own = await self._enrolling.renewed(card)
        if own is not None:
            return card.check_renewed(own, self._facts.authority, self._today())
        last: ScenefoldError | None = None
        for node in sorted(self._cluster_log.registry.roll.trusted):
            try:
                reply = await self._peers.ask(node, Priority.HIGH, RequestRenewal(certificate=card.der), Enrolled, ASK_S_MAX)
                return card.check_renewed(reply.certificate, self._facts.authority, self._today())
            except (Refused, Unreachable, PeerFault, DamagedData) as problem:
                last = problem
        trusted = ", ".join(map(address_of, sorted(self._cluster_log.registry.roll.trusted)))
        raise last or Unreachable("no node is trusted to renew it", where=trusted)

    def _today(self) -> datetime.datetime:
        return datetime.datetime.fromtimestamp(self._world.clock.wall(), datetime.UTC)
