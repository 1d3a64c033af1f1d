"""This node's copy of the cluster's log: verified, then durable, then known (specs/15-cluster-log.md, Learning).

Everything that makes the log longer comes through here, one at a time: what others bring (`install`) and, on the voter,
what it decides (`commit`). In memory and on disk there is always the same log, or the disk is ahead for the
length of one write, which is why that cannot be cancelled.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import trio

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.reasons import RejectReason
from scenefold.crypto import HEADER_DOMAIN
from scenefold.peer.cluster_log.log_book import LogBook, verified
from scenefold.peer.cluster_log.log_packets import answer_of
from scenefold.peer.cluster_log.registry import Registry
from scenefold.store import Store
from scenefold.wire import MalformedPacket, SceneLogAnswer, SceneLogPublic, SignedRecord, unpack_log
from scenefold.world import World
from scenefold.world.facts import ClusterFacts


class LogCopy:
    """Records, registry and header as of one position. `note_position` hears of every new one."""

    def __init__(self, world: World, store: Store, facts: ClusterFacts, note_position: Callable[[int], None]) -> None:
        self._world = world
        self._facts = facts
        self._note_position = note_position
        self._book = LogBook(store)
        self._learnt: list[float] = []
        self._news = trio.Event()
        self._writing = trio.Lock()
        self.registry = Registry()
        self.header: SceneLogPublic | None = None
        """The newest signed header that is known."""

    @property
    def position(self) -> int:
        return self.registry.position

    async def load(self) -> None:
        """Take what the disk has. DamagedData if it does not verify any more."""
        records = await self._book.load()
        try:
            registry, _ = await self._world.workers.run("crypto", verified, Registry(), records, self._facts.log_key)
        except (MalformedPacket, Refused) as problem:
            raise DamagedData("the stored log of the cluster does not verify", where=str(problem)) from problem
        self.header = await self._book.header()
        self._adopt(registry)

    async def changed_after(self, position: int) -> Registry:
        """The registry once it is of a later position."""
        while self.registry.position <= position:
            await self._news.wait()
        return self.registry

    def learnt_at(self, position: int) -> float:
        """Local time when a record became known here; the time of loading for those of before."""
        return self._learnt[position - 1]

    @property
    def signed(self) -> int:
        """How many records the log's key has signed, as far as they are here."""
        return self._book.count

    def hash_at(self, position: int) -> bytes:
        return self._book.hash_at(position)

    def answer(self, nonce: int, have: int | None, *, is_granted: bool = False) -> SceneLogAnswer | None:
        """Packet 6's body: the header, and what comes behind position `have`. None as long as nothing is known."""
        part = None if have is None else self._book.part(have)
        return None if self.header is None else answer_of(self.header, nonce, part, is_granted=is_granted)

    async def install(self, answer: SceneLogAnswer) -> None:
        """Take the part of the log that somebody brings, all of it or nothing.

        MalformedPacket, DamagedData: it does not verify. Refused: it leaves a gap (3), or does not fit, or the disk is full.
        """
        records = unpack_log(answer.private) if answer.private else ()
        if answer.public.genesis != self._facts.genesis_header.genesis:
            raise Refused(RejectReason.ILL_FORMED, "it is the log of another cluster")
        self._facts.log_key.verify(answer.public.signature, HEADER_DOMAIN, answer.public.signable())
        async with self._writing:
            registry, fresh = await self._world.workers.run("crypto", verified, self.registry, records, self._facts.log_key)
            if fresh:
                await self._keep(fresh, answer.public)
                self._adopt(registry)

    async def commit(self, record: SignedRecord, registry: Registry, header: SceneLogPublic) -> None:
        """Make the next record durable and known. Refused if another one has come meanwhile, or the disk is full."""
        async with self._writing:
            if registry.position != self.registry.position + 1:
                raise Refused(RejectReason.NOT_READY, "this voter has just learnt that its disk was an older one")
            await self._keep([record], header)
            self._adopt(registry)

    def follow(self, registry: Registry) -> None:
        """What votes decided behind the newest record of the log's key, and is durable here."""
        assert registry.position >= self.registry.position
        if registry.position > self.registry.position:
            self._adopt(registry)

    async def _keep(self, records: Sequence[SignedRecord], header: SceneLogPublic) -> None:
        # Shielded: a record that is on the disk and not in memory would be written over by the next one.
        with trio.CancelScope(shield=True):
            newer = header if self.header is None or header.position > self.header.position else None
            await self._book.append(records, newer)
            self.header = newer or self.header

    def _adopt(self, registry: Registry) -> None:
        self.registry = registry
        self._learnt += [self._world.clock.now()] * (registry.position - len(self._learnt))
        self._note_position(registry.position)
        self._news.set()
        self._news = trio.Event()
