"""The owner's side of a purge: it asks every node, and has dropped what nobody has anything older of (specs/22-purge.md, Asking).

Nothing of it is kept: after a crash at any step the deleted record lies somewhere or nowhere, and nothing older anywhere.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence
from functools import partial
from typing import Protocol

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import SceneId, SpaceId, address_of
from scenefold.base.location import Arc
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record
from scenefold.peer.copies.versions import told_version
from scenefold.peer.handlers import Handlers
from scenefold.peer.holdings import no_lease
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.unsettled import Name, name_of
from scenefold.peer.purging.asked import Asked
from scenefold.peer.purging.orders import spot_in
from scenefold.peer.records.verification import KnownScene
from scenefold.store import Spot
from scenefold.wire import (
    AskPlaces,
    DropPurged,
    Member,
    Packet,
    PlacesAsked,
    PlaceState,
    PurgedDropped,
    PurgeOrder,
    PurgeRecords,
    RecordsPurged,
)
from scenefold.world import Priority

ASK_S_MAX = 15.0
"""For one node: what it is sending may take some of that."""
PURGES_MAX = 4
"""Orders that are carried out at a time: each asks every node."""
_TEXT_MAX = 256

States = Mapping[Member, Sequence[PlaceState]]


class Copies(Protocol):
    """What is known of what is sent to holders (replication/spreading.py)."""

    def in_hand(self, name: Name, /) -> bool:
        """Whether there is a version of a record in memory that may still be sent."""
        ...

    def is_bound(self, scene: SceneId, space: SpaceId, arc: Arc, /) -> bool:
        """Whether somebody may still be answered there by a layout that the space had before."""
        ...


class Purging:
    """Used from the Trio thread only."""

    def __init__(self, parts: Parts, copies: Copies) -> None:
        self._parts = parts
        self._copies = copies
        self._asked = Asked(parts, copies.in_hand)
        self._slots = trio.CapacityLimiter(PURGES_MAX)

    def register(self, handlers: Handlers) -> None:
        self._asked.register(handlers)
        handlers.add(PurgeRecords, self._on_purge)

    async def _on_purge(self, packet: PurgeRecords, _peer: str) -> Packet:
        async with self._slots:
            scene = await self._asked.checked(packet.order)
            reasons, text = await self.purge(packet.order, scene)
            return RecordsPurged(tuple(map(int, reasons)), text[:_TEXT_MAX])

    async def purge(self, order: PurgeOrder, scene: KnownScene) -> tuple[list[int], str]:
        """A reason for each item of a checked order, and what one of them waits for. Refused (16) without a lease."""
        self._parts.arrival.require()
        self._parts.require_lease()
        spots = [spot_in(order.scene, item) for item in order.items]
        met = await self._met(order, scene, spots)
        if met:
            # An order is signed as a whole, and whoever is asked goes by all of it: by what is not settled here as well.
            reasons = {index: 0 if problem is None else int(problem.reason) for index, problem in met.items()}
            text = next((str(problem) for problem in met.values() if problem is not None), "")
            return [reasons.get(index, int(RejectReason.BUSY)) for index in range(len(spots))], text
        try:
            left = await self._carry_out(order, scene, spots)
        except (Refused, Unreachable, PeerFault) as problem:
            return [int(RejectReason.NOT_READY)] * len(spots), str(problem)
        return [int(RejectReason.NOT_READY) if index in left else 0 for index in range(len(spots))], next(iter(left.values()), "")

    # ------------------------------------------------------------------------------------------- before it is asked

    async def _met(self, order: PurgeOrder, scene: KnownScene, spots: Sequence[Spot]) -> dict[int, Refused | None]:
        """Which cannot go now, and why; None for what is gone already."""
        parts = self._parts
        found = await parts.store.read(spots)
        debtors = await parts.store.debtors_of(spots)
        met: dict[int, Refused | None] = {}
        for index, (item, spot, record, owed) in enumerate(zip(order.items, spots, found, debtors, strict=True)):
            waits = self._waits_for(scene, spot)
            if not parts.keeper.holding.owns(spot.home):
                met[index] = Refused(RejectReason.NOT_MY_LOCATION, "the place is another node's")
            elif isinstance(record, Record) and told_version(record.header_bytes) != item.version:
                met[index] = Refused(RejectReason.STALE_VERSION, "another version is there")
            elif waits or owed:
                met[index] = _later(waits or "somebody is still to get the record")
            elif record is None:
                met[index] = None
            elif not isinstance(record, Record):
                met[index] = _later("the record has rotted, and is not healed yet")
        return met

    def _waits_for(self, scene: KnownScene, spot: Spot) -> str:
        """What has to end before the place can be asked for; "" for nothing."""
        parts, here = self._parts, Arc(spot.home, spot.home)
        copies, layout = parts.keeper.copies, scene.layouts.get(spot.place.space, ())
        if any(here.intersection(handover.piece) is not None for _, handover in parts.keeper.holding.handovers):
            return "the place is being handed over"
        if not copies.is_recovered(here):
            return "not all is known yet that was acknowledged there"
        name = name_of(spot)
        if self._copies.in_hand(name) or parts.unsettled.of(name) or (layout and parts.unsettled.is_doubted(layout, here)):
            return "too few have the record yet"
        if self._copies.is_bound(*spot.place[:2], here):
            return "who holds its copies is changing"
        if not layout:
            return ""
        if not parts.unsettled.is_read:
            return "it is not known yet who has the record"
        segment, me = copies.configurations.at(layout, spot.home), copies.configurations.me
        active = None if segment is None else segment.active(me)
        if segment is None or active is None or not segment.is_idle(me) or len(segment.configurations) > 1:
            return "who holds its copies is changing"
        if not segment.sound.issuperset(set(active.members) - {me}):
            return "a holder of it is still being compared"
        return ""

    # ----------------------------------------------------------------------------------------------------- asking

    def members_to_ask(self, _order: PurgeOrder) -> list[Member]:
        """Everybody else who is registered: any of them may have what was acknowledged there once, or be sent it late."""
        registry = self._parts.cluster_log.registry
        if len(registry.members) != len(registry.order):
            raise _later("a founder has not come yet")
        found = [known.member for node in registry.members if (known := registry.current(node)) is not None]
        return [member for member in found if member != self._parts.own.member]

    async def _carry_out(self, order: PurgeOrder, scene: KnownScene, spots: Sequence[Spot]) -> dict[int, str]:
        """Ask all, twice; drop what may go. Which items may not, and why. Refused, Unreachable or PeerFault if somebody is missing."""
        parts = self._parts
        position, asked = parts.cluster_log.registry.position, self.members_to_ask(order)
        states: dict[Member, Sequence[PlaceState]] = {parts.own.member: await self._asked.look(order)}
        boots: dict[Member, int] = {}
        await self._each(asked, partial(self._ask, order, position, states, boots))
        # Each was asked at another time. That all of them live on says that there was a moment at which nobody had anything older.
        await self._each(asked, partial(self._ask_again, position, boots))
        left = _left(states, len(spots))
        for index, spot in enumerate(spots):
            waits = self._waits_for(scene, spot)
            if waits:
                left.setdefault(index, waits)
        self._require_owned(position, [spot for index, spot in enumerate(spots) if index not in left])
        await self._each(asked, partial(self._drop, order, states, boots, left))
        kept = [index for index in range(len(spots)) if index not in left]
        # Here last: as long as it lies here it is found, and purged another time.
        await self._asked.drop([spots[index] for index in kept], [order.items[index] for index in kept])
        self._require_owned(position, [spots[index] for index in kept])
        return left

    def _require_owned(self, position: int, spots: Sequence[Spot]) -> None:
        if not self._parts.lease.holds():
            raise no_lease()
        if not all(self._parts.keeper.holding.owns(spot.home) for spot in spots):
            raise _later("a place has gone to another node")
        if self._parts.cluster_log.registry.position != position:
            raise _later("the cluster has changed meanwhile")

    async def _each(self, members: Sequence[Member], ask: Callable[[Member], Awaitable[None]]) -> None:
        """All at once; the first problem is raised once all have answered."""
        problems: list[Exception] = []

        async def one(member: Member) -> None:
            try:
                await ask(member)
            except (Refused, Unreachable, PeerFault) as problem:
                problems.append(problem)

        async with trio.open_nursery() as nursery:
            for member in members:
                nursery.start_soon(one, member)
        if problems:
            raise problems[0]

    async def _ask(
        self, order: PurgeOrder, position: int, states: dict[Member, Sequence[PlaceState]], boots: dict[Member, int], member: Member
    ) -> None:
        reply = await self._answer(AskPlaces(self._parts.own.member, member, position, order), member)
        if len(reply.states) != len(order.items):
            raise PeerFault("a node answered for another number of places", where=address_of(member.node))
        states[member], boots[member] = reply.states, reply.boot

    async def _ask_again(self, position: int, boots: Mapping[Member, int], member: Member) -> None:
        reply = await self._answer(AskPlaces(self._parts.own.member, member, position, None), member)
        if reply.boot != boots[member]:
            raise _later(f"{address_of(member.node)} has started anew")

    async def _answer(self, packet: AskPlaces, member: Member) -> PlacesAsked:
        reply = await self._parts.peers.ask(member.node, Priority.LOW, packet, PlacesAsked, ASK_S_MAX)
        if reply.reason:
            raise _later(f"{address_of(member.node)}: {reply.text}")
        return reply

    async def _drop(self, order: PurgeOrder, states: States, boots: Mapping[Member, int], left: Mapping[int, str], member: Member) -> None:
        gone = [
            item
            for index, (item, state) in enumerate(zip(order.items, states[member], strict=True))
            if state is PlaceState.THIS and index not in left
        ]
        if not gone:
            return
        packet = DropPurged(self._parts.own.member, member, boots[member], order.scene, tuple(gone))
        reply = await self._parts.peers.ask(member.node, Priority.LOW, packet, PurgedDropped, ASK_S_MAX)
        if reply.reason:
            raise _later(f"{address_of(member.node)}: {reply.text}")


def _left(states: States, count: int) -> dict[int, str]:
    """Of which places somebody has another version, and who."""
    left: dict[int, str] = {}
    for member, found in states.items():
        for index in range(count):
            if found[index] is PlaceState.OTHER:
                left.setdefault(index, f"{address_of(member.node)} has another version, or one that it cannot read")
    return left


def _later(what: str) -> Refused:
    return Refused(RejectReason.NOT_READY, what)
