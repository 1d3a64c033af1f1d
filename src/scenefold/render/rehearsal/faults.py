"""A pool in one process whose packets without an answer are lost, doubled and late, as those of an unreliable network are.

All that rides on links is treated so, and what acknowledges it; packets that have an answer are not.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import trio

from scenefold.base.errors import Unreachable
from scenefold.base.ids import NodeId
from scenefold.render.rehearsal.pool import MemoryPool, Records
from scenefold.wire import Packet
from scenefold.world import World

LATE_S_MAX = 0.05


@dataclass(frozen=True, slots=True)
class Faults:
    """Shares of packets that are lost and doubled; and of those that are late, which others overtake."""

    lost: float = 0.0
    doubled: float = 0.0
    late: float = 0.0


class FaultyPool(MemoryPool):
    """Carries packets that have no answer as an unreliable network does."""

    def __init__(self, world: World, records: Records, count: int, faults: Faults = Faults(), seed: int = 9) -> None:
        super().__init__(world, records, count)
        self.faults = faults
        self.chance = random.Random(seed)
        self.carried: Counter[str] = Counter()
        """By the names of packets."""
        self.dropped: Counter[str] = Counter()
        self.on_carry: Callable[[Packet], object] = lambda _packet: None
        """Called with each packet that is sent so."""

    async def carry(self, peer: str, node: NodeId, packet: Packet) -> None:
        name = type(packet).__name__
        self.carried[name] += 1
        self.on_carry(packet)
        await trio.lowlevel.checkpoint()
        if self.faults == Faults():
            # In their order.
            await super().carry(peer, node, packet)
            return
        for _ in range(1 + (self.chance.random() < self.faults.doubled)):
            if self.chance.random() < self.faults.lost:
                self.dropped[name] += 1
            else:
                self.nursery.start_soon(self._arrive, peer, node, packet, self.chance.random() < self.faults.late)

    async def _arrive(self, peer: str, node: NodeId, packet: Packet, is_late: bool) -> None:
        if is_late:
            await trio.sleep(LATE_S_MAX * self.chance.random())
        try:
            await super().carry(peer, node, packet)
        except Unreachable:
            # Who has sent it hears nothing of that.
            self.dropped[type(packet).__name__] += 1
