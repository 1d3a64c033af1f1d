"""If this fails, a holder gets a packet for each record, or what is written waits for one that does not come back."""

from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any, cast

import pytest
import trio
import trio.testing

from scenefold.base.ids import NodeId
from scenefold.base.location import FIRST, LAST, Arc
from scenefold.crypto import RecordPlace
from scenefold.peer.line.unsettled import Pending
from scenefold.peer.replication import lane
from scenefold.peer.replication.lane import GATHER_S_MAX, Lane, item_of
from scenefold.store import Spot
from scenefold.wire import CopiesStored, Member, StoreCopies
from unit.peer.line.street import places
from unit.peer.replication.terrace import record_at

NODE = NodeId(2)
MEMBER = Member(NODE, bytes(16))
SPOTS = places(Arc(FIRST, LAST), 200)


class Holder:
    """Who is sent copies, and answers when it is told to. Also the desk of the lane."""

    def __init__(self) -> None:
        self.packets: list[int] = []
        """The records in each that has come."""
        self.waiting: list[trio.Event] = []
        self.taken_by: list[Pending] = []
        self._sent = 0
        parts = SimpleNamespace(
            world=SimpleNamespace(entropy=SimpleNamespace(uniform=lambda: 0.5)),
            own=SimpleNamespace(member=Member(NodeId(1), bytes(16))),
            keeper=SimpleNamespace(copies=None),
            carrying=SimpleNamespace(begun=nullcontext),
            peers=self,
        )
        self.lane = Lane(cast(Any, parts), self, NODE)

    async def ask(self, _node: NodeId, _priority: object, packet: StoreCopies, _answer: object, _timeout: float) -> CopiesStored:
        self.packets.append(len(packet.items))
        self.waiting.append(trio.Event())
        await self.waiting[-1].wait()
        return CopiesStored((0,) * len(packet.items), "")

    async def send(self, count: int) -> list[Pending]:
        """One write after the other."""
        sent: list[Pending] = []
        for _ in range(count):
            place = SPOTS[self._sent]
            self._sent += 1
            record = record_at(place)
            spot = Spot(RecordPlace(record.header.scene, record.header.space, place))
            size = len(record.ciphertext)
            sent.append(Pending(spot, bytes(32), (), 2, frozenset((NODE,)), set(), size, item_of(spot, record), is_stored=True))
            self.lane.send(sent[-1])
            await trio.testing.wait_all_tasks_blocked()
        return sent

    async def answer(self, number: int) -> None:
        self.waiting[number].set()
        await trio.testing.wait_all_tasks_blocked()

    def member_at(self, _node: NodeId) -> Member:
        return MEMBER

    def is_alive(self, _node: NodeId) -> bool:
        return True

    def is_target(self, _pending: Pending, _member: Member) -> bool:
        return True

    def is_replaced(self, _pending: Pending) -> bool:
        raise AssertionError

    async def taken(self, _member: Member, pendings: Any) -> None:
        self.taken_by += pendings


async def test_what_is_written_while_a_packet_is_on_its_way_goes_together(
    nursery: trio.Nursery, autojump_clock: trio.testing.MockClock
) -> None:
    holder = Holder()
    nursery.start_soon(holder.lane.run)
    await holder.send(1)
    assert holder.packets == [1], "the first waits for nothing"
    await holder.send(20)
    assert holder.packets == [1]
    await holder.answer(0)
    assert holder.packets == [1, 20]
    await holder.send(3)
    await holder.answer(1)
    await holder.answer(2)
    assert holder.packets == [1, 20, 3]
    assert len(holder.taken_by) == 24
    await holder.send(1)
    assert holder.packets == [1, 20, 3, 1]


async def test_what_fills_a_packet_waits_for_none(
    nursery: trio.Nursery, autojump_clock: trio.testing.MockClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lane, "FULL_BYTES", 4 * lane.RECORD_BYTES)
    holder = Holder()
    nursery.start_soon(holder.lane.run)
    await holder.send(1)
    await holder.send(40)
    assert len(holder.packets) == lane.FLIGHTS
    assert 1 < min(holder.packets[1:]) <= max(holder.packets[1:]) <= 4
    for number in range(lane.FLIGHTS):
        await holder.answer(number)
    await holder.answer(lane.FLIGHTS)
    assert sum(holder.packets) == len(holder.taken_by) == 41


async def test_what_waits_for_a_packet_that_does_not_come_back_goes_without_it(
    nursery: trio.Nursery, autojump_clock: trio.testing.MockClock
) -> None:
    holder = Holder()
    nursery.start_soon(holder.lane.run)
    await holder.send(6)
    assert holder.packets == [1]
    await trio.sleep(GATHER_S_MAX / 2)
    await holder.send(2)
    assert holder.packets == [1]
    await trio.sleep(GATHER_S_MAX / 2 + 0.01)
    assert holder.packets == [1, 7]
    await holder.send(2)
    assert holder.packets == [1, 7]
    await trio.sleep(GATHER_S_MAX + 0.01)
    assert holder.packets == [1, 7, 2]
    assert not holder.taken_by


async def test_what_waits_for_a_slow_holder_is_bounded_by_all_that_it_costs(
    nursery: trio.Nursery, autojump_clock: trio.testing.MockClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of small records the ciphertexts are the least."""
    monkeypatch.setattr(lane, "BACKLOG_BYTES_MAX", 32 * lane.WAITING_BYTES)
    holder = Holder()
    nursery.start_soon(holder.lane.run)
    pendings = await holder.send(60)
    assert all(map(holder.lane.has, pendings)), "somebody waits for these"
    for pending in pendings:
        pending.is_settled = True
        holder.lane.settled(pending)
    kept = [pending for pending in pendings if holder.lane.has(pending)]
    assert 16 < len(kept) < 32
    assert holder.lane.is_behind, "the rest is owed"
