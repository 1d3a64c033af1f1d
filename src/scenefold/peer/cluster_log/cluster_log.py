"""The cluster's own log as a service: kept, pulled, pushed, proposed to (design: consensus §3, specs/15-cluster-log.md).

It is a scene by its packets (5 to 9), reserved by its id: the one that the genesis header of the cluster's facts gives. For
now one node votes and decides alone (log_voter.py). Everybody else proposes to it, takes its pushes, and pulls whenever
somebody shows a higher log position than ours, or after SYNC_S without news. A record counts once it is verified and
durable here, in that order, and only then does the rest of the node act on it.
"""

from __future__ import annotations

import logging
from typing import Protocol

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.crypto import LEASE_DOMAIN, SigningKey
from scenefold.peer.cluster_log.lives import Lives
from scenefold.peer.cluster_log.log_copy import LogCopy
from scenefold.peer.cluster_log.log_packets import GRANT, accepted, proposal_of, rejected
from scenefold.peer.cluster_log.log_pull import LogPuller
from scenefold.peer.cluster_log.log_rules import lease_message
from scenefold.peer.cluster_log.log_spread import LogPusher
from scenefold.peer.cluster_log.log_voter import Veto, Voter
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.handlers import Handlers, Senders, node_of
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.peers import Peers
from scenefold.peer.timing import (
    LEASE_ASK_S_MAX,
    PROPOSE_ASK_S_MAX,
    PROPOSE_RETRY_S,
    PROPOSE_S_MAX,
    SYNC_S,
    VOTER_PATIENCE_S,
)
from scenefold.store import Store
from scenefold.wire import (
    AcceptSceneProposal,
    Found,
    Founder,
    LogEntry,
    LogRecord,
    MalformedPacket,
    Packet,
    ProposeSceneLog,
    RejectSceneProposal,
    RequestSceneLog,
    RespondSceneLog,
    SignedRecord,
    Want,
)
from scenefold.world import Priority, QuietLog, World
from scenefold.world.facts import ClusterFacts

WITNESSES_MAX = 16
"""Nodes that a starting voter asks whether they know more than itself."""

_log = logging.getLogger("scenefold.peer.cluster_log.cluster_log")


class SceneLogs(Protocol):
    """Who handles the same packets for scenes' logs."""

    async def on_propose(self, packet: ProposeSceneLog, peer: str) -> Packet: ...
    async def on_request(self, packet: RequestSceneLog, peer: str) -> Packet | None: ...
    async def on_push(self, packet: RespondSceneLog, peer: str) -> None: ...


class ClusterLog:
    """The log as this node knows it. Used from the Trio thread only; `log_key` on the voter, None elsewhere."""

    def __init__(
        self, world: World, store: Store, peers: Peers, facts: ClusterFacts, own: OwnStatus, log_key: SigningKey | None = None
    ) -> None:
        self._world = world
        self._peers = peers
        self._facts = facts
        self._own = own
        self._scene, self._genesis = facts.genesis_header.scene, facts.genesis_header.genesis
        self._copy = LogCopy(world, store, facts, self._note_position)
        self._puller = LogPuller(world, peers, facts, self._copy, own.me)
        self._voter = None if log_key is None else Voter(world, store, facts, log_key, lambda: self.registry, self._commit)
        self._pusher = LogPusher(world.clock, peers, lambda: self._copy.position, self._push_from)
        self._scenes: SceneLogs | None = None
        self._quiet = QuietLog(_log, logging.INFO)

    # ------------------------------------------------------------------------------------------------- questions

    @property
    def registry(self) -> Registry:
        return self._copy.registry

    async def changed_after(self, position: int) -> Registry:
        """The registry once it is of a later position."""
        return await self._copy.changed_after(position)

    def learnt_at(self, position: int) -> float:
        """Local time when this node learnt a record; its start for those that it knew before."""
        return self._copy.learnt_at(position)

    def lapsed(self) -> list[NodeId]:
        """At the voter: members that hold no lease any more. Elsewhere nobody."""
        return [] if self._voter is None else self._voter.lapsed(self.learnt_at)

    def leased_at(self, node: NodeId) -> float | None:
        """At the voter: local time of the newest lease of a node since this start."""
        return None if self._voter is None else self._voter.leased_at(node)

    @property
    def veto(self) -> Veto | None:
        return None if self._voter is None else self._voter.veto

    @veto.setter
    def veto(self, veto: Veto | None) -> None:
        if self._voter is not None:
            self._voter.veto = veto

    # ---------------------------------------------------------------------------------------------------- running

    def register(self, handlers: Handlers, scenes: SceneLogs | None = None) -> None:
        """Answer packets 5, 6 and 118; those of other logs, and all that are about decisions, are handed to `scenes`."""
        self._scenes = scenes
        handlers.add(ProposeSceneLog, self._on_propose)
        handlers.add(RequestSceneLog, self._on_request)
        handlers.add(RespondSceneLog, self._on_push, senders=Senders.NODES)

    async def load(self) -> None:
        """Take what this node kept from before. DamagedData if it does not verify any more."""
        await self._copy.load()
        if self._voter is not None and self._copy.position:
            self._copy.header = self._voter.header(self._copy.position)

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        """Keep the log fresh until cancelled; a voter begins it if nobody has one."""
        async with trio.open_nursery() as nursery:
            await nursery.start(self._pusher.run)
            task_status.started()
            if self._voter is not None:
                await self._ask_around()
                await self._found(self._voter)
                self._pusher.wake(self._puller.others(self.registry.members))
            await self._puller.run(is_asked_for_news_only=self._voter is not None)

    def heard_of(self, node: NodeId, position: int) -> None:
        """A node says that its log has come to this position."""
        self._puller.heard_of(node, position)

    async def pull(self, at_least: int = 0) -> None:
        """Ask others for what this node lacks, until it has this position (0: until one has answered)."""
        await self._puller.pull(at_least)

    async def pull_from(self, node: NodeId) -> None:
        """Ask a node for what it says that it knows and this one lacks. No others: who claims more than there is gains nothing."""
        await self._puller.pull_from(node)

    async def _ask_around(self) -> None:
        """Whether others know more than this voter: its disk may be an older one, or a new one."""
        witnesses = self._puller.others((*self.registry.members, *self._facts.founders))[:WITNESSES_MAX]
        with trio.move_on_after(VOTER_PATIENCE_S):
            async with trio.open_nursery() as nursery:
                for node in witnesses:
                    nursery.start_soon(self._puller.pull_from, node)

    async def _found(self, voter: Voter) -> None:
        """Begin the log unless it has begun to the end; on a full disk, as soon as there is room."""
        founders = (self._facts.credential(node) for node in self._facts.founders)
        seats = tuple(Founder(one.node_id, one.public_key.raw, one.sealing_key.raw, one.address) for one in founders if one is not None)
        while True:
            try:
                await voter.found(Found(seats, self._facts.voters))
                return
            except Refused as refusal:
                _log.warning("the cluster's log cannot begin: %s", refusal)
                await self._world.clock.sleep(SYNC_S)

    # ------------------------------------------------------------------------------------------------- proposing

    async def propose(self, entry: LogEntry, request_id: bytes | None = None) -> int:
        """Have an entry committed; its position, once this node knows it too.

        Refused with the voter's reason: then it never will be in the log. Unreachable: it may be, or come there; whoever
        proposes it again with the same `request_id` (16 bytes) gets it committed once.
        """
        request = self._world.entropy.token(16) if request_id is None else request_id
        if self._voter is not None:
            return await self._voter.decide(entry, request, self._own.me)
        last: Unreachable | None = None
        with trio.move_on_after(PROPOSE_S_MAX):
            while True:
                try:
                    return await self._propose_once(entry, request)
                except Unreachable as problem:
                    last = problem
                await self._world.clock.sleep(PROPOSE_RETRY_S)
        raise last or Unreachable("the cluster's voter has not answered in time", where=address_of(self._facts.voter))

    async def _propose_once(self, entry: LogEntry, request: bytes) -> int:
        record = LogRecord(self.registry.position + 1, self.registry.head, request, self._own.me, entry)
        packet = proposal_of(record, self._facts)
        reply = await self._peers.ask(self._facts.voter, Priority.HIGH, packet, Packet, PROPOSE_ASK_S_MAX)
        if isinstance(reply, RejectSceneProposal):
            words = reply.reason.name.lower().replace("_", " ")
            raise Refused(reply.reason, f"the cluster's log refuses a {type(entry).__name__}: {words}", where=address_of(reply.node))
        if not isinstance(reply, AcceptSceneProposal):
            raise PeerFault(f"a proposal was answered with a {type(reply).__name__}", where=address_of(self._facts.voter))
        position = reply.position
        await self.pull_from(self._facts.voter)
        if self.registry.position < position:
            await self.pull(at_least=position)
        return (await self.changed_after(position - 1)).position_of(request) or position

    async def ask_lease(self, lives: Lives) -> bool:
        """Ask the voter for an owner lease. False: not now, and this node may be wiser about the log by it.

        Refused: 18 for an incarnation that was removed or a restored backup, 12 for one that is no member; Unreachable.
        """
        member, have = self._own.member, self.registry.position
        nonce = int.from_bytes(self._world.entropy.token(8), "big")
        message = lease_message(self._genesis, have, self.registry.head, nonce, member, lives)
        proof = self._own.key.sign(LEASE_DOMAIN, message)
        packet = RequestSceneLog(self._scene, self._genesis, have, nonce, Want.LEASE, member, proof, lives, mini_status=self._own.mini())
        if self._voter is not None:
            return await self._voter.grant(packet, self._own.me)
        answer = (await self._peers.ask(self._facts.voter, Priority.HIGH, packet, RespondSceneLog, LEASE_ASK_S_MAX)).answer
        if answer is None or answer.nonce != nonce:
            return False
        if not answer.flags & GRANT:
            await self._puller.take(answer, self._facts.voter)
            return False
        self._puller.confirmed()
        return True

    async def _commit(self, record: SignedRecord, registry: Registry) -> None:
        """For the voter: durable, then known, then told."""
        assert self._voter is not None
        await self._copy.commit(record, registry, self._voter.header(registry.position))
        self._pusher.wake(self._puller.others(registry.members))

    def _note_position(self, position: int) -> None:
        self._own.log_position = position

    # --------------------------------------------------------------------------------------------------- handlers

    async def _on_propose(self, packet: ProposeSceneLog, peer: str) -> Packet:
        if packet.public.scene != self._scene and self._scenes is not None:
            return await self._scenes.on_propose(packet, peer)
        proposer = node_of(peer)
        try:
            if packet.genesis != self._genesis:
                raise Refused(RejectReason.ILL_FORMED, "it is for the log of another cluster")
            if self._voter is None:
                raise Refused(RejectReason.NOT_MY_LOCATION, "the cluster's log is decided elsewhere")
            if proposer is None or not self.registry.position:
                reason = RejectReason.NOT_AUTHORISED if proposer is None else RejectReason.NOT_READY
                raise Refused(reason, "only nodes propose to the cluster's log, once it has begun")
            record = LogRecord.decode(packet.private)
            position = await self._voter.decide(record.entry, record.request_id, proposer)
        except MalformedPacket as problem:
            return self._refuse(peer, RejectReason.ILL_FORMED, problem)
        except Refused as refusal:
            return self._refuse(peer, refusal.reason, refusal)
        return accepted(position, self._copy.hash_at(position))

    def _refuse(self, peer: str, reason: RejectReason, problem: Exception) -> Packet:
        self._quiet.say(self._world.clock.now(), peer, reason.name, f"a proposal is refused: {problem}")
        return rejected(reason, self._facts.voter)

    async def _on_request(self, packet: RequestSceneLog, peer: str) -> Packet | None:
        if (packet.scene != self._scene or packet.want is Want.DECIDED) and self._scenes is not None:
            return await self._scenes.on_request(packet, peer)
        if packet.genesis not in (b"", self._genesis):
            return RespondSceneLog(answer=None)
        asker = node_of(peer)
        if asker is not None:
            self._pusher.note(asker, min(packet.have, self.registry.position))
        is_granted = False
        if packet.want is Want.LEASE:
            if self._voter is None or asker is None:
                raise Refused(RejectReason.NOT_MY_LOCATION, "owner leases are granted to nodes, by the voter")
            is_granted = await self._voter.grant(packet, asker)
        have = None if packet.want is Want.HEADER or is_granted else packet.have
        return RespondSceneLog(answer=self._copy.answer(packet.nonce, have, is_granted=is_granted))

    async def _on_push(self, packet: RespondSceneLog, peer: str) -> None:
        answer, source = packet.answer, node_of(peer)
        if answer is None or answer.public.scene != self._scene:
            if self._scenes is not None:
                await self._scenes.on_push(packet, peer)
        elif source is not None:
            await self._puller.take(answer, source)

    def _push_from(self, have: int) -> RespondSceneLog:
        return RespondSceneLog(answer=self._copy.answer(0, have))
