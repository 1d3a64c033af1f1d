"""Each write that a simulated node acknowledges, a client's or a stray's, seen at the moment at which it answers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from scenefold.base.location import Location
from scenefold.peer import NodeContext
from scenefold.wire import HandItem, HandRecords, Packet, PutItem, PutManyReply, PutOutcome

Seen = Callable[[PutItem | HandItem, Location], None]


def see_acknowledged(context: NodeContext, seen: Seen) -> None:
    """Call `seen` with each record that this life of a node acknowledges from now on, and the place where it lies."""
    writes: Any = context.data.writes
    table: Any = context.handlers._table
    put: Callable[..., Any] = writes.put
    hand, senders = table[HandRecords]

    def look(items: Sequence[PutItem | HandItem], outcomes: Sequence[PutOutcome]) -> None:
        for item, outcome in zip(items, outcomes, strict=True):
            if outcome.reason == 0:
                seen(item, outcome.location)

    async def watched_put(items: list[PutItem], *of: str) -> list[PutOutcome]:
        outcomes: list[PutOutcome] = await put(items, *of)
        look(items, outcomes)
        return outcomes

    async def watched_hand(packet: HandRecords, peer: str) -> Packet:
        reply: PutManyReply = await hand(packet, peer)
        look(packet.items, reply.outcomes)
        return reply

    writes.put = watched_put
    table[HandRecords] = watched_hand, senders
