"""Somebody who sees to it that a scene has participants: he names the first, replaces those that lost their disks, and moves the others about.

Always one at a time, and none is taken away for no reason while there are not more than there were at first: so a majority that lives stays one.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Collection, Sequence

import trio

from scenefold.base.ids import NodeId
from scenefold.simulation.cluster import Cluster, Node
from scenefold.simulation.disks import incarnation_of
from scenefold.simulation.log_history import Told
from scenefold.simulation.log_work import LogClient
from scenefold.wire import AddParticipant, Batch, Member, RemoveParticipant

BETWEEN_S = ((2.0, 9.0), (12.0, 40.0))
"""By the seed: where somebody was removed lately a mode becomes active late, so in every second one that is rare."""
MOVES = 0.5
"""Odds that he changes something although nothing is to be mended."""


class Steward:
    """`slots`: who may take part at all; `count`: how many shall; `apart`: who does otherwise, and cannot decide."""

    def __init__(
        self, cluster: Cluster, client: LogClient, seed: int, slots: Sequence[int], count: int, apart: Callable[[], Collection[NodeId]]
    ) -> None:
        self._cluster, self._client, self._slots, self._count, self._apart = cluster, client, slots, count, apart
        self._dice = random.Random(f"steward/{seed}")
        self._between_s = BETWEEN_S[seed % len(BETWEEN_S)]
        self.changes = 0

    async def found(self, slots: Sequence[int]) -> bool:
        """The first participants, all at once: the origin lets go of the log."""
        entries = tuple(_added(self._cluster.nodes[slot]) for slot in slots)
        return await self._client.want(lambda _: Batch(entries)) is Told.COMMITTED

    async def run(self, stop: trio.Event) -> None:
        """Until told to stop; a change that has begun is ended, or given up."""
        while not stop.is_set():
            await trio.sleep(self._dice.uniform(*self._between_s))
            change = self._change(self._client.watch.participants())
            if change is not None:
                self.changes += await self._client.want(lambda _, change=change: change) is Told.COMMITTED  # type: ignore[misc]

    def _change(self, members: Sequence[Member]) -> AddParticipant | RemoveParticipant | None:
        nodes = [self._cluster.nodes[self._cluster.slot_of(member.node)] for member in members]
        lost = [member for member, node in zip(members, nodes, strict=True) if not is_fit(node) or member_of(node) != member]
        free = [node for slot in self._slots if (node := self._cluster.nodes[slot]).node_id not in self._apart()]
        others = [node for node in free if node not in nodes and is_fit(node) and node.context is not None]
        if lost and len(members) > 1:
            return RemoveParticipant(lost[0])
        if others and len(members) < self._count:
            return _added(self._dice.choice(others))
        if self._dice.random() >= MOVES:
            return None
        if len(members) > self._count:
            return RemoveParticipant(self._dice.choice(list(members)))
        return _added(self._dice.choice(others)) if others else None


def is_fit(node: Node) -> bool:
    """Whether it will go on living with the disk that it has."""
    return not (node.is_lost or node.has_left or node.told_to_leave) and incarnation_of(node.disk) is not None


def member_of(node: Node) -> Member:
    """The life that it leads by its disk."""
    return Member(node.node_id, incarnation_of(node.disk) or b"")


def _added(node: Node) -> AddParticipant:
    return AddParticipant(member_of(node), node.secrets.signing.public.raw)
