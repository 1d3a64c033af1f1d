"""The cluster's own log as a service: kept, pulled, pushed, proposed to (design: consensus §3, specs/15-cluster-log.md).

It is a scene by its packets (5 to 9), reserved by its id: the one that the genesis header of the cluster's facts gives. At first one
node decides alone, by the log's key (log_voter.py); once voters are named they do, by votes (voting.py). Everybody else proposes to
them, takes pushes, and pulls whenever somebody shows a higher log position than ours, or after SYNC_S without news. A record counts once
it is verified and durable here, in that order, and only then does the rest of the node act on it.
"""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable

import trio

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Decide
from scenefold.crypto import SigningKey
from scenefold.peer.cluster_log.asking_voters import AskingVoters
from scenefold.peer.cluster_log.founding import found
from scenefold.peer.cluster_log.lives import Lives
from scenefold.peer.cluster_log.log_answers import LogAnswers, SceneLogs
from scenefold.peer.cluster_log.log_copy import LogCopy
from scenefold.peer.cluster_log.log_packets import GRANT, lease_question
from scenefold.peer.cluster_log.log_pull import LogPuller
from scenefold.peer.cluster_log.log_spread import LogPusher
from scenefold.peer.cluster_log.log_voter import Veto, Voter
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.cluster_log.voted_log import Ports
from scenefold.peer.cluster_log.voting import Voting
from scenefold.peer.handlers import Handlers
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.peers import Peers
from scenefold.peer.timing import LEASE_ASK_S_MAX
from scenefold.store import Store
from scenefold.wire import (
    LogEntry,
    RespondSceneLog,
    SignedRecord,
)
from scenefold.world import Priority, World
from scenefold.world.facts import ClusterFacts

_log = logging.getLogger("scenefold.peer.cluster_log.cluster_log")


async def _keeps_key() -> None:
    """Where nobody keeps it on a disk."""


class ClusterLog:
    """The log as this node knows it. Used from the Trio thread only; `log_key` on the voter until it is given up, None elsewhere."""

    def __init__(
        self, world: World, store: Store, peers: Peers, facts: ClusterFacts, own: OwnStatus, ports: Ports, log_key: SigningKey | None = None
    ) -> None:
        self._world, self._peers, self._facts, self._own = world, peers, facts, own
        self._copy = LogCopy(world, store, facts, self._note_position)
        own.is_registered = False
        self.voting = Voting(world, store, peers, facts, own, ports)
        """What is about votes."""
        self.voting.voted.heard = self._has_decided
        self._puller = LogPuller(world, peers, facts, self._copy, own.me)
        self._puller.by_votes = self.voting
        self._voter = None if log_key is None else Voter(world, store, facts, log_key, lambda: self.registry, self._commit)
        self._pusher = LogPusher(world.clock, peers, lambda: self._copy.position, self._push_from)
        self._asking = AskingVoters(world, peers, facts, own.me, lambda: self.registry, self._decide, self._learnt_from)
        self._answers = LogAnswers(
            world.clock, facts, own.me, self._copy, self.voting, self._voter, self._puller, self._pusher, self._decide
        )
        self.forget_key: Callable[[], Awaitable[None]] = _keeps_key
        """Erases the log's key, which counts no more."""

    # ------------------------------------------------------------------------------------------------- questions

    @property
    def registry(self) -> Registry:
        return self._copy.registry

    @property
    def is_by_votes(self) -> bool:
        """Whether the log's key has given way to votes, as far as is known here."""
        return bool(self.registry.voting.councils)

    @property
    def grants_leases(self) -> bool:
        """Whether this node decides the log, alone or as one of several, and may grant leases."""
        return self.voting.grants_leases if self.is_by_votes else self._own.me in self.registry.voters

    async def changed_after(self, position: int) -> Registry:
        """The registry once it is of a later position."""
        return await self._copy.changed_after(position)

    def learnt_at(self, position: int) -> float:
        """Local time when this node learnt a record; its start for those that it knew before."""
        return self._copy.learnt_at(position)

    def lapsed(self) -> list[NodeId]:
        """At a voter: members that hold no lease any more, as far as it has granted them. Elsewhere nobody."""
        if self.is_by_votes:
            return self.voting.elector.lapsed(self.learnt_at)
        return [] if self._voter is None else self._voter.lapsed(self.learnt_at)

    def leased_at(self, node: NodeId) -> float | None:
        """At a voter: local time of the newest lease of a node since this start, as far as it has granted it."""
        if self.is_by_votes:
            return self.voting.voted.desk.leased_at(node) if self.voting.is_open else None
        return None if self._voter is None else self._voter.leased_at(node)

    @property
    def veto(self) -> Veto | None:
        return self.voting.elector.veto

    @veto.setter
    def veto(self, veto: Veto | None) -> None:
        self.voting.elector.veto = veto
        if self._voter is not None:
            self._voter.veto = veto

    # ---------------------------------------------------------------------------------------------------- running

    def register(self, handlers: Handlers, scenes: SceneLogs | None = None) -> None:
        """Answer packets 5, 6 and 118; those of other logs are handed to `scenes`."""
        self._answers.scenes = scenes
        self._answers.register(handlers)

    async def load(self) -> None:
        """Take what this node kept from before. DamagedData if it does not verify any more."""
        await self._copy.load()
        if self._voter is not None and self._copy.position and not self.is_by_votes:
            self._copy.header = self._voter.header(self._copy.position)
        if self.is_by_votes:
            await self._open()

    async def _open(self) -> None:
        await self.voting.voted.open(self._copy.registry)
        self._copy.follow(self.voting.voted.registry)

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        """Keep the log fresh until cancelled; a voter begins it if nobody has one."""
        async with trio.open_nursery() as nursery:
            await nursery.start(self._pusher.run)
            nursery.start_soon(self._go_by_votes)
            task_status.started()
            if self._voter is not None and not self.is_by_votes:
                await self._puller.ask_around(self._facts.founders)
            if self._voter is not None and not self.is_by_votes:
                await found(self._world.clock, self._facts, self._voter)
                self._pusher.wake(self._puller.others(self.registry.members))
            await self._puller.run(is_asked_for_news_only=self._voter is not None)

    async def _go_by_votes(self) -> None:
        """Once the log's key has given way, which is erased then where it was."""
        while not self.is_by_votes:
            await self.changed_after(self.registry.position)
        if not self.voting.is_open:
            await self._open()
        if self._voter is not None:
            try:
                await self.forget_key()
            except (LocalFault, OSError) as problem:
                _log.error("the log's key counts no more, and could not be erased: %s", problem)
        await self.voting.run()

    def heard_of(self, node: NodeId, position: int) -> None:
        """A node says that its log has come to this position."""
        self._puller.heard_of(node, position)

    async def pull(self, at_least: int = 0) -> None:
        """Ask others for what this node lacks, until it has this position (0: until one has answered)."""
        await self._puller.pull(at_least)

    async def pull_from(self, node: NodeId) -> None:
        """Ask a node for what it says that it knows and this one lacks. No others: who claims more than there is gains nothing."""
        await self._puller.pull_from(node)

    # ------------------------------------------------------------------------------------------------- proposing

    async def propose(self, entry: LogEntry, request_id: bytes | None = None) -> int:
        """Have an entry committed; its position, once this node knows it too.

        Refused with the reason: then it never will be in the log. Unreachable: it may be, or come there; whoever
        proposes it again with the same `request_id` (16 bytes) gets it committed once.
        """
        request = self._world.entropy.token(16) if request_id is None else request_id
        if self._voter is not None and not self.is_by_votes:
            return await self._voter.decide(entry, request, self._own.me)
        return await self._asking.propose(entry, request)

    async def _decide(self, entry: LogEntry, request_id: bytes, proposer: NodeId) -> int:
        """Here, by whatever this node decides by."""
        if self.is_by_votes:
            return await self.voting.elector.decide(entry, request_id, proposer)
        if self._voter is None:
            raise Refused(RejectReason.NOT_MY_LOCATION, "the cluster's log is decided elsewhere")
        return await self._voter.decide(entry, request_id, proposer)

    async def _learnt_from(self, voter: NodeId, position: int) -> Registry:
        """The log up to a position that a voter told."""
        await self.pull_from(voter)
        if self.registry.position < position:
            await self.pull(at_least=position)
        return await self.changed_after(position - 1)

    async def ask_lease(self, lives: Lives) -> bool:
        """Ask the one voter for an owner lease. False: not now, and this node may be wiser about the log by it.

        Refused: 18 for an incarnation that was removed or a restored backup, 12 for one that is no member; Unreachable.
        """
        nonce = int.from_bytes(self._world.entropy.token(8), "big")
        packet = lease_question(self._own, self._facts, self.registry, nonce, lives)
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

    def _has_decided(self, registry: Registry, decided: Decide) -> None:
        """By votes. Who voted hears it from whoever began it (25-consensus); so do all others."""
        deciding = self.registry.voters
        self._copy.follow(registry)
        if decided.certificate.ballot.node == self._own.me:
            self._pusher.wake(node for node in self._puller.others(registry.members) if node not in (*deciding, *registry.voters))

    def _note_position(self, position: int) -> None:
        self._own.log_position = position
        self._own.is_registered = self.registry.is_current(self._own.member)

    def _push_from(self, have: int) -> RespondSceneLog:
        if self.voting.is_open and have >= self._copy.signed:
            return RespondSceneLog(None, self.voting.voted.recent(have))
        return RespondSceneLog(answer=self._copy.answer(0, have))
