"""If this fails, one node can tell a client where all others are, and the client never finds them again; or list for others."""

from __future__ import annotations

from dataclasses import dataclass, replace

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import PeerFault
from scenefold.base.ids import NodeId, address_of, node_id_of
from scenefold.base.location import FIRST, LAST, Location
from scenefold.client.ranging import SHORT_MAX
from scenefold.wire import MiniStatus, Packet, QueryRange, RequestTable, RespondTable, ReturnRange
from scenefold.world import Priority
from unit.client.fake_nodes import FakeNodes
from unit.client.test_records import FILES, ITEMS, PLACES, _scene

LIAR, VICTIM, THIRD = FakeNodes().addresses
NOBODY = NodeId(node_id_of("10.99.99.1"))


class Liars(FakeNodes):
    """The first node answers some packets as it likes."""

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        reply = await super().request(address, priority, packet, timeout)
        return self.twisted(packet, reply) if address == LIAR else reply

    def twisted(self, packet: Packet, reply: Packet) -> Packet:
        return reply


class NamesNobody(Liars):
    def twisted(self, packet: Packet, reply: Packet) -> Packet:
        if not isinstance(reply, RespondTable):
            return reply
        return replace(reply, statuses=tuple(replace(status, node=NOBODY, address=address_of(NOBODY)) for status in reply.statuses))

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if address == address_of(NOBODY):
            self.hung.add(address)
        return await super().request(address, priority, packet, timeout)


async def test_a_table_of_nobody_is_got_rid_of(autojump_clock: MockClock) -> None:
    nodes = NamesNobody()
    scene = _scene(nodes)
    await scene.access.calls.refresh(node_id_of(LIAR))
    assert [owner.node_id for owner in scene.access.calls.table.owners] == [NOBODY]
    with trio.fail_after(60):
        await scene.space(FILES).put_many(ITEMS)
    assert len(nodes.records) == len(ITEMS)


@dataclass
class SendsAllToItself(Liars):
    named: str = LIAR

    def twisted(self, packet: Packet, reply: Packet) -> Packet:
        if not isinstance(reply, RespondTable):
            return reply
        return replace(reply, statuses=tuple(replace(status, address=self.named) for status in reply.statuses))


@pytest.mark.parametrize("named", [LIAR, f"{LIAR}:17349", "nonsense", "", "::1"])
async def test_no_node_is_asked_at_the_address_of_another(named: str, autojump_clock: MockClock) -> None:
    scene = _scene(SendsAllToItself(named=named))
    await scene.access.calls.refresh(node_id_of(LIAR))
    assert sorted(owner.address for owner in scene.access.calls.table.owners) == [LIAR, VICTIM, THIRD]


class SpeaksForOthers(Liars):
    def twisted(self, packet: Packet, reply: Packet) -> Packet:
        mini = MiniStatus((1 << 63) - 1, node_id_of(VICTIM), FIRST, 0, 0, 0, 0, 0)
        return replace(reply, mini_status=mini)


async def test_what_a_node_says_of_another_in_passing_does_not_count(autojump_clock: MockClock) -> None:
    nodes = SpeaksForOthers()
    calls = nodes.calls()
    known = calls.table.by_id(node_id_of(VICTIM))
    await calls.ask(LIAR, RequestTable(), RespondTable)
    assert calls.table.by_id(node_id_of(VICTIM)) == known


class ListsElsewhere(Liars):
    extra: tuple[Location, ...] = ()

    def twisted(self, packet: Packet, reply: Packet) -> Packet:
        return replace(reply, locations=(*reply.locations, *self.extra)) if isinstance(reply, ReturnRange) else reply


@pytest.mark.parametrize("extra", [(LAST,), (FIRST,), (PLACES[0], PLACES[0])])
async def test_a_list_of_what_was_not_asked_for_is_no_answer(extra: tuple[Location, ...], autojump_clock: MockClock) -> None:
    nodes = ListsElsewhere()
    space = _scene(nodes).space(FILES)
    await space.put_many(ITEMS)
    nodes.extra = extra
    with pytest.raises(PeerFault, match="not about"):
        assert [location async for location in space.query(PLACES[1])] == PLACES[1:]
    assert any(isinstance(packet, QueryRange) for _, packet in nodes.asked)


class CoversOnePlace(Liars):
    lists_it = False

    def twisted(self, packet: Packet, reply: Packet) -> Packet:
        if not isinstance(reply, ReturnRange):
            return reply
        return replace(reply, last=reply.first, locations=(reply.first,) if self.lists_it else (), objects=())


@pytest.mark.parametrize("lists_it", [False, True], ids=["nothing", "that place"])
async def test_who_covers_place_after_place_and_lists_next_to_nothing_is_not_asked_for_ever(
    lists_it: bool, autojump_clock: MockClock
) -> None:
    nodes = CoversOnePlace()
    nodes.lists_it = lists_it
    space = _scene(nodes).space(FILES)
    await space.put_many(ITEMS)
    with pytest.raises(PeerFault, match="ever smaller parts"):
        [location async for location in space.query()]
    assert sum(address == LIAR and isinstance(packet, QueryRange) for address, packet in nodes.asked) == SHORT_MAX + 1


async def test_an_empty_line_is_walked_to_its_end_again_and_again(autojump_clock: MockClock) -> None:
    space = _scene(FakeNodes()).space(FILES)
    for _ in range(SHORT_MAX + 1):
        assert [location async for location in space.query()] == []
