"""Nodes that live in memory and misbehave on order: for tests of what the client does about it.

They answer the packets that a client sends, judge versions as a store does, know the current owners, and can be
away, busy or slow. Requests pass through the real codec, so that nothing is tested that could not travel.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import trio

from scenefold.base.errors import Refused, Unreachable
from scenefold.base.ids import NodeId, address_of, node_id_of
from scenefold.base.location import FIRST, Arc, Location, even_right_bounds
from scenefold.base.reasons import RejectReason
from scenefold.client.calls import Calls
from scenefold.client.table import Owner, RoutingTable
from scenefold.crypto import RecordHeader, SigningKey, object_of
from scenefold.peer.records.verification import KnownScene, verified_put
from scenefold.peer.scene_log.proposals import accepted, decide, rejection
from scenefold.scene.log import Decider
from scenefold.store.judging import judge
from scenefold.wire import (
    DAMAGED_RECORD,
    Fault,
    GetMany,
    GetManyReply,
    ListScenes,
    Packet,
    ProposeSceneLog,
    PutItem,
    PutMany,
    PutManyReply,
    PutOutcome,
    QueryRange,
    RecordBytes,
    RecordKey,
    RejectRange,
    RequestSceneLog,
    RequestTable,
    RespondSceneLog,
    RespondTable,
    ReturnRange,
    SceneLogAnswer,
    SceneLogPublic,
    Status,
    Want,
    decode_packet,
    encode_packet,
    page_of,
)
from scenefold.world import Priority, World
from unit.client.wrecks_made import header_of, judge_of_wreck

KEEPER_KEY = SigningKey(b"f" * 32)
ORIGIN = Decider(node_id_of("127.0.0.2"), KEEPER_KEY.public.raw)
"""The node that decides the logs of all scenes."""


class PlainClock:
    stopwatch = None

    def now(self) -> float:
        return trio.current_time()

    def wall(self) -> float:
        return 1_700_000_000.0 + trio.current_time()

    async def sleep(self, seconds: float) -> None:
        await trio.sleep(seconds)


class PlainEntropy:
    """Different every time, whoever asks."""

    _counts = itertools.count(1)

    def token(self, count: int) -> bytes:
        return next(self._counts).to_bytes(8, "big").rjust(count, b"\x5a")[-count:]

    def uniform(self) -> float:
        return 0.5


class PlainWorkers:
    async def run(self, lane: str, function: Callable[..., Any], *args: object) -> Any:
        assert lane in ("crypto", "import")
        await trio.lowlevel.checkpoint()
        return function(*args)


def make_world() -> World:
    nothing: Any = None
    return World(PlainClock(), PlainEntropy(), PlainWorkers(), nothing, nothing)


@dataclass
class FakeNodes:
    """All nodes of a cluster; also the `Links` to them, which raise what a Fault says, as real ones do."""

    addresses: tuple[str, ...] = ("127.0.0.2", "127.0.0.3", "127.0.0.4")
    records: dict[tuple[int, Location], PutItem] = field(default_factory=dict)
    headers: dict[int, SceneLogPublic] = field(default_factory=dict)
    logs: dict[int, bytes] = field(default_factory=dict)
    before_proposals: list[Callable[[], Any]] = field(default_factory=list)
    """Done, one for each proposal, before it is looked at: what somebody else does at that moment."""
    away: set[str] = field(default_factory=set)
    hung: set[str] = field(default_factory=set)
    """They take requests and never answer."""
    slow: dict[str, float] = field(default_factory=dict)
    """Seconds that each answer of a node takes."""
    busy: Counter[str] = field(default_factory=Counter)
    """How many requests of each node are still answered with busy."""
    lost_replies: int = 0
    """So many replies are lost after the request was carried out."""
    reply_records_max: int = 1000
    range_max: int = 1000
    without_lease: set[str] = field(default_factory=set)
    """They take no writes, and mark what they read as stale."""
    behind: set[str] = field(default_factory=set)
    """They go by a header of before the scene's newest write floor, and cannot get the newer one."""
    shown: dict[str, SceneLogPublic] = field(default_factory=dict)
    """What nodes list in place of a scene's header."""
    deaf: set[str] = field(default_factory=set)
    """They have heard of no scene yet."""
    losing_lease: set[str] = field(default_factory=set)
    """They store one more record, and have no lease by the time that they could say so."""
    rotten: set[Location] = field(default_factory=set)
    """Places whose records have changed on the disk."""
    wrecks: set[Location] = field(default_factory=set)
    """Places whose records' headers have, though not in what says their versions. What is put over one heals it."""
    liars_of_damage: set[str] = field(default_factory=set)
    """They say of whatever is put that a damaged record lies there."""
    helpers: set[str] = field(default_factory=set)
    """They store whatever somebody signs, under whichever key and epoch."""
    ill_timed: Callable[[], None] | None = None
    """Called once, between a lost reply and the next request."""
    asked: list[tuple[str, Packet]] = field(default_factory=list)

    def __post_init__(self) -> None:
        bounds = even_right_bounds(len(self.addresses))
        self.table = RoutingTable(map(Owner, map(node_id_of, self.addresses), self.addresses, bounds))
        self.claims: dict[str, Arc] = {}
        """What nodes say of their arcs that is not so, or not any more."""

    def move_bounds(self) -> None:
        """All arcs move on by one node; clients don't know yet."""
        owners = self.table.owners
        moved = [replace(owner, right_bound=owners[index - 1].right_bound, lamport=9) for index, owner in enumerate(owners)]
        self.table = RoutingTable(moved)

    def give_all(self, giver: str, receiver: str) -> None:
        """All of a node's arc goes to a neighbour."""
        owners = {owner.address: owner for owner in self.table.owners}
        if owners[receiver].right_bound < owners[giver].right_bound:  # type: ignore[operator]
            owners[receiver] = replace(owners[receiver], right_bound=owners[giver].right_bound)
        owners[giver] = replace(owners[giver], right_bound=None)
        self.table = RoutingTable(owners.values())

    def calls(self) -> Calls:
        """A client that believes in even arcs."""
        links: Any = self
        return Calls(make_world(), links, self.addresses, [node_id_of(address) for address in self.addresses])

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        del priority
        packet = decode_packet(encode_packet(replace(packet, request_id=7)))
        self.asked.append((address, packet))
        await trio.lowlevel.checkpoint()
        if address in self.hung:
            await trio.sleep(timeout)
            raise Unreachable("it does not answer", where=address)
        if address in self.away:
            raise Unreachable("nobody there", where=address)
        if address in self.slow:
            await trio.sleep(self.slow[address])
        if self.busy[address]:
            self.busy[address] -= 1
            raise Refused(RejectReason.BUSY, "later", where=address)
        reply = self._answer(address, packet)
        if self.lost_replies:
            self.lost_replies -= 1
            if self.ill_timed is not None:
                self.ill_timed, happens = None, self.ill_timed
                happens()
            raise Unreachable("the connection broke", where=address)
        reply = decode_packet(encode_packet(reply))
        if isinstance(reply, Fault):
            raise Refused(reply.reason, reply.text, where=address)
        return reply

    def _answer(self, address: str, packet: Packet) -> Packet:
        match packet:
            case RequestTable():
                return RespondTable(tuple(self._status(owner) for owner in self.table.owners))
            case PutMany():
                return PutManyReply(tuple(self._put(address, item) for item in packet.items))
            case GetMany():
                found = [self._found(key) for key in packet.keys[: self.reply_records_max]]
                records = [None if item is None else RecordBytes(item.signature, item.header, item.ciphertext) for item in found]
                records = [
                    DAMAGED_RECORD if key.location in self.rotten | self.wrecks else record
                    for key, record in zip(packet.keys, records, strict=False)
                ]
                header = self.headers.get(packet.scene)
                position, floor = (0, 0) if header is None else (header.position, header.write_floor)
                return GetManyReply(tuple(records), address in self.without_lease, position, 0 if address in self.behind else floor)
            case QueryRange():
                return self._query(address, packet)
            case ProposeSceneLog():
                if self.before_proposals:
                    self.before_proposals.pop()()
                return self._propose(packet)
            case RequestSceneLog():
                header = self.headers.get(packet.scene)
                private = (
                    self.logs.get(packet.scene) if packet.want is Want.LOG and header and address_of(header.origin) == address else None
                )
                answer = header and SceneLogAnswer(packet.nonce, 2, 1, header, private)
                return RespondSceneLog(answer)
            case ListScenes():
                heard = () if address in self.deaf else ((self.shown[address],) if address in self.shown else self.headers.values())
                return page_of(sorted(heard, key=lambda header: header.scene), packet.after)
            case _:
                return Fault(RejectReason.ILL_FORMED, "what?")

    def _found(self, key: RecordKey) -> PutItem | None:
        """An object is found wherever it lies, if not where it is looked for."""
        here = self.records.get((key.space, key.location))
        if here is not None or not key.object:
            return here
        return next((item for item in self.records.values() if object_of(RecordHeader.decode(item.header)) == key.object), None)

    def _status(self, owner: Owner) -> Status:
        arc = self.claims.get(owner.address) or next((arc for holder, arc in self.table.arcs() if holder is owner), None)
        fence = None if arc is None or arc.first == FIRST else Location.from_number(arc.first.number - 1)
        return Status(owner.lamport, owner.node_id, bytes(16), 1, owner.address, fence, None if arc is None else arc.last)

    def _propose(self, packet: ProposeSceneLog) -> Packet:
        known = self.headers.get(packet.public.scene)
        try:
            scene = decide(packet, None if known is None else KnownScene.of(known), KEEPER_KEY, has_log=True)
        except Refused as refusal:
            return rejection(refusal.reason, NodeId(0))
        self.headers[packet.public.scene] = scene.public
        self.logs[packet.public.scene] = packet.private
        return accepted(scene.public)

    def _put(self, address: str, item: PutItem) -> PutOutcome:
        if address in self.without_lease:
            return PutOutcome(RejectReason.NOT_READY, item.location, node_id_of(address))
        if address in self.losing_lease:
            self.losing_lease.remove(address)
            self._put(address, item)
            self.without_lease.add(address)
            return PutOutcome(RejectReason.NOT_READY, item.location, NodeId(0))
        new = RecordHeader.decode(item.header)
        if new.placement and item.location == new.location:
            item = replace(item, location=self._choose(address, new))
        owner = self.table.owner_of(item.location)
        if owner.address != address:
            return PutOutcome(RejectReason.NOT_MY_LOCATION, item.location, owner.node_id)
        if address in self.liars_of_damage:
            return PutOutcome(RejectReason.DAMAGED, item.location, NodeId(0))
        present = self.records.get((item.space, item.location))
        header = self.headers.get(item.scene)
        if header is not None and address not in self.helpers:
            try:
                verified_put(item, KnownScene.of(header))
            except Refused as refusal:
                return PutOutcome(refusal.reason, item.location, NodeId(0))
        reason = (judge_of_wreck(item, present) if item.location in self.wrecks and present else judge(new, header_of(present))).reason
        if reason is not None:
            return PutOutcome(reason, item.location, NodeId(0))
        self.wrecks.discard(item.location)
        self.records[item.space, item.location] = item
        return PutOutcome(0, item.location, NodeId(0))

    def _choose(self, address: str, header: RecordHeader) -> Location:
        """A place in this node's arc, the same for the same object."""
        arc = next(arc for owner, arc in self.table.arcs() if owner.address == address)
        return Location.from_number(arc.first.number + 1 + header.location.number % (1 << 64))

    def _query(self, address: str, packet: QueryRange) -> Packet:
        if self.table.owner_of(packet.first).address != address:
            return RejectRange(packet.scene, packet.space, packet.first, RejectReason.OUTSIDE_BOUNDS)
        found = sorted(location for space, location in self.records if space == packet.space and packet.first <= location <= packet.last)
        if len(found) > 3 * self.range_max:
            return RejectRange(packet.scene, packet.space, packet.first, RejectReason.TOO_LARGE_FOR_PACKET)
        last = packet.last if len(found) <= self.range_max else found[self.range_max - 1]
        headers = [RecordHeader.decode(self.records[packet.space, location].header) for location in found[: self.range_max]]
        objects = tuple(bytes(header.location[4:]) for header in headers if header.placement)
        stale = address in self.without_lease
        return ReturnRange(packet.scene, packet.space, packet.first, last, tuple(found[: self.range_max]), objects, stale)
