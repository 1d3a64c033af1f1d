"""If this fails, what the client promises does not hold where bounds move and leases run out: the real client on real data services.

In a simulated world, without TLS: requests of the client are handled by the nodes' data services directly.
"""

from __future__ import annotations

from typing import Any

import pytest
import trio

from scenefold.base.errors import Refused, ScenefoldError, Unreachable
from scenefold.base.ids import address_of, node_id_of
from scenefold.base.location import FIRST, LAST, Location
from scenefold.base.reasons import RejectReason
from scenefold.client.access import SceneAccess
from scenefold.client.calls import Calls
from scenefold.client.scene import Scene
from scenefold.client.sealing import SceneIdentity
from scenefold.client.space import ABSENT
from scenefold.store import Put
from scenefold.wire import Packet, RequestTable, RespondTable, Status
from scenefold.world import Priority
from unit.peer.data_nodes import LEFT, MIDDLE, RIGHT, SCENE, Neighbours, Node, arc, with_nodes
from unit.peer.scenes_made import SPACE, SYMMETRIC_KEY, WRITER

LINE_END = (1 << 160) - 1


class DirectLinks:
    """A client's requests to nodes. Answers get lost on order."""

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
        return reply

    def _status(self, node: Node) -> Status:
        self._lamport += 1
        held = node.line.arc
        fence = None if held is None or held.first == FIRST else Location.from_number(held.first.number - 1)
        bounds = {} if held is None else {"left_fence": fence, "right_bound": held.last}
        return Status(lamport=self._lamport, node=node.me, incarnation=bytes(16), boot=1, address=address_of(node.me), **bounds)  # type: ignore[arg-type]


def client(neighbours: Neighbours, links: Any = None, session: int = 1) -> Scene:
    nodes = list(neighbours.nodes)
    world = neighbours.net.world(f"user:ada{session}")
    calls = Calls(world, links or DirectLinks(neighbours), [address_of(node) for node in nodes], nodes)  # type: ignore[arg-type]
    identity = SceneIdentity(SCENE.scene, SCENE.genesis, 1, {WRITER.key_id: WRITER.public}, SYMMETRIC_KEY, 0)
    return Scene(SceneAccess(calls, "kitchen", identity, WRITER, session))


async def move_bound(one: Node, other: Node, bound: int) -> None:
    """Hand the piece between the bound as it is and as it shall be to the other side, as the line does."""
    assert one.line.arc is not None and other.line.arc is not None
    before = one.line.arc.last.number
    giver, taker = (one, other) if bound < before else (other, one)
    piece = arc(min(bound, before) + 1, max(bound, before))
    arcs = {one.me: arc(0, bound), other.me: arc(bound + 1, LINE_END)}
    while await giver.store.slide(piece, arcs[giver.me]):
        pass
    await giver.line.freeze(piece)
    await giver.line.drained()
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
                    await trio.sleep(0.3)
                    for node in (one, other):
                        node.lease.held = True

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


def test_node_managed_records_slide_along_and_are_found_again() -> None:
    async def test(neighbours: Neighbours, one: Node, other: Node) -> None:
        records = client(neighbours).space(SPACE).managed
        stored = [(await records.put(b"image %d" % number)).place for number in range(30)]
        assert {other.line.owns(place.location) for place in stored} == {True, False}
        kept_by_one = {place.object for place in stored if one.line.owns(place.location)}
        await move_bound(one, other, MIDDLE // 4)
        listed = [place async for place in records.query()]
        assert sorted(place.object for place in listed) == sorted(place.object for place in stored)
        assert {place.object for place in listed if one.line.owns(place.location)} == kept_by_one, "they stayed with their node"
        payloads = dict(zip(stored, range(30), strict=True))
        by_object = {place.object: b"image %d" % number for place, number in payloads.items()}
        assert await records.get(listed) == [by_object[place.object] for place in listed]
        await records.delete(listed[0])
        assert await records.get(listed[:2]) == [None, by_object[listed[1].object]]

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
        with pytest.raises(Refused) as refused:
            await space.put(FIRST, b"never", expect=digest)
        assert refused.value.reason in (RejectReason.NOT_READY, RejectReason.BUSY), "without a lease nothing is judged"

    with_nodes(test, LEFT, RIGHT)
