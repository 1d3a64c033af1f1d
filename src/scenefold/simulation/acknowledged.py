"""Each write that a simulated node acknowledges, a client's or a stray's, seen at the moment at which it answers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from scenefold.base.location import Location
from scenefold.peer import NodeContext
from scenefold.simulation.history import Place, Version
from scenefold.simulation.recording import named
from scenefold.simulation.watch import Watch
from scenefold.wire import HandItem, HandRecords, Packet, PutItem, PutManyReply, PutOutcome

Seen = Callable[[PutItem | HandItem, Location], None]


class Eyes(Protocol):
    """Who looks on at what nodes answer, beside the watch."""

    def comes_up(self, slot: int, context: NodeContext, /) -> None: ...

    def taken(self, slot: int, place: Place, version: Version, /) -> None:
        """A node acknowledges a record to its author."""


def judge_acknowledged(
    context: NodeContext, slot: int, is_alive: Callable[[], bool], watch: Watch, eyes: Callable[[], Eyes | None]
) -> None:
    """Have each record judged that this life of a node acknowledges from now on, while it is the one that lives."""

    def acknowledged(item: PutItem | HandItem, location: Location) -> None:
        if not is_alive():
            return
        place, version = named(item)
        watch.acknowledges(slot, place, version, location)
        if isinstance(item, HandItem):
            watch.homecoming.answered(slot, place, version)
        elif (also := eyes()) is not None:
            also.taken(slot, place, version)

    see_acknowledged(context, acknowledged)


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
