"""Sealed datagrams of one UDP port of a node: the shell around `Exchange` (specs/03-wire.md, Datagrams).

What does not count is counted by kind. What the network does by itself (repeating, holding back) is told at level info, what
somebody must have done as a warning; either at most once a minute a source.
"""

from __future__ import annotations

import logging
from collections import Counter, deque
from collections.abc import Iterable

from scenefold.base.ids import NodeId, address_of
from scenefold.crypto import SealingKey
from scenefold.peer.datagrams.exchange import Exchange, KeyOf
from scenefold.peer.datagrams.pairing import Drop, Taken
from scenefold.world import Datagrams, Priority, QuietLog, World
from scenefold.world.surviving import surviving

UNMET_FEW = 64
"""Secrets with more nodes than these at once are agreed on by a worker."""
_HARMLESS = frozenset((Drop.REPEATED, Drop.STALE, Drop.UNASKED, Drop.CROWDED))


class SealedDatagrams:
    """Packets to and from nodes that `key_of` knows. `open` comes first; each object has one life and one salt."""

    def __init__(
        self, world: World, me: NodeId, cluster_id: bytes, priority: Priority, key: SealingKey, key_of: KeyOf, log: logging.Logger
    ) -> None:
        self._world = world
        self._me = me
        self._priority = priority
        self._exchange = Exchange(me, cluster_id, int(priority is Priority.HIGH), key, key_of, world.entropy.token)
        self._quiet, self._quiet_info = QuietLog(log), QuietLog(log, logging.INFO)
        self._datagrams: Datagrams | None = None
        self._due: deque[tuple[NodeId, bytes]] = deque()
        self.dropped: Counter[str] = Counter()
        """Datagrams that did not count, by kind."""

    async def open(self) -> None:
        """LocalFault if the port cannot be had."""
        self._datagrams = await self._world.network.open_datagrams(address_of(self._me), self._priority)

    async def aclose(self) -> None:
        datagrams, self._datagrams = self._datagrams, None
        if datagrams is not None:
            await datagrams.aclose()

    @property
    def is_open(self) -> bool:
        """Whether anything can be sent."""
        return self._datagrams is not None

    async def send(self, packet: bytes, target: NodeId) -> None:
        """Send a packet to a node; to one without a key it is lost."""
        data = self._exchange.seal(target, packet)
        if data is not None:
            await self._opened().send(data, address_of(target))

    async def prepare(self, targets: Iterable[NodeId]) -> None:
        """Agree with many nodes that are about to be sent something, without holding up everything else."""
        unmet = self._exchange.unmet(targets)
        if len(unmet) > UNMET_FEW:
            secrets = await self._world.workers.run("crypto", self._exchange.agree, [key for _, key in unmet])
            for (node, key), secret in zip(unmet, secrets, strict=True):
                self._exchange.meet(node, key, secret)

    async def receive(self) -> tuple[NodeId, bytes]:
        """The next packet that counts, and who sent it. Challenges are answered on the way."""
        while not self._due:
            data, source = await self._opened().receive()
            now = self._world.clock.now()
            with surviving(self._quiet, now, source.address):
                await self._take(data, source.address, now)
        return self._due.popleft()

    async def _take(self, data: bytes, source: str, now: float) -> None:
        sender, taken = self._exchange.take(data, source, now)
        self._complain(source, taken, now)
        if sender is not None:
            self._due.extend((sender, packet) for packet in taken.packets)
            for reply in taken.replies:
                await self._opened().send(reply, address_of(sender))

    def _complain(self, source: str, taken: Taken, now: float) -> None:
        for why, text in taken.dropped:
            self.dropped[why] += 1
            quiet = self._quiet_info if why in _HARMLESS else self._quiet
            quiet.say(now, source, why, f"a datagram is dropped: {text}")

    def _opened(self) -> Datagrams:
        assert self._datagrams is not None, "open comes first"
        return self._datagrams
