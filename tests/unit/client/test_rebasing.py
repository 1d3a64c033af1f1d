"""If this fails, what was written before a space was moved is carried on wrongly, twice, over somebody's edit, or in render mode."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.client.space import Space
from scenefold.crypto import RecordHeader
from scenefold.scene.layout import GEOMETRY, RENDERS
from scenefold.scene.payloads.carrying import carrier
from scenefold.scene.payloads.geometry import decode_atom
from scenefold.wire import Packet, PutMany, Role, SceneMode, SetMode
from scenefold.world import Priority
from unit.client.fake_nodes import FakeNodes
from unit.client.splits_made import Ending, atom, ended_at, hall_of, lying, part_places
from unit.client.test_grants import Studio, card_of

ROWS = carrier("float64")
POINTS = [(0.1 * number, 0.2, 0.3) for number in range(9)]


@pytest.fixture
def studio(tmp_path: Path) -> Studio:
    return Studio(tmp_path)


def rows(*points: tuple[float, ...]) -> bytes:
    return np.array(points, "<f8").tobytes()


def points_of(payload: bytes | None) -> list[list[float]]:
    assert payload is not None
    return [list(map(float, row)) for row in np.frombuffer(payload, "<f8").reshape(-1, 3).round(9)]


async def moved_hall(studio: Studio) -> tuple[Space, list[Location]]:
    """Nine points of a hall, one a record, and the hall moved by one and then scaled by two."""
    hall = await hall_of(await studio.scenes(1).create("kitchen", copies=1))
    places = await hall.put_all_at([(point, rows(point)) for point in POINTS])
    await hall.translate((1.0, 0.0, 0.0))
    await hall.scale(2.0)
    return hall, places


def now(point: tuple[float, ...]) -> list[float]:
    return [round(2 * (point[0] + 1), 9), round(2 * point[1], 9), round(2 * point[2], 9)]


def positions(studio: Studio, hall: Space) -> set[int]:
    """The content positions of the records that lie there."""
    return {RecordHeader.decode(item.header).content_position for key, item in studio.nodes.records.items() if key[0] == hall.id}


async def test_a_reader_carries_on_and_writes_back_only_if_asked_to(autojump_clock: MockClock, studio: Studio) -> None:
    hall, places = await moved_hall(studio)
    before = dict(studio.nodes.records)
    carried = await hall.carried([*places, Location.from_number(3)], ROWS)
    assert [points_of(one.payload) for one in carried[:-1]] == [[now(point)] for point in POINTS]
    assert carried[-1] == (None, False) and not any(one.written for one in carried)
    assert studio.nodes.records == before, "nobody asked for more"
    back = await hall.carried(places[:4], ROWS, write_back=True)
    assert [one.payload for one in back] == [one.payload for one in carried[:4]] and all(one.written for one in back)
    for place, one in zip(places[:4], await hall.read(places[:4]), strict=True):
        assert one is not None and (one.payload, one.content_position) == (carried[places.index(place)].payload, 4)
    again = await hall.carried(places[:4], ROWS, write_back=True)
    assert [one.payload for one in again] == [one.payload for one in back] and not any(one.written for one in again), "not twice"


async def test_a_whole_space_is_rebased_once(autojump_clock: MockClock, studio: Studio) -> None:
    hall, places = await moved_hall(studio)
    await hall.delete(places[8])
    await hall.put(places[7], b"a spark")
    before = dict(studio.nodes.records)
    looked = await hall.rebase(ROWS, dry_run=True)
    assert (looked.behind, looked.unknown, looked.rebased, looked.records) == (7, 0, 0, 9), "what is written now belongs to now"
    assert studio.nodes.records == before
    done = await hall.rebase(ROWS)
    assert (done.behind, done.unknown, done.rebased, done.overtaken, done.position) == (7, 0, 7, 0, 4)
    payloads = await hall.get_many(places)
    assert [points_of(payload) for payload in payloads[:7]] == [[now(point)] for point in POINTS[:7]]
    assert payloads[7:] == [b"a spark", None]
    assert (await hall.rebase(ROWS)).behind == 0
    await hall.translate((0.0, 1.0, 0.0))
    last = (await hall.rebase(ROWS)).document()
    assert (last["behind"], last["unknown"], last["rebased"], last["position"]) == (8, 1, 7, 5), "a spark is no row of numbers"
    assert points_of(await hall.get(places[0])) == [[now(POINTS[0])[0], now(POINTS[0])[1] + 1.0, now(POINTS[0])[2]]]


async def test_there_and_back_again_needs_no_writing(autojump_clock: MockClock, studio: Studio) -> None:
    hall = await hall_of(await studio.scenes(1).create("kitchen", copies=1))
    place = await hall.put_at((0.5, 0.5, 0.5), rows((0.1, 0.2, 0.3)))
    await hall.translate((math.pi, 0.0, 0.0))
    await hall.translate((-math.pi, 0.0, 0.0))
    assert (await hall.rebase(ROWS)).behind == 0
    assert (await hall.carried([place], ROWS, write_back=True))[0] == (rows((0.1, 0.2, 0.3)), False)


async def test_a_split_record_is_carried_on_as_a_whole(autojump_clock: MockClock, studio: Studio) -> None:
    hall = await hall_of(await studio.scenes(1).create("kitchen", copies=1))
    payload = atom(40)
    plain, whole = await hall.put_all_at([((0.1, 0.1, 0.1), atom(7)), ((0.5, 0.5, 0.5), payload)])
    old = (await hall.split(whole, 3)).parts
    await hall.translate((10.0, 0.0, 0.0))
    done = await hall.rebase(carrier("atoms"))
    assert (done.behind, done.rebased, done.unknown) == (2, 2, 0), "parts are not carried on by themselves"
    after = decode_atom(await hall.get(whole) or b"")
    np.testing.assert_allclose(after.positions, decode_atom(payload).positions + np.float32([10, 0, 0]), atol=1e-6)
    assert set(await part_places(hall)) == set((await hall.split(whole, 3)).parts) and len(old) == 3, "the old parts are gone"
    assert {one.content_position for one in (await lying(hall)).values()} == {3}
    assert (await hall.rebase(carrier("atoms"))).behind == 0
    await hall.merge(whole)
    assert set(await lying(hall)) == {plain, whole}


async def test_never_in_render_mode_and_not_where_renders_write(autojump_clock: MockClock, studio: Studio) -> None:
    hall, places = await moved_hall(studio)
    scene = await studio.kitchen(1)
    sums = await scene.create_space("sums", ((0.0,) * 3, (1.0,) * 3), render_output=True)
    await scene.access.change_log(lambda _: SetMode(SceneMode.RENDER))
    before = dict(studio.nodes.records)
    carried = await hall.carried(places, ROWS, write_back=True)
    assert [points_of(one.payload) for one in carried] == [[now(point)] for point in POINTS], "in memory"
    assert not any(one.written for one in carried)
    with pytest.raises(Refused, match="render mode") as refused:
        await hall.rebase(ROWS)
    assert refused.value.reason is RejectReason.MODE_FORBIDS
    for work in (lambda: sums.rebase(ROWS), lambda: sums.carried(places, ROWS, write_back=True), lambda: sums.rebase(ROWS, dry_run=True)):
        with pytest.raises(LocalFault, match="renders write to this space"):
            await work()
    with pytest.raises(LocalFault, match="nodes choose"):
        await scene.space(RENDERS).rebase(ROWS)
    assert studio.nodes.records == before
    assert (await hall.rebase(ROWS, dry_run=True)).behind == len(POINTS), "who only looks may"


async def test_who_may_not_write_reads_and_is_told(autojump_clock: MockClock, studio: Studio) -> None:
    hall, places = await moved_hall(studio)
    await (await studio.kitchen(1)).grant(card_of(2), Role.READER)
    mine = (await studio.kitchen(2)).space(hall.id)
    before = dict(studio.nodes.records)
    assert points_of((await mine.carried(places[:1], ROWS))[0].payload) == [now(POINTS[0])]
    for work in (lambda: mine.carried(places, ROWS, write_back=True), lambda: mine.rebase(ROWS)):
        with pytest.raises(LocalFault, match="reading only"):
            await work()
    assert studio.nodes.records == before


class Overtaken(FakeNodes):
    """Something happens between what a client reads and what it writes."""

    happens: Callable[[], Any] | None = None

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if isinstance(packet, PutMany) and self.happens is not None:
            happens, self.happens = self.happens, None
            await happens()
        return await super().request(address, priority, packet, timeout)


async def test_an_edit_in_between_stays_and_is_looked_at_again(autojump_clock: MockClock, studio: Studio) -> None:
    studio.nodes = nodes = Overtaken(addresses=("127.0.0.2",))  # what is written at once goes there in one frame
    hall, places = await moved_hall(studio)
    other = (await studio.kitchen(1)).space(hall.id)

    async def edit() -> None:
        await other.info()
        await other.put(places[0], rows((7.0, 7.0, 7.0)))
        await other.delete(places[1])

    nodes.happens = edit
    carried = await hall.carried(places, ROWS, write_back=True)
    assert [one.written for one in carried] == [False, False] + [True] * 7
    assert points_of(await hall.get(places[0])) == [[7.0] * 3] and await hall.get(places[1]) is None
    await hall.translate((1.0, 0.0, 0.0))

    async def move() -> None:
        await other.put(places[2], rows((8.0, 8.0, 8.0)))

    nodes.happens = move
    done = await hall.rebase(ROWS)
    assert (done.behind, done.rebased, done.overtaken) == (8, 8, 0)
    assert points_of(await hall.get(places[2])) == [[9.0, 8.0, 8.0]], "that of the other was from before the step"


async def test_a_mode_that_is_switched_in_this_moment_loses_no_reading(autojump_clock: MockClock, studio: Studio) -> None:
    studio.nodes = nodes = Overtaken()
    hall, places = await moved_hall(studio)
    scene = await studio.kitchen(1)

    async def switch() -> None:
        await scene.access.change_log(lambda _: SetMode(SceneMode.RENDER))

    nodes.happens = switch
    before = dict(nodes.records)
    (carried,) = await hall.carried(places[:1], ROWS, write_back=True)
    assert (points_of(carried.payload), carried.written, nodes.records == before) == ([now(POINTS[0])], False, True)


async def test_several_at_once_carry_each_record_on_once(autojump_clock: MockClock, studio: Studio) -> None:
    hall, places = await moved_hall(studio)
    reports = []

    async def work() -> None:
        reports.append(await (await studio.kitchen(1)).space(hall.id).rebase(ROWS))

    async with trio.open_nursery() as nursery:
        for _ in range(4):
            nursery.start_soon(work)
    assert [points_of(payload) for payload in await hall.get_many(places)] == [[now(point)] for point in POINTS]
    assert sum(report.rebased for report in reports) == len(POINTS)
    assert positions(studio, hall) == {4}


@pytest.mark.parametrize("carried_out", [False, True])
async def test_it_goes_on_where_it_was_ended(autojump_clock: MockClock, studio: Studio, carried_out: bool) -> None:
    studio.nodes = nodes = Ending()
    hall, places = await moved_hall(studio)
    await hall.split(places[0])
    for write in range(1, 30):
        mine = (await studio.kitchen(1)).space(hall.id)
        if not await ended_at(nodes, write, lambda mine=mine: mine.rebase(ROWS), carried_out=carried_out):
            break
        assert [points_of(one.payload) for one in await mine.carried(places, ROWS)] == [[now(point)] for point in POINTS]
    else:
        pytest.fail("it was never done")
    assert write > 2
    await hall.tidy()
    assert [points_of(payload) for payload in await hall.get_many(places)] == [[now(point)] for point in POINTS]
    assert len(await part_places(hall)) == 2 and positions(studio, hall) >= {4}


async def test_a_carrier_that_is_wrong_is_heard_and_changes_nothing(autojump_clock: MockClock, studio: Studio) -> None:
    hall, _ = await moved_hall(studio)
    before = dict(studio.nodes.records)

    def broken(payload: bytes, since: object) -> bytes:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        await hall.rebase(broken)
    assert studio.nodes.records == before


async def test_what_every_scene_has_is_never_behind(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await studio.scenes(1).create("kitchen", copies=1)
    await scene.space(GEOMETRY).put(Location.from_number(9), atom())
    hall = await hall_of(scene)
    await hall.translate((1.0, 0.0, 0.0))
    done = await scene.space(GEOMETRY).rebase(carrier("atoms"))
    assert (done.records, done.behind) == (1, 0)
