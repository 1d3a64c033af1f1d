"""A node gets what it lacks of the cluster's log from whoever has it (specs/15-cluster-log.md, Learning).

It asks when somebody claims a higher position than its own, and once SYNC_S have passed since it last heard that there is
no higher one (a lease is granted with this word); first who claims it, then the
voter, then others, since a voter that is away or unreachable from here may well have told them. Whoever claims what nobody
can show is not heeded for a while, so that one member cannot keep all others asking.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable
from typing import Protocol

import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.log_copy import LogCopy
from scenefold.peer.peers import Peers
from scenefold.peer.timing import LOG_ASK_S_MAX, PULL_PAUSE_S, SYNC_S, VOTER_PATIENCE_S
from scenefold.wire import MalformedPacket, RequestSceneLog, RespondSceneLog, SceneLogAnswer, Want
from scenefold.world import Priority, World
from scenefold.world.facts import ClusterFacts
from scenefold.world.quiet import QuietLog

CLAIMANTS_MAX = 2
SYNC_S_MIN = 0.1
"""Between two looks whether it is time: the two clocks that are involved may run at different rates."""
WITNESSES_MAX = 16
"""Nodes that a starting voter asks whether they know more than itself."""
SOURCES_MAX = 8
"""Nodes that one pull asks, one after the other."""

_log = logging.getLogger("scenefold.peer.cluster_log.cluster_log")


class ByVotes(Protocol):
    """The log behind the newest record of its key (voting.py)."""

    @property
    def is_open(self) -> bool: ...

    async def pull_from(self, node: NodeId) -> bool: ...


class LogPuller:
    """Keeps a copy fresh. One pull at a time."""

    def __init__(self, world: World, peers: Peers, facts: ClusterFacts, copy: LogCopy, me: NodeId) -> None:
        self._world = world
        self._peers = peers
        self._facts = facts
        self._copy = copy
        self._me = me
        self._pulling = trio.Lock()
        self._claims: dict[NodeId, int] = {}
        self._claimed = trio.Event()
        self._in_vain_at: dict[NodeId, float] = {}
        """When we last asked all round for what a node claims, and did not get it."""
        self._confirmed_at = -math.inf
        self._quiet = QuietLog(_log)
        self.by_votes: ByVotes | None = None
        """Who learns what votes have decided."""

    def heard_of(self, node: NodeId, position: int) -> None:
        """A node says that its log has come to this position."""
        if position > self._copy.position and self._is_heeded(node):
            self._claims[node] = position
            self._claimed.set()
            self._claimed = trio.Event()

    def confirmed(self) -> None:
        """The voter has just said that this node has the newest record: there is nothing to ask for."""
        self._confirmed_at = self._world.clock.now()

    async def run(self, *, is_asked_for_news_only: bool) -> None:
        """Pull until cancelled; with `is_asked_for_news_only`, on the voter, only if somebody claims to know more."""
        while True:
            if self._copy.position:
                await self._due()
            # Behind the log's key the log itself asks once in a while (peer/logs).
            if self._claims or not (is_asked_for_news_only or self._is_by_votes()):
                await self.pull()
            await self._world.clock.sleep(PULL_PAUSE_S)

    async def _due(self) -> None:
        """Return once somebody claims to know more, or SYNC_S after the last certainty that nobody does."""
        begin = self._world.clock.now()
        while not self._claims and (rest_s := max(begin, self._confirmed_at) + SYNC_S - self._world.clock.now()) > 0:
            with trio.move_on_after(max(rest_s, SYNC_S_MIN)):
                await self._claimed.wait()
                return

    async def pull(self, at_least: int = 0) -> None:
        """Ask others for what this node lacks, until it has this position (0: until one has answered)."""
        async with self._pulling:
            wanted = max([at_least, *self._claims.values()])
            for node in self._sources():
                if wanted and self._copy.position >= wanted:
                    break
                if await self.pull_from(node) and not wanted:
                    break
            # Who still claims more will say so again; one that cannot show it must not be asked for ever.
            now = self._world.clock.now()
            vain = {node: now for node, position in self._claims.items() if position > self._copy.position}
            self._in_vain_at = {node: at for node, at in self._in_vain_at.items() if now - at < SYNC_S} | vain
            self._claims.clear()

    def _is_heeded(self, node: NodeId) -> bool:
        """Whether a claim counts: the voter's always does, since nobody else could know of its last word."""
        return node in self._voters or self._world.clock.now() - self._in_vain_at.get(node, -math.inf) >= SYNC_S

    async def pull_from(self, node: NodeId) -> bool:
        """Take all that a node has; whether it answered with a log."""
        if self.by_votes is not None and self.by_votes.is_open:
            return await self.by_votes.pull_from(node)
        genesis = self._facts.genesis_header
        while True:
            have = self._copy.position
            request = RequestSceneLog(genesis.scene, genesis.genesis, have, 0, Want.LOG)
            try:
                answer = (await self._peers.ask(node, Priority.HIGH, request, RespondSceneLog, LOG_ASK_S_MAX)).answer
            except (Unreachable, Refused, PeerFault) as problem:
                _log.debug("the cluster's log is not told by %s: %s", address_of(node), problem)
                return False
            if answer is None or not await self.take(answer, node) or self._copy.position in (have, answer.position):
                return answer is not None

    async def take(self, answer: SceneLogAnswer, source: NodeId) -> bool:
        """Take the part of the log that an answer or a push brings; False, with a word in the log, if it must not be taken."""
        try:
            await self._copy.install(answer)
        except (MalformedPacket, DamagedData, Refused) as problem:
            if isinstance(problem, Refused) and problem.reason is RejectReason.PEER_MISSED:
                self.heard_of(source, answer.position)
            elif isinstance(problem, Refused) and problem.reason is RejectReason.NOT_READY:
                # Our own store is closing: this node ends, and there is nothing wrong with that log.
                _log.debug("the log of %s is not taken: %s", address_of(source), problem)
            else:
                self._quiet.say(self._world.clock.now(), address_of(source), "log", f"its log is not taken: {problem}")
            return False
        return True

    async def ask_around(self, founders: Iterable[NodeId]) -> None:
        """Whether others know more than this voter: its disk may be an older one, or a new one."""
        witnesses = self.others((*self._copy.registry.members, *founders))[:WITNESSES_MAX]
        with trio.move_on_after(VOTER_PATIENCE_S):
            async with trio.open_nursery() as nursery:
                for node in witnesses:
                    nursery.start_soon(self.pull_from, node)

    def others(self, nodes: Iterable[NodeId]) -> list[NodeId]:
        """These nodes without this one, each once."""
        return [node for node in dict.fromkeys(nodes) if node != self._me]

    @property
    def _voters(self) -> tuple[NodeId, ...]:
        """Who decides the log, as far as is known here."""
        return self._copy.registry.voters if self._is_by_votes() else (self._facts.voter,)

    def _is_by_votes(self) -> bool:
        return bool(self._copy.registry.voting.councils)

    def _sources(self) -> list[NodeId]:
        """Whom to ask: who claims most, the voter, then others, not always the same ones."""
        claimants = sorted(self._claims, key=lambda node: (-self._claims[node], node))
        rest = self.others((*self._copy.registry.members, *self._facts.founders))
        start = int(self._world.entropy.uniform() * len(rest)) if rest else 0
        return self.others((*claimants[:CLAIMANTS_MAX], *self._voters, *rest[start:], *rest[:start]))[:SOURCES_MAX]
