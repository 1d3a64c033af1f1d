"""What a node answers about the cluster's log: packets 5, 6 and 118 (specs/15-cluster-log.md, Proposing; Learning; Lease)."""

from __future__ import annotations

import logging
from typing import Protocol

from scenefold.base.errors import Refused, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.asking_voters import Decide
from scenefold.peer.cluster_log.log_copy import LogCopy
from scenefold.peer.cluster_log.log_packets import accepted, rejected
from scenefold.peer.cluster_log.log_pull import LogPuller
from scenefold.peer.cluster_log.log_spread import LogPusher
from scenefold.peer.cluster_log.log_voter import Voter
from scenefold.peer.cluster_log.voting import Voting
from scenefold.peer.handlers import Handlers, Senders, node_of
from scenefold.wire import LogRecord, MalformedPacket, Packet, ProposeSceneLog, RequestSceneLog, RespondSceneLog, Want
from scenefold.world import Clock, QuietLog
from scenefold.world.facts import ClusterFacts

_log = logging.getLogger("scenefold.peer.cluster_log.cluster_log")


class SceneLogs(Protocol):
    """Who handles the same packets for scenes' logs."""

    async def on_propose(self, packet: ProposeSceneLog, peer: str) -> Packet: ...
    async def on_request(self, packet: RequestSceneLog, peer: str) -> Packet | None: ...
    async def on_push(self, packet: RespondSceneLog, peer: str) -> None: ...


class LogAnswers:
    """Used from the Trio thread only. `voter`: where the log's key is, or was until it gave way. `scenes`: who answers for all other logs."""

    def __init__(
        self,
        clock: Clock,
        facts: ClusterFacts,
        me: NodeId,
        copy: LogCopy,
        voting: Voting,
        voter: Voter | None,
        puller: LogPuller,
        pusher: LogPusher,
        decide: Decide,
    ) -> None:
        self._clock, self._facts, self._me = clock, facts, me
        self._scene, self._genesis = facts.genesis_header.scene, facts.genesis_header.genesis
        self._copy, self._voting, self._voter = copy, voting, voter
        self._puller, self._pusher, self._decide = puller, pusher, decide
        self.scenes: SceneLogs | None = None
        self._quiet = QuietLog(_log, logging.INFO)

    def register(self, handlers: Handlers) -> None:
        handlers.add(ProposeSceneLog, self._on_propose)
        handlers.add(RequestSceneLog, self._on_request)
        handlers.add(RespondSceneLog, self._on_push, senders=Senders.NODES)

    @property
    def _is_by_votes(self) -> bool:
        return bool(self._copy.registry.voting.councils)

    async def _on_propose(self, packet: ProposeSceneLog, peer: str) -> Packet:
        if packet.public.scene != self._scene and self.scenes is not None:
            return await self.scenes.on_propose(packet, peer)
        proposer = node_of(peer)
        try:
            if packet.genesis != self._genesis:
                raise Refused(RejectReason.ILL_FORMED, "it is for the log of another cluster")
            if self._voter is None and not self._is_by_votes:
                raise Refused(RejectReason.NOT_MY_LOCATION, "the cluster's log is decided elsewhere")
            if proposer is None or not self._copy.registry.position:
                reason = RejectReason.NOT_AUTHORISED if proposer is None else RejectReason.NOT_READY
                raise Refused(reason, "only nodes propose to the cluster's log, once it has begun")
            record = LogRecord.decode(packet.private)
            position = await self._decide(record.entry, record.request_id, proposer)
            return accepted(position, self._hash_at(position))
        except MalformedPacket as problem:
            return self._refuse(peer, RejectReason.ILL_FORMED, problem)
        except Refused as refusal:
            return self._refuse(peer, refusal.reason, refusal)
        except Unreachable as problem:
            return self._refuse(peer, RejectReason.NOT_READY, problem)

    def _hash_at(self, position: int) -> bytes:
        return self._copy.hash_at(position) if position <= self._copy.signed else self._voting.voted.hash_at(position)

    def _refuse(self, peer: str, reason: RejectReason, problem: Exception) -> Packet:
        self._quiet.say(self._clock.now(), peer, reason.name, f"a proposal is refused: {problem}")
        return rejected(reason, self._me if self._is_by_votes else self._facts.voter)

    async def _on_request(self, packet: RequestSceneLog, peer: str) -> Packet | None:
        if packet.scene != self._scene and self.scenes is not None:
            return await self.scenes.on_request(packet, peer)
        if packet.want is Want.DECIDED:
            return await self._voting.on_decided(packet, peer)
        if packet.genesis not in (b"", self._genesis):
            return RespondSceneLog(answer=None)
        asker = node_of(peer)
        if asker is not None:
            self._pusher.note(asker, min(packet.have, self._copy.registry.position))
        if packet.want is Want.LIVES:
            return self._on_lives(packet, asker)
        is_granted = packet.want is Want.LEASE and await self._on_lease(packet, asker)
        have = None if packet.want is Want.HEADER or is_granted else packet.have
        return RespondSceneLog(answer=self._copy.answer(packet.nonce, have, is_granted=is_granted))

    async def _on_lease(self, packet: RequestSceneLog, asker: NodeId | None) -> bool:
        if asker is None or (self._voter is None and not self._is_by_votes):
            raise Refused(RejectReason.NOT_MY_LOCATION, "owner leases are granted to nodes, by voters")
        if not self._is_by_votes and self._voter is not None:
            return await self._voter.grant(packet, asker)
        if not self._voting.is_open:
            raise Refused(RejectReason.NOT_READY, "the log's key grants no more leases, and voters do not yet")
        return await self._voting.on_lease(packet, asker)

    def _on_lives(self, packet: RequestSceneLog, asker: NodeId | None) -> Packet:
        if asker is None or not self._voting.is_open or self._copy.header is None:
            raise Refused(RejectReason.NOT_READY, "this node tells no lives")
        return RespondSceneLog(answer=self._voting.on_lives(packet, asker, self._copy.header))

    async def _on_push(self, packet: RespondSceneLog, peer: str) -> None:
        answer, source = packet.answer, node_of(peer)
        if answer is not None and answer.public.scene == self._scene:
            if source is not None:
                await self._puller.take(answer, source)
        elif not self._voting.on_push(packet, peer) and self.scenes is not None:
            await self.scenes.on_push(packet, peer)
