"""The cluster's own log as a service: kept, pulled, pushed, proposed to (design: consensus §3, specs/15-cluster-log.md).

It is a scene by its packets (5 to 9), reserved by its id: the one that the genesis header of the cluster's facts gives. For
now one node votes and decides alone (log_voter.py). Everybody else proposes to it, takes its pushes, and pulls whenever
somebody shows a higher log position than ours, or after SYNC_S without news. A record counts once it is verified and
durable here, in that order, and only then does the rest of the node act on it.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from typing import Protocol

import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.crypto import HEADER_DOMAIN, LEASE_DOMAIN, SigningKey
from scenefold.peer.handlers import Handlers, Senders, node_of
from scenefold.peer.log_book import LogBook, verified
from scenefold.peer.log_packets import GRANT, accepted, answer_of, proposal_of, rejected
from scenefold.peer.log_rules import lease_message
from scenefold.peer.log_spread import LogPusher
from scenefold.peer.log_voter import Veto, Voter
from scenefold.peer.peers import Peers
from scenefold.peer.registry import Registry
from scenefold.peer.status import OwnStatus
from scenefold.peer.timing import (
    LEASE_ASK_S_MAX,
    LOG_ASK_S_MAX,
    PROPOSE_ASK_S_MAX,
    PROPOSE_RETRY_S,
    PROPOSE_S_MAX,
    PULL_PAUSE_S,
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
    SceneLogAnswer,
    SceneLogPublic,
    SignedRecord,
    Want,
    unpack_log,
)
from scenefold.world import Priority, World
from scenefold.world.facts import ClusterFacts
from scenefold.world.quiet import QuietLog

SOURCES_MAX = 8
"""Nodes that one pull asks, one after the other."""
WITNESSES_MAX = 16
"""Nodes that a starting voter asks whether they know more than itself."""

_log = logging.getLogger("scenefold.peer.cluster_log")


class SceneLogs(Protocol):
    """Who handles the same packets for scenes' logs."""

    async def on_propose(self, packet: ProposeSceneLog, peer: str) -> Packet: ...
    async def on_request(self, packet: RequestSceneLog, peer: str) -> Packet: ...
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
        self._book = LogBook(store)
        self._registry = Registry()
        self._header: SceneLogPublic | None = None
        self._learnt: list[float] = []
        self._news = trio.Event()
        self._writing = trio.Lock()
        self._pulling = trio.Lock()
        self._claims: dict[NodeId, int] = {}
        self._claimed = trio.Event()
        self._quiet = QuietLog(_log)
        self._voter = None if log_key is None else Voter(world, store, facts, log_key, lambda: self._registry, self._commit)
        self._pusher = LogPusher(world.clock, peers, lambda: self._registry.position, self._push_from)
        self._scenes: SceneLogs | None = None

    # ------------------------------------------------------------------------------------------------- questions

    @property
    def registry(self) -> Registry:
        return self._registry

    @property
    def is_voter(self) -> bool:
        return self._voter is not None

    async def changed_after(self, position: int) -> Registry:
        """The registry once it is of a later position."""
        while self._registry.position <= position:
            await self._news.wait()
        return self._registry

    def learnt_at(self, position: int) -> float:
        """Local time when this node learnt a record; its start for those that it knew before."""
        return self._learnt[position - 1]

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
        """Answer packets 5 to 7; those of other logs are handed to `scenes`."""
        self._scenes = scenes
        handlers.add(ProposeSceneLog, self._on_propose)
        handlers.add(RequestSceneLog, self._on_request)
        handlers.add(RespondSceneLog, self._on_push, senders=Senders.NODES)

    async def load(self) -> None:
        """Take what this node kept from before. DamagedData if it does not verify any more."""
        records = await self._book.load()
        try:
            registry, _ = await self._world.workers.run("crypto", verified, Registry(), records, self._facts.log_key)
        except (MalformedPacket, Refused) as problem:
            raise DamagedData("the stored log of the cluster does not verify", where=str(problem)) from problem
        self._header = await self._book.header()
        if self._voter is not None and registry.position:
            self._header = self._voter.header(registry.position)
        self._adopt(registry)

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        """Keep the log fresh until cancelled; a voter begins it if nobody has one."""
        async with trio.open_nursery() as nursery:
            await nursery.start(self._pusher.run)
            task_status.started()
            if self._voter is not None:
                await self._ask_around()
                founders = (self._facts.credential(node) for node in self._facts.founders)
                seats = tuple(Founder(one.node_id, one.public_key.raw, one.address) for one in founders if one is not None)
                await self._voter.found(Found(seats, self._facts.voters))
                self._pusher.wake(self._others(self._registry.members))
            await self._keep_pulling()

    def heard_of(self, node: NodeId, position: int) -> None:
        """A node says that its log has come to this position."""
        if position > self._registry.position:
            self._claims[node] = position
            self._claimed.set()

    async def _keep_pulling(self) -> None:
        while True:
            if self._registry.position:
                with trio.move_on_after(SYNC_S):
                    await self._claimed.wait()
            if self._voter is None or self._claims:
                await self.pull()
            await self._world.clock.sleep(PULL_PAUSE_S)

    async def _ask_around(self) -> None:
        """Whether others know more than this voter: its disk may be an older one, or a new one."""
        witnesses = self._others((*self._registry.members, *self._facts.founders))[:WITNESSES_MAX]
        with trio.move_on_after(VOTER_PATIENCE_S):
            async with trio.open_nursery() as nursery:
                for node in witnesses:
                    nursery.start_soon(self._pull_from, node)

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
        record = LogRecord(self._registry.position + 1, self._registry.head, request, self._own.me, entry)
        packet = proposal_of(record, self._facts)
        reply = await self._peers.ask(self._facts.voter, Priority.HIGH, packet, Packet, PROPOSE_ASK_S_MAX)
        if isinstance(reply, RejectSceneProposal):
            words = reply.reason.name.lower().replace("_", " ")
            raise Refused(reply.reason, f"the cluster's log refuses a {type(entry).__name__}: {words}", where=address_of(reply.node))
        if not isinstance(reply, AcceptSceneProposal):
            raise PeerFault(f"a proposal was answered with a {type(reply).__name__}", where=address_of(self._facts.voter))
        position = reply.proposal.position
        await self.pull(at_least=position)
        return (await self.changed_after(position - 1)).position_of(request) or position

    async def ask_lease(self, nonce: int) -> bool:
        """Ask the voter for an owner lease. False: not now, and this node may be wiser about the log by it.

        Refused: 18 for an incarnation that was removed or rolled back, 12 for one that is no member; Unreachable.
        """
        member, have = self._own.member, self._registry.position
        message = lease_message(self._genesis, have, self._registry.head, nonce, member, self._own.boot)
        proof = self._own.key.sign(LEASE_DOMAIN, message)
        packet = RequestSceneLog(self._scene, self._genesis, have, nonce, Want.LEASE, member, proof, mini_status=self._own.mini())
        if self._voter is not None:
            return await self._voter.grant(packet, self._own.me)
        answer = (await self._peers.ask(self._facts.voter, Priority.HIGH, packet, RespondSceneLog, LEASE_ASK_S_MAX)).answer
        if answer is None or answer.nonce != nonce:
            return False
        if not answer.flags & GRANT:
            await self._try_install(answer, self._facts.voter)
            return False
        return True

    # --------------------------------------------------------------------------------------------------- learning

    async def pull(self, at_least: int = 0) -> None:
        """Ask others for what this node lacks, until it has this position (0: until one has answered)."""
        async with self._pulling:
            self._claimed = trio.Event()
            wanted = max([at_least, *self._claims.values()])
            for node in self._sources():
                if wanted and self._registry.position >= wanted:
                    break
                if await self._pull_from(node) and not wanted:
                    break
            # Who still claims more will say so again; one that cannot show it must not be asked for ever.
            self._claims.clear()

    def _sources(self) -> list[NodeId]:
        """Whom to ask: who claims most, the voter, then others, not always the same ones."""
        claimants = sorted(self._claims, key=lambda node: (-self._claims[node], node))
        rest = self._others((*self._registry.members, *self._facts.founders))
        start = int(self._world.entropy.uniform() * len(rest)) if rest else 0
        chosen = dict.fromkeys([*claimants[:2], self._facts.voter, *rest[start:], *rest[:start]])
        return [node for node in chosen if node != self._own.me][:SOURCES_MAX]

    async def _pull_from(self, node: NodeId) -> bool:
        """Take all that a node has; whether it answered."""
        while True:
            have = self._registry.position
            request = RequestSceneLog(self._scene, self._genesis, have, 0, Want.LOG)
            try:
                answer = (await self._peers.ask(node, Priority.HIGH, request, RespondSceneLog, LOG_ASK_S_MAX)).answer
            except (Unreachable, Refused, PeerFault) as problem:
                _log.debug("the cluster's log is not told by %s: %s", address_of(node), problem)
                return False
            if answer is None or not await self._try_install(answer, node) or self._registry.position in (have, answer.position):
                return answer is not None

    async def _try_install(self, answer: SceneLogAnswer, source: NodeId) -> bool:
        """Take the part of the log that an answer brings; False, with a word in the log, if it must not be taken."""
        try:
            records = unpack_log(answer.private or b"\x90")
            await self._install(records, answer.public)
        except Refused as refusal:
            if refusal.reason is RejectReason.PEER_MISSED:
                self.heard_of(source, answer.position)
            else:
                self._quiet.say(self._world.clock.now(), address_of(source), "log", f"its log is not taken: {refusal}")
            return False
        except (MalformedPacket, DamagedData) as problem:
            self._quiet.say(self._world.clock.now(), address_of(source), "log", f"its log is not taken: {problem}")
            return False
        return True

    async def _install(self, records: Sequence[SignedRecord], header: SceneLogPublic) -> None:
        if header.genesis != self._genesis:
            raise Refused(RejectReason.ILL_FORMED, "it is the log of another cluster")
        self._facts.log_key.verify(header.signature, HEADER_DOMAIN, header.signable())
        async with self._writing:
            registry, fresh = await self._world.workers.run("crypto", verified, self._registry, records, self._facts.log_key)
            if fresh:
                await self._keep(fresh, header)
                self._adopt(registry)

    async def _commit(self, record: SignedRecord, registry: Registry) -> None:
        """For the voter: durable, then known, then told."""
        assert self._voter is not None
        async with self._writing:
            if registry.position != self._registry.position + 1:
                raise Refused(RejectReason.NOT_READY, "this voter has just learnt that its disk was an older one")
            await self._keep([record], self._voter.header(registry.position))
            self._adopt(registry)
        self._pusher.wake(self._others(registry.members))

    async def _keep(self, records: Sequence[SignedRecord], header: SceneLogPublic) -> None:
        # Shielded: a record that is on the disk and not in memory would be written over by the next one.
        with trio.CancelScope(shield=True):
            await self._book.append(records)
            if self._header is None or header.position > self._header.position:
                await self._book.keep_header(header)
                self._header = header

    def _adopt(self, registry: Registry) -> None:
        self._registry = registry
        now = self._world.clock.now()
        self._learnt += [now] * (registry.position - len(self._learnt))
        self._own.log_position = registry.position
        self._news.set()
        self._news = trio.Event()

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
            if proposer is None or not self._registry.position:
                reason = RejectReason.NOT_AUTHORISED if proposer is None else RejectReason.NOT_READY
                raise Refused(reason, "only nodes propose to the cluster's log, once it has begun")
            record = LogRecord.decode(packet.private)
            position = await self._voter.decide(record.entry, record.request_id, proposer)
        except MalformedPacket as problem:
            _log.info("proposal of %s refused: %s", peer, problem)
            return rejected(packet, RejectReason.ILL_FORMED, self._facts.voter)
        except Refused as refusal:
            _log.info("proposal of %s refused: %s", peer, refusal)
            return rejected(packet, refusal.reason, self._facts.voter)
        return accepted(packet, position, self._book.hash_at(position), self._own.member)

    async def _on_request(self, packet: RequestSceneLog, peer: str) -> Packet:
        if packet.scene != self._scene and self._scenes is not None:
            return await self._scenes.on_request(packet, peer)
        if packet.genesis not in (b"", self._genesis):
            return RespondSceneLog(answer=None)
        asker = node_of(peer)
        if asker is not None:
            self._pusher.note(asker, min(packet.have, self._registry.position))
        is_granted = False
        if packet.want is Want.LEASE:
            if self._voter is None or asker is None:
                raise Refused(RejectReason.NOT_MY_LOCATION, "owner leases are granted to nodes, by the voter")
            is_granted = await self._voter.grant(packet, asker)
        if self._header is None:
            return RespondSceneLog(answer=None)
        part = None if packet.want is Want.HEADER or is_granted else self._book.part(packet.have)
        return RespondSceneLog(answer=answer_of(self._header, packet.nonce, part, is_granted=is_granted))

    async def _on_push(self, packet: RespondSceneLog, peer: str) -> None:
        if packet.answer is None:
            return
        if packet.answer.public.scene != self._scene:
            if self._scenes is not None:
                await self._scenes.on_push(packet, peer)
            return
        source = node_of(peer)
        if source is not None:
            await self._try_install(packet.answer, source)

    def _push_from(self, have: int) -> RespondSceneLog:
        assert self._header is not None
        return RespondSceneLog(answer=answer_of(self._header, 0, self._book.part(have)))

    def _others(self, nodes: Iterable[NodeId]) -> list[NodeId]:
        return [node for node in dict.fromkeys(nodes) if node != self._own.me]
