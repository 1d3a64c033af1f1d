"""Whole nodes of a simulated cluster that decide a scene's log together, and an owner of the scene who asks any of them."""

from __future__ import annotations

import itertools
from collections.abc import Awaitable, Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from typing import Any

import trio

from scenefold.base.errors import Refused
from scenefold.client.births import born, first_header, first_private, kept_keys
from scenefold.crypto import SealingKey
from scenefold.peer import NodeContext
from scenefold.scene.log import Decider, Followed, check_decided, follow, keys_with_log, open_private
from scenefold.simulation.cluster import Cluster, Habits, Node
from scenefold.simulation.logs import quiet_logs
from scenefold.simulation.speed import remembered_signatures
from scenefold.wire import (
    AcceptSceneProposal,
    AddParticipant,
    KeyEntry,
    LogEntry,
    Packet,
    ParticipantEntry,
    ProposeSceneLog,
    RejectSceneProposal,
    RemoveParticipant,
    RequestSceneLog,
    RespondSceneLog,
    SceneLogPublic,
    Want,
)
from scenefold.world.ports import ConnectionLost, DiskFailed
from scenefold.world.sim import SimNet, run_simulated
from unit.scene.log.members import MAKER, grant, secrets_of

USER = "user:m200"
START_S_MAX = READ_S_MAX = 60.0


@dataclass
class Read:
    """A scene's log as a node shows it, opened."""

    public: SceneLogPublic
    private: bytes
    log: Any


class Assembly:
    """`count` nodes; the first is the cluster's voter, and so the origin of all scenes."""

    def __init__(self, cluster: Cluster, nursery: trio.Nursery) -> None:
        self.cluster, self.nursery = cluster, nursery
        self._numbers = itertools.count(1)

    # ------------------------------------------------------------------------------------------------------- nodes

    def node(self, slot: int) -> Node:
        return self.cluster.nodes[slot]

    def of(self, slot: int) -> NodeContext:
        context = self.node(slot).context
        assert context is not None, f"n{slot} does not run"
        return context

    def crash(self, *slots: int) -> None:
        for slot in slots:
            self.cluster.crash(slot)

    async def start(self, *slots: int) -> None:
        """Let them run, and return once they have joined."""
        for slot in slots:
            await self.node(slot).gone.wait()
            self.cluster.start(slot)
        for slot in slots:
            await self.until(lambda slot=slot: self.node(slot).context is not None)
            with trio.fail_after(START_S_MAX):
                await self.of(slot).joined.wait()

    async def until(self, holds: Callable[[], bool], within_s: float = 60.0) -> None:
        with trio.fail_after(within_s):
            while not holds():  # noqa: ASYNC110 - what it waits for is in several nodes, which tell nobody
                await trio.sleep(0.05)

    def entry(self, slot: int) -> ParticipantEntry:
        """The node as one who may take part."""
        own = self.of(slot).own
        return ParticipantEntry(own.member, own.key.public.raw)

    def added(self, slot: int) -> AddParticipant:
        entry = self.entry(slot)
        return AddParticipant(entry.member, entry.key)

    # ------------------------------------------------------------------------------------------------------- scene

    async def create(self, *slots: int) -> None:
        """A scene that these decide from position 2 on."""
        voter = self.of(0).own
        self.origin = origin = Decider(voter.me, voter.key.public.raw)
        maker = secrets_of(200)
        kept = born("kitchen", MAKER, maker.signing, origin, self._token)
        self.keys = kept_keys(kept, maker.sealing)
        first = [self.entry(slot) for slot in slots]
        header = first_header(kept, self.keys, MAKER, origin, first)
        assert header is not None
        self.scene, self.genesis = header.scene, header.genesis
        private = first_private(self.keys, MAKER, origin, first)
        self.first = ProposeSceneLog(header.genesis, header, private)
        reply = await self.ask(0, self.first)
        assert isinstance(reply, AcceptSceneProposal), reply
        await self.until(lambda: all(self.takes_part(slot) for slot in slots))

    def takes_part(self, slot: int) -> bool:
        one = self.of(slot).participation.of(self.scene)
        return one is not None and one.takes_part

    def position(self, slot: int) -> int:
        """How far a node knows the scene, by what it tells others."""
        known = self.of(slot).scenes.here(self.scene)
        return 0 if known is None else known.public.position

    async def everybody_at(self, position: int, *slots: int, within_s: float = 60.0) -> None:
        await self.until(lambda: all(self.position(slot) == position for slot in slots), within_s)

    async def ask(self, slot: int, packet: Packet, peer: str = USER) -> Packet | None:
        return await self.of(slot).handlers.handle(packet, peer)

    async def read(self, slot: int) -> Read:
        """What an owner finds at this node. Who has just begun to take part knows the header before it has the log: that is waited for."""
        private: bytes | None = None
        with trio.fail_after(READ_S_MAX):
            while True:
                reply = await self.ask(slot, RequestSceneLog(self.scene, self.genesis, 0, 1, Want.LOG))
                assert isinstance(reply, RespondSceneLog) and reply.answer is not None, reply
                public, private = reply.answer.public, reply.answer.private
                if private is not None:
                    break
                await trio.sleep(0.05)
        check_decided(public)
        log = open_private(
            private,
            genesis=self.genesis,
            position=public.position,
            symmetric_key=self.keys.epochs[public.key_epoch],
            header_key=self.keys.header_key,
            header_keyed_at=1,
        )
        self.keys = keys_with_log(self.keys, log.state)
        return Read(public, private, log)

    def following(self, read: Read, entry: LogEntry, request: bytes = b"") -> Followed:
        """What an owner makes of it."""
        record = read.log.state.next_record(entry, request or self._token(16), self.origin.node)
        return follow(read.public, read.log, record, self.keys, secrets_of(200).signing, self._token).sealed()

    async def offer(self, slot: int, offered: Followed, *, forced: bool = False) -> AcceptSceneProposal | RejectSceneProposal:
        reply = await self.ask(slot, ProposeSceneLog(self.genesis, offered.header, offered.private, forced))
        assert isinstance(reply, AcceptSceneProposal | RejectSceneProposal), reply
        if isinstance(reply, AcceptSceneProposal):
            check_decided(replace(offered.header, decision=reply.decision))
        return reply

    async def offer_in_vain(self, slot: int, offered: Followed) -> None:
        """Whoever is asked may die over it."""
        with suppress(Refused, DiskFailed, ConnectionLost):
            await self.offer(slot, offered)

    async def change(self, slot: int, entry: LogEntry | None = None, *, forced: bool = False) -> AcceptSceneProposal | RejectSceneProposal:
        """One more entry, made from what this node shows, and offered there."""
        return await self.offer(slot, self.following(await self.read(slot), entry or self.grant()), forced=forced)

    async def commits(self, slot: int, entry: LogEntry | None = None, tries: int = 20) -> int:
        """As an owner who does not give up; gives the position."""
        for _ in range(tries):
            try:
                reply = await self.change(slot, entry)
            except Refused:
                continue
            if isinstance(reply, AcceptSceneProposal):
                return reply.position
            await trio.sleep(0.3)
        raise AssertionError(f"not decided: {reply}")

    def grant(self) -> LogEntry:
        number = next(self._numbers) % 100 + 1
        # One of its own: of two scalars that differ in the highest bits alone the keys are the same, the maker's among them.
        sealing = SealingKey(bytes([0, number]) + bytes(30)).public.raw
        return grant(number, sealing=KeyEntry(1, sealing))

    def removed(self, slot: int) -> RemoveParticipant:
        return RemoveParticipant(self.entry(slot).member)

    def _token(self, count: int) -> bytes:
        return next(self._numbers).to_bytes(8, "big").rjust(count, b"\x5a")[-count:]


def assembled(count: int, main: Callable[[Assembly], Awaitable[None]], seed: int = 1, *, silent: bool = True, **net: Any) -> None:
    """`main` with such a cluster, which runs and is at rest; nothing may break a law meanwhile."""
    with ExitStack() as stack:
        if silent:
            stack.enter_context(quiet_logs())
        stack.enter_context(remembered_signatures())
        run_simulated(seed, _play, count, main, seed, net, virtual_s_max=2_000.0, wall_s_max=240.0)


async def _play(count: int, main: Callable[[Assembly], Awaitable[None]], seed: int, net: dict[str, Any]) -> None:
    async with trio.open_nursery() as nursery:
        cluster = Cluster(SimNet(seed, **net), count, 0, nursery, Habits(remove_after_s=None))
        them = Assembly(cluster, nursery)
        await them.start(*range(count))
        await main(them)
        assert not cluster.watch.violations, cluster.watch.violations
        nursery.cancel_scope.cancel()
