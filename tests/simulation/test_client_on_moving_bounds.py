"""If this fails, what the client promises does not hold where bounds move and leases run out: the real client on real data services.

In a simulated world, without TLS: requests of the client are handled by the nodes' data services directly.
"""

from __future__ import annotations

import random
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
import trio

from scenefold.base.errors import Refused, ScenefoldError, Unreachable
from scenefold.base.ids import address_of, node_id_of
from scenefold.base.location import FIRST, LAST, Location
from scenefold.base.reasons import RejectReason
from scenefold.client.access import SceneAccess
from scenefold.client.calls import Calls
from scenefold.client.managed import ManagedPlace
from scenefold.client.scene import Scene
from scenefold.client.sealing import SceneIdentity
from scenefold.client.space import ABSENT
from scenefold.client.verifying import WriterKey
from scenefold.crypto import wanted_place
from scenefold.scene.log import EpochKeys
from scenefold.store import Put
from scenefold.wire import Fault, Packet, PutMany, PutManyReply, RequestTable, RespondTable, Status
from scenefold.world import Priority
from unit.peer.data_nodes import LEFT, MIDDLE, RIGHT, SCENE, Neighbours, Node, arc, managed_item, with_nodes
from unit.peer.scenes_made import SPACE, SYMMETRIC_KEY, WRITER

LINE_END = (1 << 160) - 1
OTHER = bytes([20]) * 16


class DirectLinks:
    """A client's requests to nodes; a Fault is raised, as by real links. Answers get lost on order."""

    def __init__(self, neighbours: Neighbours) -> None:
        self._neighbours = neighbours
        self.lost = 0
        self._lamport = 0

    async def request(self, address: str, _priority: Priority, packet: Packet, _timeout: float) -> Packet:
        await trio.sleep(0.001)
        node = self._neighbours.nodes[node_id_of(address)]
        if node.me in self._neighbours.away:
            raise Unreachable("nobody there", where=address)
        if isinstance(packet, RequestTable):
            return RespondTable(tuple(map(self._status, self._neighbours.nodes.values())))
        reply = await node.ask(packet)
        if self.lost:
            self.lost -= 1
            raise Unreachable("the connection broke", where=address)
        if isinstance(reply, Fault):
            raise Refused(reply.reason, reply.text, where=address)
        return reply

    def _status(self, node: Node) -> Status:
        self._lamport += 1
        held = node.line.arc
        fence = None if held is None or held.first == FIRST else Location.from_number(held.first.number - 1)
        bounds = {} if held is None else {"left_fence": fence, "right_bound": held.last}
        return Status(lamport=self._lamport, node=node.me, incarnation=bytes(16), boot=1, address=address_of(node.me), **bounds)  # type: ignore[arg-type]


class FickleLinks(DirectLinks):
    """Any answer to a write may get lost, and at any request the bound may move."""

    def __init__(self, neighbours: Neighbours, dice: random.Random, move: Callable[[], Awaitable[None]]) -> None:
        super().__init__(neighbours)
        self._dice = dice
        self._move = move
        self.moves = 0
        self.calm = False

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        reply = await super().request(address, priority, packet, timeout)
        if isinstance(packet, PutMany) and not self.calm:
            if self._dice.random() < 0.3:
                self.moves += 1
                await self._move()
            if self._dice.random() < 0.3:
                raise Unreachable("the connection broke", where=address)
        return reply


def client(neighbours: Neighbours, links: Any = None, session: int = 1) -> Scene:
    nodes = list(neighbours.nodes)
    world = neighbours.net.world(f"user:ada{session}")
    calls = Calls(world, links or DirectLinks(neighbours), [address_of(node) for node in nodes], nodes)  # type: ignore[arg-type]
    identity = SceneIdentity(SCENE.scene, SCENE.genesis, 1, {WRITER.key_id: WriterKey.always(WRITER.public)}, EpochKeys.only(SYMMETRIC_KEY))
    return Scene(SceneAccess(calls, "kitchen", identity, WRITER, session))


async def move_bound(one: Node, other: Node, bound: int) -> None:
    """Hand the piece between the bound as it is and as it shall be to the other side, as the line does."""
    assert one.line.arc is not None and other.line.arc is not None
    before = one.line.arc.last.number
    giver, taker = (one, other) if bound < before else (other, one)
    piece = arc(min(bound, before) + 1, max(bound, before))
    arcs = {one.me: arc(0, bound), other.me: arc(bound + 1, LINE_END)}
    await giver.line.freeze(piece)
    await giver.line.drained()
    await giver.store.slide([piece, arcs[giver.me]])
    entries = (await giver.store.manifest(piece, None, 1000)).entries
    puts = []
    for entry, record in zip(entries, await giver.store.read([entry.spot for entry in entries]), strict=True):
        assert record is not None and not isinstance(record, ScenefoldError)
        puts.append(Put(record, at=entry.place.location if entry.object else None))
    await taker.store.merge(puts)
    await giver.line.change(arcs[giver.me])
    await giver.line.freeze(None)
    await trio.sleep(0.02)
    await taker.line.change(arcs[taker.me])
    await giver.store.remove([(entry.spot, entry.digest) for entry in entries])


@pytest.mark.parametrize("seed", range(5))
def test_nothing_that_the_client_was_told_is_lost(seed: int) -> None:
    async def test(neighbours: Neighbours, one: Node, other: Node) -> None:
        space = client(neighbours).space(SPACE)
        places = [Location.from_number(LINE_END // 40 * index) for index in range(40)]
        stop = trio.Event()

        async def move() -> None:
            shares = (30, 60, 20, 50)
            while not stop.is_set():
                for share in shares:
                    await trio.sleep(0.2)
                    await move_bound(one, other, LINE_END // 100 * share)
                    for node in (one, other):
                        node.lease.held = not node.lease.held
                    # Away a fifth of the time: hardly ever do all tries of one call, twelve, come just then.
                    await trio.sleep(0.1)
                    for node in (one, other):
                        node.lease.held = True
                    await trio.sleep(0.2)

        async def write(mine: list[Location], session: int) -> None:
            space = client(neighbours, session=session).space(SPACE)
            digests = {place: await space.put(place, b"0", expect=ABSENT) for place in mine}
            for turn in range(1, 6):
                for place in mine:
                    digests[place] = await space.put(place, b"%d" % turn, expect=digests[place])
                    assert await space.get(place) == b"%d" % turn

        async with trio.open_nursery() as nursery:
            nursery.start_soon(move)
            async with trio.open_nursery() as writers:
                writers.start_soon(write, places[::2], 2)
                writers.start_soon(write, places[1::2], 3)
            assert await space.get_many(places) == [b"5"] * len(places)
            assert [place async for place in space.query()] == places
            await space.delete(places[0])
            assert await space.get(places[0]) is None
            stop.set()
            nursery.cancel_scope.cancel()

    with_nodes(test, LEFT, RIGHT, seed=seed)


def test_node_managed_records_are_where_their_ids_say_and_are_found_again() -> None:
    async def test(neighbours: Neighbours, one: Node, other: Node) -> None:
        records = client(neighbours).space(SPACE).managed
        stored = [(await records.put(b"image %d" % number)).place for number in range(30)]
        assert {other.line.owns(place.location) for place in stored} == {True, False}
        parted = stored[0].object
        bound = wanted_place(parted).number
        # Something lay at its home once, so the node has chosen another place; now the bound comes between the two.
        await client(neighbours, session=2).space(SPACE).put(wanted_place(OTHER), b"taken")
        displaced = await records._put(OTHER, b"other", ABSENT)
        assert displaced.place.location == wanted_place(OTHER).next()
        for at in (MIDDLE // 4, bound, wanted_place(OTHER).number, MIDDLE):
            await move_bound(one, other, at)
            listed = [place async for place in records.query()]
            assert sorted(place.object for place in listed) == sorted([OTHER, *(place.object for place in stored)])
            for place in listed:
                owner = one if one.line.owns(place.location) else other
                assert owner.line.owns(wanted_place(place.object)), "the node that decides about it has it"
            by_object = {OTHER: b"other"} | {place.object: b"image %d" % number for number, place in enumerate(stored)}
            assert await records.get(listed) == [by_object[place.object] for place in listed]
            assert await records.get(stored) == [by_object[place.object] for place in stored], "at an old place as well"
        await records.delete(stored[0])
        assert await records.get(stored[:2]) == [None, b"image 1"]
        assert stored[0].object not in [place.object async for place in records.query()]
        assert stored[0].object in [place.object async for place in records.query(deleted=True)]

    with_nodes(test, LEFT, RIGHT)


@pytest.mark.parametrize("seed", range(12))
def test_one_record_an_id_whatever_answers_are_lost_and_wherever_bounds_go(seed: int) -> None:
    async def test(neighbours: Neighbours, one: Node, other: Node) -> None:
        dice = random.Random(seed)
        links = FickleLinks(neighbours, dice, lambda: move_bound(one, other, dice.randrange(1, LINE_END)))
        records = client(neighbours, links).space(SPACE).managed
        kept: dict[ManagedPlace, set[bytes | None]] = {}
        for number in range(60):
            text, place = b"%d" % number, dice.choice([None, *kept])
            try:
                if place is None:
                    kept[(await records.put(text)).place] = {text}
                elif dice.random() < 0.8:
                    kept[place].add(text)
                    await records.replace(place, text)
                    kept[place] = {text}
                else:
                    kept[place].add(None)
                    await records.delete(place)
                    kept[place] = {None}
            except (Refused, Unreachable):
                # Nobody can tell what became of it.
                continue
        links.calm = True
        everything = [place async for place in records.query(deleted=True)]
        assert len({place.object for place in everything}) == len(everything)
        assert {place.object for place in kept} <= {place.object for place in everything}
        found = await records.get(list(kept))
        assert all(payload in possible for payload, possible in zip(found, kept.values(), strict=True))
        alive = {place.object for place, payload in zip(kept, found, strict=True) if payload is not None}
        listed = {place.object async for place in records.query()}
        assert alive == listed & {place.object for place in kept}
        for owner in (one, other):
            entries = (await owner.store.manifest(arc(0, LINE_END), None, 1000)).entries
            assert all(owner.line.owns(entry.home) and owner.line.owns(entry.place.location) for entry in entries)
        assert links.moves > 5

    with_nodes(test, LEFT, RIGHT, seed=seed)


def test_the_same_bytes_at_every_node_are_one_record() -> None:
    async def test(neighbours: Neighbours, one: Node, other: Node) -> None:
        item = managed_item(OTHER)
        reasons = []
        for node in (one, other, one):
            reply = await node.ask(PutMany((item,)))
            assert isinstance(reply, PutManyReply)
            reasons += [outcome.reason for outcome in reply.outcomes]
        await move_bound(one, other, wanted_place(OTHER).number - 1)
        for node in (one, other):
            reply = await node.ask(PutMany((item,)))
            assert isinstance(reply, PutManyReply)
            reasons += [outcome.reason for outcome in reply.outcomes]
        no = RejectReason.NOT_MY_LOCATION
        assert reasons == [0, no, 0, no, 0]
        records = client(neighbours).space(SPACE).managed
        [place] = [place async for place in records.query()]
        await records.delete(place)
        assert await records.get([place]) == [None]
        assert [place async for place in records.query()] == []

    with_nodes(test, LEFT, RIGHT)


def test_a_lost_answer_never_becomes_a_wrong_no() -> None:
    async def test(neighbours: Neighbours, one: Node, _: Node) -> None:
        links = DirectLinks(neighbours)
        space = client(neighbours, links).space(SPACE)
        links.lost = 1
        digest = await space.put(FIRST, b"once", expect=ABSENT)
        links.lost = 1
        await space.put(FIRST, b"twice", expect=digest)
        assert await space.get(FIRST) == b"twice"
        one.lease.lost_after = 1
        await space.put(LAST, b"elsewhere")
        # Without a lease nothing is judged, and who has lost it may have stored the record before.
        with pytest.raises(Unreachable, match="may have happened"):
            await space.put(FIRST, b"never", expect=digest)

    with_nodes(test, LEFT, RIGHT)
