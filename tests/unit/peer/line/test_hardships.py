"""If one fails, full or slow disks, clogged links, lost leases or hurried neighbours leave a handover stuck, or writers waiting."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from functools import partial
from typing import Any

import pytest
import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.location import Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import PLACED_BY_NODE, RecordPlace, signed_place, wanted_place
from scenefold.peer.line import Side, settling
from scenefold.peer.line.gate import Gate
from scenefold.peer.line.giving import FREEZE_S_MAX
from scenefold.peer.line.settling import SETTLING_S
from scenefold.peer.records.verification import KnownScene
from scenefold.store import Outcome, Put
from scenefold.store.layout import RECORDS as RECORDS_TABLE
from scenefold.store.layout import location_of, object_of
from scenefold.wire import SceneMode
from scenefold.world.sim import Point, run_simulated
from unit.peer.line import street as streets
from unit.peer.line.street import HEADER, House, Street, record_at
from unit.peer.line.test_crashes import RECORDS, end_of, give, handing_all_left, handing_right
from unit.peer.scenes_made import SPACE, later_header, sealed

pytestmark = pytest.mark.usefixtures("only_errors")

SETTLED_S = 11.0
LAPSE_S = 6.0
SLOWEST = 0.99
FASTEST = (1.01, 1.01, 1.005)
EAGER_S = 0.02

Tale = Callable[[Street, trio.Nursery], Awaitable[None]]


def endure(tale: Tale, *, founders: int = 2) -> None:
    """Play a tale; then the line must be whole, and nothing lost."""

    async def main() -> None:
        street = Street(founders)
        async with trio.open_nursery() as nursery:
            await street.begin(nursery)
            await tale(street, nursery)
            await street.until_whole()
            street.check()
            nursery.cancel_scope.cancel()

    run_simulated(1, main, virtual_s_max=1500.0, wall_s_max=60.0)


async def refused(house: House, side: Side = Side.RIGHT, share: float = 0.5) -> RejectReason:
    """Try to give; the reason why it was refused."""
    line: Any = house.line
    before = line.arc
    with pytest.raises(Refused) as refusal:
        await line.give(side, end_of(line.arc, side, share), why="a test")
    assert line.arc == before
    assert not line.busy(side)
    return refusal.value.reason


# -------------------------------------------------------------------------------------------------------- full disks


def test_a_node_without_room_refuses_the_offer_and_both_go_on() -> None:
    async def tale(street: Street, _: trio.Nursery) -> None:
        await street.fill(0, RECORDS)
        await trio.sleep(SETTLED_S)
        giver, receiver = street.houses
        street.net.machine(receiver.address).disk.fill(street.reserve_bytes // 2)
        assert await refused(giver) is RejectReason.STORAGE_FULL
        assert receiver.durable().handovers == []
        street.net.machine(receiver.address).disk.fill(None)
        await give(giver, Side.RIGHT)
        assert giver.durable().arc.length < receiver.durable().arc.length

    endure(tale)


def test_a_disk_that_fills_in_the_middle_of_a_copy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(streets, "RECORD_BYTES", 50_000)

    async def tale(street: Street, _: trio.Nursery) -> None:
        await street.fill(0, 4 * RECORDS)
        await trio.sleep(SETTLED_S)
        giver, receiver = street.houses
        disk = street.net.machine(receiver.address).disk
        # The first commit notes the offer, the second has the first records.
        street.net.trap(receiver.address, Point.AFTER_COMMIT, 2, partial(disk.fill, 0))
        assert await refused(giver) is RejectReason.STORAGE_FULL
        assert receiver.stored(), "nothing was copied at all"
        await trio.sleep(30.0)
        disk.fill(None)
        await street.until_whole()
        assert not receiver.stored(), "what was copied has gone home"
        await give(giver, Side.RIGHT)
        assert giver.durable().arc.length < receiver.durable().arc.length

    endure(tale)


# ------------------------------------------------------------------------------------------------- writers, slow links


async def keep_writing(street: Street, number: int, waits: list[float]) -> None:
    """Writers that pass the gate again and again; how long each had to wait for it."""
    house, turn = street.houses[number], 0
    while True:
        turn += 1
        line: Any = house.line
        place = Location.from_number(line.arc.first.number + turn * streets.SPREAD % line.arc.length)
        begin = street.net.now
        async with line.writing([place]):
            waits.append(street.net.now - begin)
            if line.owns(place) and (await house.store.put([Put(record_at(place))]))[0].outcome is Outcome.STORED:
                street.kept.add(place)
        await trio.sleep(0.05)


async def give_under_load(street: Street) -> list[float]:
    """Give half while four writers are at it; how long they waited. Whether it came to pass is for the caller."""
    waits: list[float] = []
    async with trio.open_nursery() as writers:
        for _ in range(4):
            writers.start_soon(keep_writing, street, 0, waits)
        line: Any = street.houses[0].line
        with trio.move_on_after(200.0):
            await line.give(Side.RIGHT, end_of(line.arc, Side.RIGHT, 0.5), why="a test")
        writers.cancel_scope.cancel()
    return waits


def test_a_slow_disk_thaws_the_piece_before_writers_lose_patience() -> None:
    async def tale(street: Street, nursery: trio.Nursery) -> None:
        await street.fill(0, RECORDS)
        await trio.sleep(SETTLED_S)
        giver = street.houses[0]
        disk = street.net.machine(giver.address).disk
        disk.slow(1.0)

        async def mend() -> None:
            line: Any = giver.line
            while line.events["thawed"] < 1:  # noqa: ASYNC110 - events are only counted
                await trio.sleep(0.1)
            disk.slow(0.0)

        nursery.start_soon(mend)
        waits = await give_under_load(street)
        line: Any = giver.line
        assert line.events["thawed"] >= 1
        assert line.events["given"] == 1
        assert 0.1 < max(waits) <= FREEZE_S_MAX + 0.1

    endure(tale)


def test_a_link_that_clogs_in_the_frozen_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    frozen = Gate.frozen
    clog: list[Callable[[], None]] = []

    @asynccontextmanager
    async def watched(self: Gate, piece: Arc) -> AsyncIterator[None]:
        async with frozen(self, piece):
            if clog:
                clog.pop()()
            yield

    monkeypatch.setattr(Gate, "frozen", watched)

    async def tale(street: Street, nursery: trio.Nursery) -> None:
        await street.fill(0, RECORDS)
        await trio.sleep(SETTLED_S)
        one, other = (house.address for house in street.houses)

        async def clear() -> None:
            await trio.sleep(4.0)
            street.net.unclog(one, other)

        def stop_up() -> None:
            street.net.clog(one, other)
            nursery.start_soon(clear)

        clog.append(stop_up)
        waits = await give_under_load(street)
        line: Any = street.houses[0].line
        assert line.events["thawed"] >= 1
        assert line.events["given"] == 1
        assert max(waits) <= FREEZE_S_MAX + 0.1

    endure(tale)


# ------------------------------------------------------------------------------------------------------------- leases


@pytest.mark.parametrize("point", [Point.AFTER_COMMIT, Point.AFTER_SEND])
@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("story", [handing_right, handing_all_left])
def test_a_lease_that_ends_in_the_middle_of_each_step(story: Callable[[Street], Awaitable[None]], number: int, point: Point) -> None:
    lapses = 0
    while lapsed(story, number, point, lapses + 1):
        lapses += 1
    assert lapses >= 4


def lapsed(story: Callable[[Street], Awaitable[None]], number: int, point: Point, count: int) -> bool:
    """Whether the story came as far as the moment at which a node loses its lease for a while."""
    sprung = False

    async def tale(street: Street, nursery: trio.Nursery) -> None:
        house = street.houses[number]

        async def lapse() -> None:
            house.leased = False
            await trio.sleep(LAPSE_S)
            house.leased = True

        def spring() -> None:
            nonlocal sprung
            sprung = True
            nursery.start_soon(lapse)

        street.net.trap(house.address, point, count, spring)
        await story(street)

    endure(tale)
    return sprung


# ----------------------------------------------------------------------------------------------- node-managed records


def objects_at(street: Street, number: int) -> dict[bytes, Location]:
    keys = street.net.machine(street.houses[number].address).disk.peek(RECORDS_TABLE)
    return {object_of(key): location_of(key) for key in keys if object_of(key)}


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize("everything", [False, True])
def test_objects_are_with_the_owner_of_their_home_and_one_that_the_bound_parts_from_it_slides(side: Side, everything: bool) -> None:
    async def tale(street: Street, _: trio.Nursery) -> None:
        giver, taker = street.houses if side is Side.RIGHT else street.houses[::-1]
        await trio.sleep(SETTLED_S)
        arc = giver.durable().arc
        assert arc is not None
        objects = [bytes([(arc.first.number >> 152) + 8 * number + 4, number]) * 8 for number in range(16)]
        middle = wanted_place(objects[7])
        copies = [sealed(HEADER, location=signed_place(name), placement=PLACED_BY_NODE) for name in objects]
        results = await giver.store.put([Put(copy) for copy in (record_at(middle), *copies)])
        assert all(result.outcome is Outcome.STORED for result in results)
        assert results[8].location == middle.next(), "its home is taken"
        piece = Arc(middle.next(), arc.last) if side is Side.RIGHT else Arc(arc.first, middle)
        line: Any = giver.line
        await line.give(side, arc if everything else piece, why="a test")
        await street.until_whole()
        for house in (giver, taker):
            there = objects_at(street, street.houses.index(house))
            own = house.durable()
            assert sorted(there) == [name for name in objects if own.owns(wanted_place(name))]
            assert all(own.owns(location) for location in there.values())

    endure(tale)


def test_an_object_that_lies_with_another_node_than_its_home_is_brought_home() -> None:
    async def tale(street: Street, _: trio.Nursery) -> None:
        owner, holder = street.houses
        await trio.sleep(SETTLED_S)
        name = bytes([4]) * 16
        copy = sealed(HEADER, location=signed_place(name), placement=PLACED_BY_NODE)
        arc = holder.durable().arc
        assert arc is not None and owner.durable().owns(wanted_place(name))
        await holder.store.merge([Put(copy, at=arc.first)])
        await trio.sleep(90.0)
        await street.until_whole()
        assert objects_at(street, 0) == {name: wanted_place(name)}
        assert objects_at(street, 1) == {}

    endure(tale)


# -------------------------------------------------------------------------------------------------------- render mode


def test_strays_replace_nothing_in_a_scene_that_is_rendered(monkeypatch: pytest.MonkeyPatch) -> None:
    async def tale(street: Street, _: trio.Nursery) -> None:
        owner, holder = street.houses
        taken, free = (await street.fill(0, 2))[0], Location.from_number(12345)
        monkeypatch.setattr(streets, "SCENE", KnownScene.of(later_header(HEADER, mode=SceneMode.RENDER)))
        await holder.store.merge([Put(record_at(taken, seq=2)), Put(record_at(free))])
        await trio.sleep(90.0)
        assert {taken} == holder.stored()
        assert free in owner.stored()
        [kept] = await owner.store.get_many([RecordPlace(HEADER.scene, SPACE, taken)])
        assert kept == record_at(taken)
        monkeypatch.setattr(streets, "SCENE", KnownScene.of(HEADER))
        await street.until_whole()
        [kept] = await owner.store.get_many([RecordPlace(HEADER.scene, SPACE, taken)])
        assert kept == record_at(taken, seq=2)

    endure(tale)


def test_strays_that_their_owner_has_go_while_a_scene_is_rendered(monkeypatch: pytest.MonkeyPatch) -> None:
    async def tale(street: Street, _: trio.Nursery) -> None:
        owner, holder = street.houses
        same, newer = await street.fill(0, 2)
        await owner.store.merge([Put(record_at(newer, seq=3))])
        monkeypatch.setattr(streets, "SCENE", KnownScene.of(later_header(HEADER, mode=SceneMode.RENDER)))
        await holder.store.merge([Put(record_at(same)), Put(record_at(newer, seq=2))])
        await trio.sleep(90.0)
        assert holder.stored() == set()
        kept = await owner.store.get_many([RecordPlace(HEADER.scene, SPACE, place) for place in (same, newer)])
        assert kept == [record_at(same), record_at(newer, seq=3)]

    endure(tale)


# ----------------------------------------------------------------------------------------------------------- settling


def shortest_stay(rates: tuple[float, float, float]) -> float:
    """Seconds, at least, that a record stayed where it had moved to, with everybody eager to give on what he got."""
    arrived: dict[Location, float] = {}
    stays: list[float] = []

    async def tale(street: Street, nursery: trio.Nursery) -> None:
        places = await street.fill(0, RECORDS)
        for house, rate in zip(street.houses, rates, strict=True):
            street.net.machine(house.address).clock.set_rate(rate)
        owners: dict[Location, int] = dict.fromkeys(places, 0)

        def see() -> None:
            for house in street.houses:
                holding = house.durable()
                for place in places:
                    if holding is not None and holding.owns(place):
                        if owners[place] != house.number:
                            owners[place], arrived[place] = house.number, street.net.now
                    elif owners[place] == house.number and place in arrived:
                        stays.append(street.net.now - arrived.pop(place))

        for house in street.houses:
            street.net.observe(house.address, Point.AFTER_COMMIT, see)
        with trio.move_on_after(150.0):
            async with trio.open_nursery() as eager:
                eager.start_soon(pass_on, street.houses[0], Side.RIGHT)
                eager.start_soon(pass_on, street.houses[1], Side.RIGHT)
                eager.start_soon(pass_on, street.houses[1], Side.LEFT)
                eager.start_soon(pass_on, street.houses[2], Side.LEFT)

    endure(tale, founders=3)
    assert len(stays) > RECORDS // 2, "hardly anything moved twice"
    return min(stays)


async def pass_on(house: House, side: Side) -> None:
    """Give half of what there is as soon as that is allowed, again and again."""
    while True:
        line: Any = house.line
        if line is not None and line.arc is not None and line.arc.length > 1 << 150:
            try:
                await line.give(side, end_of(line.arc, side, 0.5), why="a test")
            except (Refused, Unreachable, PeerFault):
                await trio.sleep(EAGER_S)
        await trio.sleep(EAGER_S)


def test_a_record_stays_for_ten_seconds_by_anybodys_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """The node that settles is as fast as may be; whoever watches may be as slow."""
    assert shortest_stay(FASTEST) * SLOWEST >= SETTLING_S
    monkeypatch.setattr(settling, "CLOCK_MARGIN", 1.0)
    assert shortest_stay(FASTEST) * SLOWEST < SETTLING_S, "the margin is needed"
