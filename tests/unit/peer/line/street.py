"""A few nodes with real lines, stores and links in a simulated world; around them a log and leases made by hand.

Every commit of any of them is followed by a look at all disks: no place in two arcs, no record of an arc missing. So a
test only has to crash nodes where it likes, and to ask at the end whether the line is whole and quiet.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import trio

from scenefold.base.errors import PeerFault, Refused
from scenefold.base.ids import NodeId, address_of
from scenefold.base.location import FIRST, LAST, Arc, Location
from scenefold.crypto import Record
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.enrolment.enrolment import registration
from scenefold.peer.handlers import Handlers
from scenefold.peer.line import Claims, Line
from scenefold.peer.line.holding_note import decode_holding
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.records.verification import KnownScene
from scenefold.store import Outcome, Put, open_store
from scenefold.store.holding import NOTE_KEY
from scenefold.store.layout import HOLDING, IDENTITY, RECORDS, location_of
from scenefold.store.sealing import opened
from scenefold.wire import LogEntry, Member, MiniStatus, Packet, RemoveNode
from scenefold.world import Clock, Connection, DiskFailed, Priority, open_links, serve_connection
from scenefold.world.sim import Point, SimNet
from unit.peer.logs_made import found, node, record, secrets_of
from unit.peer.scenes_made import first_header, sealed

HEADER = first_header()
SCENE = KnownScene.of(HEADER)
RECORD_BYTES = 200
SPREAD = 0x9E3779B97F4A7C15F39CC0605CEDC8341082276B
"""Multiples of it lie all over an arc."""


def record_at(location: Location, seq: int = 1) -> Record:
    return sealed(
        HEADER, payload=b"x" * RECORD_BYTES, location=location, seq=seq, nonce=location.number.to_bytes(20, "big")[:11] + bytes([seq])
    )


def places(arc: Arc, count: int) -> list[Location]:
    return [Location.from_number(arc.first.number + arc.length * index // count) for index in range(count)]


class Log:
    """One log for all: every node learns everything at once."""

    def __init__(self, count: int) -> None:
        self.registry = Registry()
        self._news = trio.Event()
        self.say(found(count))

    def say(self, entry: LogEntry) -> None:
        self.registry = self.registry.apply(record(self.registry, entry))
        self._news.set()
        self._news = trio.Event()

    async def changed_after(self, position: int) -> Registry:
        while self.registry.position <= position:
            await self._news.wait()
        return self.registry


class KnownLog:
    """The log as one life of a node knows it: all of it at once, and since when by its own clock."""

    def __init__(self, log: Log, clock: Clock) -> None:
        self._log, self._clock = log, clock
        self._learnt: dict[int, float] = {}

    @property
    def registry(self) -> Registry:
        return self._log.registry

    async def changed_after(self, position: int) -> Registry:
        registry = await self._log.changed_after(position)
        self.learnt_at(registry.position)
        return registry

    def learnt_at(self, position: int) -> float:
        return self._learnt.setdefault(position, self._clock.now())

    async def pull_from(self, _node: NodeId) -> None:
        return None


class Asker:
    """Like Peers, without a roster."""

    def __init__(self, links: Any, own: OwnStatus) -> None:
        self._links, self._own = links, own

    async def ask(self, member: NodeId, priority: Priority, packet: Packet, answer: type[Any], timeout: float) -> Any:
        reply = await self._links.request(address_of(member), priority, packet, timeout)
        if not isinstance(reply, answer):
            raise PeerFault(f"{type(reply).__name__} is no {answer.__name__}")
        return reply


class Lease:
    def __init__(self, house: House) -> None:
        self._house = house

    def holds(self) -> bool:
        own = self._house.own
        return self._house.leased and own is not None and self._house.street.log.registry.is_current(own.member)


class Scenes:
    async def known(self, scene: int, *, position: int = 0, ask: bool = True, asker: str = "") -> KnownScene:
        return SCENE

    def everyone(self) -> list[KnownScene]:
        return [SCENE]

    def here(self, scene: int) -> KnownScene:
        return SCENE


class Owners:
    """Who owns a place by the arcs on the disks: routing that is always right."""

    def __init__(self, street: Street) -> None:
        self._street = street

    def owner_of(self, location: Location) -> NodeId:
        for house in self._street.houses:
            holding = house.durable()
            if house.is_registered() and holding is not None and holding.owns(location):
                return house.node
        return NodeId(0)

    def candidates(self, location: Location) -> list[NodeId]:
        return [self.owner_of(location)]


class News:
    """What the other nodes said of their arcs: what is on their disks."""

    def __init__(self, street: Street) -> None:
        self._street = street
        self.former: list[Arc] = []
        self.unheard: set[NodeId] = set()

    def arcs(self) -> dict[NodeId, Arc | None]:
        return {house.node: holding.arc for house in self._street.houses if (holding := house.durable()) is not None}

    def is_unheard(self, member: NodeId) -> bool:
        return member in self.unheard

    def former_arcs(self, now: float) -> list[Arc]:
        return self.former


class NothingElsewhere:
    """Gaps are recovered at once: on a street without copies nobody else has anything to say of them."""

    def __init__(self, line: Line) -> None:
        self._keeper = line.parts.keeper

    def register(self, _handlers: Handlers) -> None:
        return None

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        task_status.started()
        while True:
            copies = self._keeper.copies
            for gap in copies.unrecovered:
                try:
                    await self._keeper.change_copies(partial(lambda now, _, gap: now.recover(gap, {}, 0), gap=gap))
                except Refused:
                    await trio.sleep(0.5)
            if self._keeper.copies is copies:
                await self._keeper.copies_changed_after(copies)


class House:
    """One machine, life after life. `line` is that of the current life."""

    def __init__(self, street: Street, number: int) -> None:
        self.street, self.number, self.node = street, number, node(number)
        self.address = address_of(self.node)
        self.line: Line | None = None
        self.own: OwnStatus | None = None
        self.store: Any = None
        self.handlers: Any = None
        self.leased = True
        self.stays_down = False
        self.lives = 0
        self.up = trio.Event()
        self._life = trio.CancelScope()

    def crash(self) -> None:
        self.street.net.crash(self.address)
        self._life.cancel()

    def durable(self) -> Any:
        if not self.lives:
            return None
        note = self._kept(HOLDING, NOTE_KEY)
        return None if note is None else decode_holding(note)

    def _kept(self, table: str, key: bytes) -> bytes | None:
        stored = self.street.net.machine(self.address).disk.peek(table).get(key)
        return None if stored is None else bytes(opened(table, key, memoryview(stored)))

    def durable_member(self) -> Member | None:
        if not self.lives:
            return None
        incarnation = self._kept(IDENTITY, b"incarnation")
        return None if incarnation is None else Member(self.node, incarnation)

    def is_registered(self) -> bool:
        member = self.durable_member()
        return member is not None and self.street.log.registry.is_current(member)

    def stored(self) -> set[Location]:
        return {location_of(key) for key in self.street.net.machine(self.address).disk.peek(RECORDS)}

    async def run(self) -> None:
        while not self.stays_down:
            world = self.street.net.world(f"node:{self.node}", self.address)
            with trio.CancelScope() as self._life:
                try:
                    await self._live(world)
                except* DiskFailed:
                    self.street.net.note("died-in-commit", self.address)
            self.line, self.up = None, trio.Event()
            await trio.sleep(1.0)

    def furnish(self, _world: Any, links: Any, own: OwnStatus) -> tuple[Any, Any, Any]:
        """Whom the line asks, which scenes it knows, and who owns what."""
        return Asker(links, own), Scenes(), Owners(self.street)

    def others(self, _world: Any, line: Line) -> list[Any]:
        """Services that live here beside the line: what they answer, and what goes on by itself if they have a `run`."""
        return [NothingElsewhere(line)]

    def hear(self, _mini: MiniStatus) -> None:
        """A node that asks says this of itself."""

    async def _live(self, world: Any) -> None:
        log = self.street.log
        async with (
            open_store(world, Path("data"), self.node, reserve_bytes=self.street.reserve_bytes) as store,
            open_links(world) as links,
            trio.open_nursery() as nursery,
        ):
            own = OwnStatus(self.node, self.address, store.identity.incarnation, store.identity.boot, secrets_of(self.number))
            if log.registry.current(self.node) is None and not self.lives:
                left_of = NodeId(0) if log.registry.vacant_seat(self.node) else log.registry.order[self.street.join_before]
                log.say(registration(own, left_of))
            self.lives += 1
            any_log: Any = KnownLog(log, world.clock)
            claims = Claims(world.clock, any_log, self.street.news, self.node)
            peers, scenes, owners = self.furnish(world, links, own)
            line = Line(world, store, peers, any_log, own, Lease(self), scenes, owners, claims)
            handlers = Handlers(lambda: log.registry, own.mini, self.hear)
            line.register(handlers)
            others = self.others(world, line)
            for service in others:
                service.register(handlers)
            await line.load()

            async def serve(connection: Connection) -> None:
                await serve_connection(connection, handlers.handle)

            await nursery.start(world.network.listen, self.address, Priority.LOW, serve)
            self.line, self.own, self.store, self.handlers = line, own, store, handlers
            await nursery.start(line.run)
            for service in others:
                if hasattr(service, "run"):
                    await nursery.start(service.run)
            self.up.set()
            await trio.sleep_forever()


class Street:
    """`houses[i]` is node(i); the first `founders` of them share the line evenly, others join left of `join_before`."""

    def __init__(self, founders: int, *, newcomers: int = 0, join_before: int = 0, seed: int = 1) -> None:
        self.net = SimNet(seed)
        self.log = Log(founders)
        self.news = News(self)
        self.join_before = join_before
        self.reserve_bytes = 1024 * 1024
        self.houses = [self.house(number) for number in range(founders + newcomers)]
        self.kept: set[Location] = set()
        """Places whose records must never be missing from the arc that they lie in."""
        self.broken: list[str] = []

    def house(self, number: int) -> Any:
        return House(self, number)

    def record_at(self, location: Location) -> Record:
        return record_at(location)

    async def begin(self, nursery: trio.Nursery) -> None:
        for house in self.houses:
            nursery.start_soon(house.run)
            await house.up.wait()
            self.net.observe(house.address, Point.AFTER_COMMIT, self.look)

    async def fill(self, number: int, count: int) -> list[Location]:
        """Put records evenly into a node's arc."""
        house = self.houses[number]
        while True:
            await house.up.wait()
            arc = None if house.line is None else house.line.arc
            try:
                if arc is not None:
                    spots = places(arc, count)
                    results = await house.store.put([Put(self.record_at(place)) for place in spots])
                    # Only what was acknowledged must be kept: the arc may have changed on the way to the disk.
                    if all(result.outcome is Outcome.STORED for result in results):
                        self.kept |= set(spots)
                        return spots
            except (Refused, DiskFailed) as problem:
                self.net.note("not filled", problem)
            await trio.sleep(0.5)

    async def write(self, number: int, turn: int) -> float:
        """Put a record somewhere into a node's arc, as clients do; how many seconds that took."""
        house, begin = self.houses[number], self.net.now
        line, store = house.line, house.store
        if line is None or line.arc is None:
            return 0.0
        place = Location.from_number(line.arc.first.number + turn * SPREAD % line.arc.length)
        async with line.writing([place]):
            if line.owns(place) and (await store.put([Put(self.record_at(place))]))[0].outcome is Outcome.STORED:
                self.kept.add(place)
        return self.net.now - begin

    def look(self) -> None:
        """The invariants, on the disks as they are at this moment."""
        held = [(house, holding) for house in self.houses if house.is_registered() and (holding := house.durable()) is not None]
        arcs = [(house, holding.arc) for house, holding in held if holding.arc is not None]
        for index, (house, arc) in enumerate(arcs):
            for other, another in arcs[index + 1 :]:
                if arc.intersection(another) is not None:
                    self.broken.append(f"{house.number} and {other.number} own the same places")
            missing = {place for place in self.kept if place in arc} - house.stored()
            if missing:
                self.broken.append(f"{house.number} lacks {len(missing)} records of its arc")

    def is_whole(self) -> bool:
        """Whether the arcs tile the line in the order of the log, nothing is open, and every record lies at its owner alone."""
        by_node = {house.node: house for house in self.houses}
        holdings = [by_node[member].durable() for member in self.log.registry.members]
        if any(holding is None or holding.handovers for holding in holdings):
            return False
        arcs = [holding.arc for holding in holdings if holding.arc is not None]
        if not arcs or arcs[0].first != FIRST or arcs[-1].last != LAST:
            return False
        if any(left.last.next() != right.first for left, right in pairwise(arcs)):
            return False
        return not any(self.has_strays(by_node[member]) for member in self.log.registry.members)

    def has_strays(self, house: Any) -> bool:
        """Whether something lies on its disk that does not belong there."""
        holding = house.durable()
        return not all(holding.owns(place) for place in house.stored())

    async def until_whole(self, seconds: float = 150.0) -> None:
        with trio.move_on_after(seconds):
            while not self.is_whole():  # noqa: ASYNC110 - the disks are the truth, and tell nobody when they change
                await trio.sleep(0.5)
            return
        state = [(house.number, house.durable()) for house in self.houses]
        raise AssertionError(f"the line is not whole: {state}")

    def remove(self, number: int) -> None:
        member = self.houses[number].durable_member()
        assert member is not None
        self.log.say(RemoveNode(member, "gone"))

    def check(self, lost: Sequence[Location] = ()) -> None:
        self.look()
        assert not self.broken, self.broken[0]
        everywhere = set().union(*(house.stored() for house in self.houses if house.is_registered()))
        assert self.kept - set(lost) <= everywhere


def rot(house: House, locations: Iterable[Location], byte: int) -> None:
    """Turn a bit over in a byte of what is stored there."""
    for folder in house.street.net.machine(house.address).disk._folders.values():
        values = folder.tables[RECORDS].values
        for key in [key for key in values if location_of(key) in set(locations)]:
            damaged = bytearray(values[key])
            damaged[byte] ^= 1
            folder.rot(RECORDS, key, bytes(damaged))
