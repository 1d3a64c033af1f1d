"""Nodes beside each other whose lines, stores and log are kept in memory, in virtual time: for the hands of balancing.

A piece moves whole after a while, or not at all; arcs must tile the line all the time, or be on their way. What is the
line's own business (steps, crashes) is tested with the line.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, cast

import trio

from scenefold.base.errors import Refused, Unreachable
from scenefold.base.ids import NodeId, SceneId, SpaceId, address_of
from scenefold.base.location import FIRST, LAST, Arc, Location
from scenefold.base.prefixes import Blacklist, address_prefix
from scenefold.base.reasons import RejectReason
from scenefold.crypto import RecordPlace
from scenefold.peer.balance import Balancer, Draining, Joining, Sharing
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.handlers import Handlers
from scenefold.peer.line.ends import Side, touches, without
from scenefold.peer.line.gaps import Gaps
from scenefold.peer.line.resting import Resting
from scenefold.peer.membership.status import OwnStatus
from scenefold.store.layout import Spot
from scenefold.store.statistics import Counts
from scenefold.store.walking import Entry, Manifest, Rightful, Weighed
from scenefold.wire import AddNode, LogEntry, Packet, RemoveNode, Status
from scenefold.world import World
from unit.peer.logs_made import add, folded, found, member, node, record, secrets_of

KIB = 1024
SETTLING_S = 10.0
ADMINISTRATOR = "user:ada"


class TrioClock:
    stopwatch = None

    def now(self) -> float:
        return trio.current_time()

    async def sleep(self, seconds: float) -> None:
        await trio.sleep(seconds)


class Dice:
    def __init__(self, seed: int) -> None:
        self._seed, self._count = seed, 0

    def token(self, count: int) -> bytes:
        self._count += 1
        return hashlib.sha256(b"%d/%d" % (self._seed, self._count)).digest()[:count]


@dataclass
class House:
    """One node. It is its own line, store and roster."""

    street: Street
    number: int
    capacity: int
    arc: Arc | None = None
    sizes: dict[Location, int] = field(default_factory=dict)
    rotten: set[Location] = field(default_factory=set)
    refuses: str = ""
    has_lease: bool = True
    alive: bool = True
    notes: dict[str, bytes] = field(default_factory=dict)
    decides: list[SceneId] = field(default_factory=list)
    received_at: dict[Location, float] = field(default_factory=dict)
    moving: set[Side] = field(default_factory=set)

    def __post_init__(self) -> None:
        street = self.street
        self.me = node(self.number)
        self.own = OwnStatus(self.me, address_of(self.me), member(self.number).incarnation, 1, secrets_of(self.number))
        self.world = cast(World, SimpleNamespace(clock=TrioClock(), entropy=Dice(self.number)))
        self.handlers = Handlers(lambda: street.registry, self.own.mini, lambda mini: None)
        store, line, roster, log = cast(Any, self), self, cast(Any, self), street
        self.resting = Resting()
        gaps = Gaps(self.world.clock, roster)
        self.balancer = Balancer(self.world, store, line, roster, log, self.own, self.resting, gaps)
        self.sharing = Sharing(store, line, log, self.own, roster, Gaps(self.world.clock, roster))
        self.joining = Joining(self.world, line, roster, cast(Any, street), log, cast(Any, self), self.own)
        self.draining = Draining(
            self.world,
            store,
            line,
            roster,
            log,
            self.own,
            lambda: self.decides,
            has_lease=lambda: self.has_lease,
            may_order=lambda user: user == ADMINISTRATOR,
        )
        for service in (self.sharing, self.draining):
            service.register(self.handlers)

    def place_at(self, place: Location | str) -> None:
        """Join there instead of beside the fullest."""
        street, me = cast(Any, self.street), cast(Any, self)
        self.joining = Joining(self.world, self, me, street, street, me, self.own, place=place)

    @property
    def used(self) -> int:
        return sum(self.sizes.values())

    def forbid(self, *prefixes: str) -> None:
        """Put these on this node's blacklist."""
        self.own.blacklist = Blacklist(self.own.blacklist.version + 1, tuple(map(address_prefix, prefixes)))

    def measure(self) -> None:
        self.own.arc = self.arc
        self.own.update(disk_used_bytes=self.used, disk_total_bytes=self.capacity)

    def fill_evenly(self, count: int, size: int) -> None:
        """Records at even distances in the arc."""
        assert self.arc is not None
        for index in range(count):
            self.sizes[Location.from_number(self.arc.first.number + self.arc.length * index // count)] = size

    # ------------------------------------------------------------------------------------------------------- line

    def busy(self, side: Side) -> bool:
        return side in self.moving

    def settled(self, arc: Arc) -> bool:
        return all(trio.current_time() >= at + SETTLING_S for place, at in self.received_at.items() if place in arc)

    def open_handovers(self) -> Sequence[Side]:
        return sorted(self.moving)

    async def give(self, side: Side, arc: Arc, *, why: str) -> None:
        await self.street.move(self, side, arc)

    # ------------------------------------------------------------------------------------------------------ store

    async def weigh(self, arc: Arc, bytes_wanted: int, *, from_right: bool) -> Weighed:
        location, records, size = (arc.last if from_right else arc.first), 0, 0
        for place in sorted((place for place in self.sizes if place in arc), reverse=from_right):
            if size >= bytes_wanted:
                break
            location, records, size = place, records + 1, size + self.sizes[place]
        return Weighed(location, records, size)

    async def arc_totals(self, arc: Arc) -> Counts:
        inside = [size for place, size in self.sizes.items() if place in arc]
        return Counts(len(inside), sum(inside))

    async def statistics(self) -> Any:
        return SimpleNamespace(records=len(self.sizes), bytes=self.used, disk_used_bytes=self.used, disk_total_bytes=self.capacity)

    async def strays(self, rightful: Rightful, after: bytes | None, limit: int) -> Manifest:
        strays = [place for place in sorted(self.sizes) if not any(place in arc for arc in rightful.kept)]
        page = [place for place in strays if after is None or place > after][:limit]
        spots = {place: Spot(RecordPlace(SceneId(1), SpaceId(1), place), b"") for place in page}
        entries = [Entry(*spot, bytes(32), self.sizes[place]) for place, spot in spots.items() if place not in self.rotten]
        damaged = tuple(spot for place, spot in spots.items() if place in self.rotten)
        return Manifest(entries, page[-1] if len(page) == limit else None, damaged)

    async def put_note(self, name: str, value: bytes) -> None:
        self.notes[name] = value

    async def get_note(self, name: str) -> bytes | None:
        return self.notes.get(name)

    # ----------------------------------------------------------------------------------------------------- roster

    unheard_count = 0

    def arcs(self) -> dict[NodeId, Arc | None]:
        return {house.me: house.arc for house in self.street.houses if house is not self}

    def former_arcs(self, _now: float) -> list[Arc]:
        return self.street.former

    def status(self, other: NodeId) -> Status | None:
        house = self.street.by_id(other)
        return None if house is self else house.own.signed()

    def is_believed_alive(self, other: NodeId) -> bool:
        return self.street.by_id(other).alive

    # ------------------------------------------------------------------------------------------------------ peers

    async def ask(self, other: NodeId, _priority: object, packet: Packet, answer: type[Any], _timeout: float) -> Any:
        await trio.sleep(0.01)
        house = self.street.by_id(other)
        if not house.alive:
            raise Unreachable("no answer")
        reply = await house.handlers.handle(packet, f"node:{self.me}")
        assert isinstance(reply, answer)
        return reply

    async def run(self) -> None:
        """What a node runs; NodeDrained at the end of a drain."""
        await self.draining.load()
        async with trio.open_nursery() as nursery:
            for service in (self.balancer, self.sharing, self.joining, self.draining):
                nursery.start_soon(service.run)
            while True:
                self.measure()
                await trio.sleep(1)


class Street:
    """All houses, and the one log that all see at once. `founders` have even arcs; `add_newcomer` begins without."""

    def __init__(self, capacities: Sequence[int]) -> None:
        count = len(capacities)
        self.registry: Registry = folded(found(count), *(add(number) for number in range(count)))
        self.houses = [
            House(self, number, capacity, self.registry.founding_arc(node(number))) for number, capacity in enumerate(capacities)
        ]
        self.handovers = 0
        self.former: list[Arc] = []
        """What removed members claimed last."""
        self.bytes_per_s = 1 << 40
        self.rejected: list[LogEntry] = []
        for house in self.houses:
            house.measure()

    def by_id(self, found_id: NodeId) -> House:
        return next(house for house in self.houses if house.me == found_id)

    def add_newcomer(self, capacity: int) -> House:
        house = House(self, len(self.houses), capacity)
        self.houses.append(house)
        house.measure()
        return house

    # -------------------------------------------------------------------------------------------- log and routing

    async def propose(self, entry: LogEntry, request_id: bytes | None = None) -> int:
        await trio.sleep(0.01)
        known = None if request_id is None else self.registry.position_of(request_id)
        if known is not None:
            return known
        self.registry = self.registry.apply(record(self.registry, entry, request_id))
        assert isinstance(entry, AddNode | RemoveNode)
        return self.registry.position

    def arc_of(self, other: NodeId) -> Arc | None:
        return self.by_id(other).arc

    # ------------------------------------------------------------------------------------------------------ moving

    async def move(self, giver: House, side: Side, piece: Arc) -> None:
        """A whole handover: Refused before anything has changed, or done."""
        left, right = self.registry.neighbours(giver.me)
        other = left if side is Side.LEFT else right
        if other is None:
            raise Refused(RejectReason.OUTSIDE_BOUNDS, "nobody stands there")
        receiver = self.by_id(other)
        if not receiver.alive:
            raise Unreachable("the neighbour does not answer")
        if receiver.refuses:
            raise Refused(RejectReason.BUSY, receiver.refuses)
        if giver.busy(side) or receiver.busy(side.opposite):
            raise Refused(RejectReason.BUSY, "a handover is under way")
        moved = {place: size for place, size in giver.sizes.items() if place in piece}
        if receiver.used + sum(moved.values()) > receiver.capacity:
            raise Refused(RejectReason.STORAGE_FULL, "no room")
        assert giver.arc is not None and giver.settled(piece)
        assert receiver.arc is None or touches(piece, receiver.arc, side.opposite)
        giver.moving.add(side)
        receiver.moving.add(side.opposite)
        try:
            await trio.sleep(0.05 + sum(moved.values()) / self.bytes_per_s)
            giver.arc = without(giver.arc, piece, side)
            before = receiver.arc
            receiver.arc = piece if before is None else Arc(min(before.first, piece.first), max(before.last, piece.last))
            for place, size in moved.items():
                del giver.sizes[place]
                giver.received_at.pop(place, None)
                receiver.sizes[place], receiver.received_at[place] = size, trio.current_time()
        finally:
            giver.moving.discard(side)
            receiver.moving.discard(side.opposite)
        self.handovers += 1
        for house in (giver, receiver):
            house.measure()

    def check(self) -> None:
        """Arcs tile the line in the order of the log; every record lies with its owner."""
        arcs = [(house, house.arc) for house in map(self.by_id, self.registry.order) if house.arc is not None]
        edge: Location | None = FIRST
        for house, arc in arcs:
            assert arc.first == edge
            edge = arc.last.next()
            assert all(place in arc for place in house.sizes)
        assert arcs[-1][1].last == LAST

    def records(self) -> dict[Location, int]:
        """All records of all nodes; each lies in one place only."""
        everything = [item for house in self.houses for item in house.sizes.items()]
        assert len({place for place, _ in everything}) == len(everything)
        return dict(everything)
