"""An owner and its holders on a quiet terrace, and what the owner says to them."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import replace
from typing import Any

import trio

from scenefold.base.ids import NodeId
from scenefold.base.location import Arc, Location
from scenefold.crypto import Record
from scenefold.peer.copies.configurations import Configurations
from scenefold.peer.copies.segment import Segment
from scenefold.wire import (
    Configuration,
    CopiesStored,
    CustodyEntry,
    CustodySet,
    HeldListed,
    ListHeld,
    Member,
    Packet,
    SetCustody,
    StoreCopies,
)
from scenefold.world import Priority
from scenefold.world.sim import run_simulated
from unit.peer.line.street import places
from unit.peer.replication.terrace import THIRDS, Home, Terrace, item_of

ASK_S = 5.0
GHOST = Member(NodeId(1), b"g" * 16)


def play(story: Callable[[Terrace], Awaitable[None]], founders: int = 3, *, seed: int = 1, seconds: float = 500.0, **more: Any) -> None:
    """Tell a story on a terrace whose houses do nothing by themselves."""

    async def main() -> None:
        terrace = Terrace(founders, is_quiet=True, **more)
        async with trio.open_nursery() as nursery:
            await terrace.begin(nursery)
            await story(terrace)
            nursery.cancel_scope.cancel()

    run_simulated(seed, main, virtual_s_max=seconds, wall_s_max=120.0)


def arc_of(home: Home) -> Arc:
    arc = home.living.arc
    assert arc is not None
    return arc


def some_places(home: Home, count: int) -> list[Location]:
    return places(arc_of(home), count)


async def settle_in(terrace: Terrace) -> None:
    """Every house knows who holds the copies of its arc: somebody who is none of them, and has all."""
    for home in terrace.homes:
        await count_on(home, (home.member, GHOST))


async def count_on(owner: Home, members: tuple[Member, ...], needed: int = 2) -> None:
    """Have the owner believe that they hold all of its arc."""
    segment = Segment(THIRDS, arc_of(owner), (Configuration(5, members, needed),), sound=frozenset(members) - {owner.member})
    configurations = Configurations(owner.member, 5, (segment,))
    await owner.living.parts.keeper.change_copies(lambda copies, _: replace(copies, configurations=configurations))


def entry(
    number: int,
    arc: Arc,
    members: Sequence[Member],
    *,
    whole: bool = True,
    needed: int = 2,
    layout: tuple[Location, ...] = THIRDS,
) -> CustodyEntry:
    return CustodyEntry(layout, arc.first, arc.last, number, tuple(members), needed, whole)


def word(owner: Home, holder: Home, number: int, *entries: CustodyEntry, scope: Arc | None = None) -> SetCustody:
    scope = arc_of(owner) if scope is None else scope
    return SetCustody(owner.member, holder.member, number, scope.first, scope.last, entries)


async def ask(owner: Home, holder: Home, packet: Packet, answer: type[Any]) -> Any:
    return await owner.peers.ask(holder.node, Priority.LOW, packet, answer, ASK_S)


async def tell(owner: Home, holder: Home, number: int, *entries: CustodyEntry, scope: Arc | None = None) -> CustodySet:
    told: CustodySet = await ask(owner, holder, word(owner, holder, number, *entries, scope=scope), CustodySet)
    return told


async def entrust(terrace: Terrace, number: int = 5, *, whole: bool = True) -> tuple[Home, Home, Home]:
    """Two holders keep all of the first one's arc for it."""
    owner, *holders = terrace.homes[:3]
    members = [owner.member, *(holder.member for holder in holders)]
    for holder in holders:
        assert (await tell(owner, holder, number, entry(number, arc_of(owner), members, whole=whole))).reason == 0
    first, second = holders
    return owner, first, second


async def send(owner: Home, holder: Home, *records: Record) -> tuple[int, ...]:
    """Why each is not kept, 0 for what is."""
    packet = StoreCopies(owner.member, tuple(map(item_of, records)))
    stored: CopiesStored = await ask(owner, holder, packet, CopiesStored)
    return stored.reasons


def listing(asker: Home, holder: Home, arc: Arc, *, position: int | None = None, after: bytes = b"", limit: int = 100) -> ListHeld:
    at = asker.street.log.registry.position if position is None else position
    return ListHeld(asker.member, holder.member, at, arc.first, arc.last, after, limit)


async def pages(asker: Home, holder: Home, arc: Arc, *, limit: int = 100) -> list[HeldListed]:
    """All that it says of an arc."""
    found: list[HeldListed] = []
    after: bytes | None = b""
    while after is not None:
        page: HeldListed = await ask(asker, holder, listing(asker, holder, arc, after=after, limit=limit), HeldListed)
        found.append(page)
        after = page.next
    return found
