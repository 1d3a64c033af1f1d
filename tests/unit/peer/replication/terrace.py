"""A street whose houses also hold copies for each other: real lines, stores, rosters, routing, data and replication.

    SPACE    has one copy, as ever
    THRICE   has three, of which two must be there, at thirds of the line
    OBJECTS  likewise; nodes choose the places in it

What nodes say of themselves everybody hears twice a second, unless the network is cut between the two. The log is one for all, and the
leases are those of the street.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from types import SimpleNamespace
from typing import Any, cast

import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId, SceneId, SpaceId
from scenefold.base.location import FIRST, Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import PLACED_BY_NODE, Record, RecordPlace, object_of, signed_place, wanted_place
from scenefold.peer.copies.copies import Copies
from scenefold.peer.copies.copies_note import decode_copies
from scenefold.peer.handlers import Handlers
from scenefold.peer.line import Gaps, Line
from scenefold.peer.membership.roster import Roster
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.peers import Peers
from scenefold.peer.records.data import DataService
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.replication import Replication
from scenefold.peer.routing import Routing
from scenefold.peer.scene_log.proposals import answer_of
from scenefold.scene.log import free_offsets
from scenefold.store import Spot
from scenefold.store.holding import COPIES_KEY
from scenefold.store.layout import HOLDING, RECORDS, spot_of
from scenefold.wire import HandItem, Member, MiniStatus, Packet, RequestSceneLog, RespondSceneLog, SceneLogPublic, SpaceEntry
from scenefold.world import Connection, Links, Priority, World, serve_connection
from unit.peer.line.street import House, Street
from unit.peer.scenes_made import SPACE, first_header, sealed

THRICE = SpaceId(20)
OBJECTS = SpaceId(30)
THIRDS = tuple(free_offsets((), 2))
"""The layout of the two spaces with three copies."""
TALK_S = 0.5
USER = "user:maker"


def _space(space: int, copies: int, copies_min: int, *, parent: int = 0, offset: Location = FIRST, managed: bool = False) -> SpaceEntry:
    return SpaceEntry(SpaceId(space), SpaceId(parent), offset, copies, copies_min, render_output=False, node_managed=managed)


def _shadows(parent: int) -> list[SpaceEntry]:
    return [_space(parent + 1 + index, 1, 1, parent=parent, offset=offset) for index, offset in enumerate(THIRDS)]


HEADER: SceneLogPublic = first_header(
    spaces=(
        _space(SPACE, 1, 1),
        _space(THRICE, 3, 2),
        *_shadows(THRICE),
        _space(OBJECTS, 3, 2, managed=True),
        *_shadows(OBJECTS),
    )
)
SCENE = KnownScene.of(HEADER)


def record_at(location: Location, seq: int = 1, space: SpaceId = THRICE, payload: bytes = b"x" * 200) -> Record:
    nonce = location.number.to_bytes(20, "big")[:10] + bytes([space, seq])
    return sealed(HEADER, payload=payload, location=location, seq=seq, space=space, nonce=nonce)


def object_record(object_id: bytes, seq: int = 1) -> Record:
    """A record whose place nodes choose; its home is `wanted_place(object_id)`."""
    return sealed(
        HEADER,
        payload=b"o" * 200,
        location=signed_place(object_id),
        seq=seq,
        space=OBJECTS,
        placement=PLACED_BY_NODE,
        nonce=object_id[:11] + bytes([seq]),
    )


def item_of(record: Record, place: Location | None = None) -> HandItem:
    """The record as nodes hand it to each other. `place`: where one lies that nodes have placed."""
    header = record.header
    object_id = object_of(header)
    location = (place or wanted_place(object_id)) if object_id else header.location
    return HandItem(header.scene, header.space, location, object_id, record.signature, record.header_bytes, record.ciphertext)


class Scenes:
    """Every scene that this house has heard of."""

    def __init__(self, house: Home) -> None:
        self._house = house

    async def known(self, scene: SceneId, *, position: int = 0, ask: bool = True, asker: str = "") -> KnownScene:
        found = self._house.scenes.get(scene)
        if found is None:
            raise Refused(RejectReason.UNKNOWN_SCENE_OR_SPACE, f"scene {scene:08x} is unknown in this cluster")
        return found

    def everyone(self) -> Sequence[KnownScene]:
        return list(self._house.scenes.values())

    def here(self, scene: SceneId) -> KnownScene | None:
        return self._house.scenes.get(scene)

    async def adopt(self, public: SceneLogPublic) -> KnownScene:
        known = self.here(public.scene)
        if self._house.is_deaf:
            raise Refused(RejectReason.STORAGE_FULL, "this house hears of nothing")
        if known is not None and known.public.position >= public.position:
            raise Refused(RejectReason.POSITION_BEHIND, "something newer is known")
        self._house.scenes[public.scene] = KnownScene.of(public)
        return self._house.scenes[public.scene]


class Headers:
    """What a house shows of scenes, and hears of them: packets 5 and 6, over the port for them."""

    def __init__(self, house: Home, world: World, scenes: Scenes) -> None:
        self._house, self._world, self._scenes = house, world, scenes

    def register(self, handlers: Handlers) -> None:
        handlers.add(RequestSceneLog, self._on_request)
        handlers.add(RespondSceneLog, self._on_push)
        self._handlers = handlers

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        async def serve(connection: Connection) -> None:
            await serve_connection(connection, self._handlers.handle)

        await self._world.network.listen(self._house.address, Priority.HIGH, serve, task_status=task_status)

    async def _on_request(self, packet: RequestSceneLog, _peer: str) -> Packet:
        known = self._scenes.here(packet.scene)
        return RespondSceneLog(answer=None if known is None else answer_of(known.public, packet.nonce, None))

    async def _on_push(self, packet: RespondSceneLog, _peer: str) -> None:
        if packet.answer is not None:
            with suppress(Refused):
                await self._scenes.adopt(packet.answer.public)


class Home(House):
    """A house that also holds copies. `scenes`: those that it knows, also in its next lives."""

    street: Terrace

    def __init__(self, street: Terrace, number: int) -> None:
        super().__init__(street, number)
        self.scenes = {HEADER.scene: SCENE}
        self.is_deaf = False
        """Whether it hears of no new header."""
        self.roster: Roster = cast(Any, None)
        self.routing: Routing = cast(Any, None)
        self.peers: Peers = cast(Any, None)
        self.replication: Replication = cast(Any, None)
        self.data: DataService = cast(Any, None)
        self._world: World = cast(Any, None)

    def furnish(self, world: World, links: Links, own: OwnStatus) -> tuple[Any, Any, Any]:
        log = self.street.log
        self._world = world
        self.roster = Roster(self.node)
        self.roster.set_members(log.registry, world.clock.now())
        self.routing = Routing(lambda: log.registry, self.roster, own)
        self.peers = Peers(world, links, own, self.roster, self.routing)
        return self.peers, Scenes(self), self.routing

    def others(self, world: World, line: Line) -> list[Any]:
        parts = line.parts
        self.replication = Replication(parts, self.roster, self.routing, Gaps(parts.world.clock, self.roster))
        copying = self.replication.spreading
        self.data = DataService(
            world,
            parts.store,
            self.peers,
            cast(Any, parts.scenes),
            line,
            parts.lease,
            cast(Any, self.routing),
            self.node,
            copying,
            self.replication.recovering,
        )
        headers = Headers(self, world, cast(Any, parts.scenes))
        if not self.street.is_quiet:
            return [self.replication, self.data, headers]
        # Nobody would hold anything, so nothing would ever settle.
        parts.keeping.merge = parts.store.merge
        return [SimpleNamespace(register=self.replication.register), self.data, headers]

    def hear(self, mini: MiniStatus) -> None:
        self.roster.hear_mini(mini, self._world.clock.now())

    @property
    def living(self) -> Line:
        """The line of a house that is up."""
        assert self.line is not None
        return self.line

    @property
    def member(self) -> Member:
        assert self.own is not None
        return self.own.member

    @property
    def copies(self) -> Copies:
        return self.living.parts.keeper.copies

    def durable_copies(self) -> Copies:
        """What its disk says."""
        note, member = self._kept(HOLDING, COPIES_KEY), self.durable_member()
        assert member is not None
        return Copies.of(member) if note is None else decode_copies(note, member)

    def spots(self, space: SpaceId = THRICE) -> set[Spot]:
        """What lies on its disk of a space."""
        found = {spot_of(key) for key in self.street.net.machine(self.address).disk.peek(RECORDS)}
        return {spot for spot in found if spot.place.space == space}

    def places(self, space: SpaceId = THRICE) -> set[Location]:
        return {spot.place.location for spot in self.spots(space)}

    async def asked(self, packet: Packet, peer: str | NodeId = USER) -> Any:
        """What it answers to a packet of a user, or of a node, that came over the network; Refused if it refuses."""
        sender = peer if isinstance(peer, str) else f"node:{peer}"
        return await self.handlers.handle(packet, sender)

    def spot(self, location: Location, space: SpaceId = THRICE) -> Spot:
        return Spot(RecordPlace(HEADER.scene, space, location))


class Terrace(Street):
    """`homes[i]` is node(i). `space`: the one that `fill` and `write` put records into. `is_quiet`: the houses answer about copies, and do nothing by themselves."""

    def __init__(self, founders: int, *, space: SpaceId = THRICE, is_quiet: bool = False, **more: Any) -> None:
        self.space = space
        self.is_quiet = is_quiet
        super().__init__(founders, **more)
        self.homes: list[Home] = self.houses

    def house(self, number: int) -> Home:
        return Home(self, number)

    def record_at(self, location: Location) -> Record:
        return record_at(location, space=self.space)

    async def begin(self, nursery: trio.Nursery) -> None:
        """Return once all founders have their arcs, and everybody has heard of them."""
        await super().begin(nursery)
        nursery.start_soon(self._talk)
        while any(home.durable() is None for home in self.homes):  # noqa: ASYNC110 - a founding tells nobody
            await trio.sleep(0.1)
        await trio.sleep(2 * TALK_S)

    def has_strays(self, house: Home) -> bool:
        holding, custody = house.durable(), house.durable_copies().custody
        found = [spot_of(key) for key in self.net.machine(house.address).disk.peek(RECORDS)]
        layouts = house.scenes[HEADER.scene].layouts
        return not all(holding.owns(spot.home) or custody.at(layouts[spot.place.space], spot.home) for spot in found)

    async def _talk(self) -> None:
        """Everybody tells everybody how it is."""
        position = 0
        while True:
            registry = self.log.registry
            awake = [home for home in self.homes if home.line is not None and home.own is not None]
            for home in awake:
                if registry.position != position or home.roster.position != registry.position:
                    home.roster.set_members(registry, home._world.clock.now())
                home.own.log_position = registry.position
            position = registry.position
            for home in awake:
                status = home.own.signed()
                for other in awake:
                    if other is not home and self.net.reaches((home.address, other.address)):
                        other.roster.hear(status, other._world.clock.now())
            await trio.sleep(TALK_S)
