"""If this fails, deleted records stay for ever, or something goes that somebody still needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import trio
from hypothesis import given
from hypothesis import strategies as st
from trio.testing import MockClock

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.ids import SpaceId
from scenefold.base.location import FIRST, LAST, LINE_LENGTH, Location
from scenefold.base.reasons import RejectReason
from scenefold.client.progress import ProgressState
from scenefold.client.purge_walk import Deletion, Tails
from scenefold.client.scene import Scene
from scenefold.crypto import RecordHeader
from scenefold.peer.purging.orders import check_order
from scenefold.peer.records.verification import KnownScene
from scenefold.scene.layout import FILES, GEOMETRY
from scenefold.wire import Packet, PurgeItem, PurgeOrder, PurgeRecords, RecordsPurged, RecordVersion, Role, SceneMode, SetMode
from unit.client.fake_nodes import FakeNodes
from unit.client.test_grants import Studio, card_of

COUNT = 40
PLACES = [Location.from_number(LINE_LENGTH * index // COUNT) for index in range(COUNT)]


@dataclass
class PurgingNodes(FakeNodes):
    """They purge what they are told to, unless somebody has something older."""

    older: set[Location] = field(default_factory=set)
    """Places of which a node has something older."""
    patience: int = 10**9
    """Orders until that has gone."""
    orders: list[PurgeOrder] = field(default_factory=list)

    def _answer(self, address: str, packet: Packet) -> Packet:
        if not isinstance(packet, PurgeRecords):
            return super()._answer(address, packet)
        order = packet.order
        self.orders.append(order)
        if len(self.orders) > self.patience:
            self.older = set()
        check_order(order, KnownScene.of(self.headers[order.scene]))
        met = [self._met(address, item) for item in order.items]
        if any(reason is not None for reason in met):
            reasons = [int(RejectReason.BUSY) if reason is None else reason for reason in met]
            return RecordsPurged(tuple(reasons), "somebody has something older")
        for item in order.items:
            del self.records[item.space, item.location]
        return RecordsPurged((0,) * len(order.items), "")

    def _met(self, address: str, item: PurgeItem) -> int | None:
        if self.table.owner_of(item.location).address != address:
            return int(RejectReason.NOT_MY_LOCATION)
        present = self.records.get((item.space, item.location))
        if present is None:
            return 0
        if RecordHeader.decode(present.header).digest != item.version.digest:
            return int(RejectReason.STALE_VERSION)
        return int(RejectReason.NOT_READY) if item.location in self.older else None


@pytest.fixture
def nodes() -> PurgingNodes:
    return PurgingNodes()


@pytest.fixture
def studio(tmp_path: Path, nodes: PurgingNodes) -> Studio:
    studio = Studio(tmp_path)
    studio.nodes = nodes
    return studio


async def filled(studio: Studio) -> Scene:
    """A record at each place, the even ones deleted."""
    scene = await studio.scenes(1).create("kitchen")
    space = scene.space(GEOMETRY)
    await space.put_many((place, b"payload %d" % index) for index, place in enumerate(PLACES))
    for place in PLACES[::2]:
        await space.delete(place)
    return scene


def left(nodes: FakeNodes, space: int = GEOMETRY) -> list[Location]:
    return sorted(location for known, location in nodes.records if known == space)


async def test_what_is_deleted_goes_and_nothing_else(autojump_clock: MockClock, studio: Studio, nodes: PurgingNodes) -> None:
    scene = await filled(studio)
    shown: list[ProgressState] = []
    report = await scene.purge(progress=shown.append)
    assert left(nodes) == PLACES[1::2]
    assert (report.deleted, report.can_go, report.purged, report.walked, report.is_complete) == (20, 20, 20, COUNT, True)
    assert (shown[-1].done, shown[-1].total) == (COUNT, COUNT)
    header = nodes.headers[scene.id]
    assert header.purged == header.write_floor == header.position == 2
    assert await scene.space(GEOMETRY).get_many(PLACES[:2]) == [None, b"payload 1"]
    again = await scene.purge()
    assert (again.deleted, nodes.headers[scene.id].position) == (0, 2), "nothing to do, so nothing begins"
    await scene.space(GEOMETRY).put(PLACES[0], b"anew")
    assert await scene.space(GEOMETRY).get(PLACES[0]) == b"anew"


async def test_a_dry_run_changes_nothing(autojump_clock: MockClock, studio: Studio, nodes: PurgingNodes) -> None:
    scene = await filled(studio)
    report = await scene.purge(dry_run=True)
    assert (report.deleted, report.can_go, report.purged) == (20, 20, 0)
    assert (left(nodes), nodes.orders, nodes.headers[scene.id].position) == (PLACES, [], 1)


async def test_it_looks_no_faster_than_it_may(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await studio.scenes(1).create("kitchen")
    await scene.space(FILES).put_many((Location.from_number(LINE_LENGTH * index // 600), bytes(1000)) for index in range(600))
    begun = trio.current_time()
    assert (await scene.purge(dry_run=True)).walked == 600
    assert trio.current_time() - begun < 5.0
    begun = trio.current_time()
    report = await scene.purge(dry_run=True, bytes_per_s=10_000)
    assert report.walked == 600 and trio.current_time() - begun > 512 * 1000 / 10_000 - 5


async def test_only_the_spaces_that_are_named(autojump_clock: MockClock, studio: Studio, nodes: PurgingNodes) -> None:
    scene = await filled(studio)
    await scene.space(FILES).put(PLACES[0], b"a file")
    await scene.space(FILES).delete(PLACES[0])
    assert (await scene.purge([FILES])).purged == 1
    assert (left(nodes), left(nodes, FILES)) == (PLACES, [])
    with pytest.raises(LocalFault, match="no such space"):
        await scene.purge([99])


async def test_what_somebody_has_older_waits_and_the_others_go(autojump_clock: MockClock, studio: Studio, nodes: PurgingNodes) -> None:
    scene = await filled(studio)
    nodes.older = {PLACES[4], PLACES[30]}
    report = await scene.purge()
    assert (report.purged, report.waiting, report.is_complete) == (18, 2, False)
    assert report.reasons == ["somebody has something older"]
    assert left(nodes) == sorted([*PLACES[1::2], *nodes.older])
    nodes.patience = len(nodes.orders) + 3
    report = await scene.purge()
    assert (report.purged, report.waiting, left(nodes)) == (2, 0, PLACES[1::2])


async def test_it_goes_on_where_it_was_ended(autojump_clock: MockClock, studio: Studio, nodes: PurgingNodes) -> None:
    scene = await filled(studio)
    nodes.older = set(PLACES)
    with trio.move_on_after(2.0):
        await scene.purge()
    nodes.older = set()
    assert (await (await studio.kitchen(1)).purge()).purged == 20
    assert left(nodes) == PLACES[1::2]


async def test_a_writer_purges_what_an_owner_has_begun_and_a_reader_nothing(
    autojump_clock: MockClock, studio: Studio, nodes: PurgingNodes
) -> None:
    scene = await filled(studio)
    await scene.grant(card_of(2), Role.WRITER)
    await scene.grant(card_of(3), Role.READER)
    with pytest.raises(LocalFault, match="reading only"):
        await (await studio.kitchen(3)).purge()
    ada = await studio.kitchen(2)
    report = await ada.purge()
    assert (report.purged, report.not_begun, report.is_complete) == (0, 20, False)
    nodes.older = {PLACES[0]}
    await scene.purge()
    nodes.older = set()
    report = await ada.purge()
    assert (report.purged, report.not_begun) == (1, 0)


async def test_what_is_written_meanwhile_stays(autojump_clock: MockClock, studio: Studio, nodes: PurgingNodes) -> None:
    scene = await filled(studio)
    met = nodes._met
    wrote: list[Location] = []

    def overtaken(address: str, item: PurgeItem) -> int | None:
        if item.location == PLACES[8] and not wrote:
            wrote.append(PLACES[8])
            nodes.records[GEOMETRY, PLACES[8]] = nodes.records[GEOMETRY, PLACES[9]]
        return met(address, item)

    nodes._met = overtaken  # type: ignore[method-assign]
    report = await scene.purge()
    assert (report.overtaken, report.purged, PLACES[8] in left(nodes)) == (1, 19, True)


async def test_who_has_lost_the_place_is_not_told_again(autojump_clock: MockClock, studio: Studio, nodes: PurgingNodes) -> None:
    scene = await filled(studio)
    await scene.space(GEOMETRY).get(PLACES[0])
    nodes.move_bounds()
    report = await scene.purge()
    assert (report.purged, report.waiting) == (20, 0)


async def test_objects_go_and_runs_stay(autojump_clock: MockClock, studio: Studio, nodes: PurgingNodes) -> None:
    scene = await studio.scenes(1).create("kitchen")
    objects = await scene.create_space("objects", node_managed=True)
    thing, other = await objects.put_managed(b"a thing"), await objects.put_managed(b"another")
    await objects.managed.delete(thing)
    run = [Location.from_number((1 << 150) + number) for number in range(5)]
    space = scene.space(GEOMETRY)
    await space.put_many((place, b"atom") for place in run)
    for place in (run[1], run[3], run[4]):
        await space.delete(place)
    report = await scene.purge()
    assert (report.deleted, report.can_go, report.purged, report.kept) == (4, 3, 3, 1)
    assert left(nodes) == run[:3], "what lies behind the second may have wanted its place"
    assert left(nodes, objects.id) == [other.location]


async def test_nothing_is_purged_while_the_scene_is_rendered(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await filled(studio)
    await scene.access.change_log(lambda _: SetMode(SceneMode.RENDER))
    with pytest.raises((LocalFault, Refused)):
        await scene.purge()


# ------------------------------------------------------------------------------------------------------------- runs


def deletion(number: int) -> Deletion:
    location = Location.from_number(number)
    return Deletion(PurgeItem(SpaceId(2), location, b"", RecordVersion(1, 1, 1, 1, bytes(32))), location)


def went(records: Sequence[tuple[int, bool]]) -> set[int]:
    tails, free = Tails(), []
    for number, is_deleted in records:
        free += tails.show(Location.from_number(number), deletion(number) if is_deleted else None)
    free += tails.end()
    gone = {one.home.number for one in free}
    assert len(gone) == len(free) == sum(is_deleted for _, is_deleted in records) - tails.kept
    return gone


@given(st.dictionaries(st.integers(0, 40), st.booleans()))
def test_a_deletion_goes_if_all_up_to_the_next_gap_is_deleted(records: dict[int, bool]) -> None:
    expected = set()
    for number, is_deleted in records.items():
        behind = number
        while records.get(behind) is True:
            behind += 1
        if is_deleted and behind not in records:
            expected.add(number)
    assert went(sorted(records.items())) == expected


def test_a_run_goes_on_from_the_end_of_the_line() -> None:
    first, last = FIRST.number, LAST.number
    assert went([(first, False), (last, True)]) == set()
    assert went([(first + 1, False), (last, True)]) == {last}
    assert went([(first, True), (first + 1, True), (last, True)]) == {first, first + 1}, "in doubt it stays"


def test_a_record_lies_within_so_many_places_of_what_it_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scenefold.client.purge_walk.STEPS_MAX", 4)
    assert went([(0, True), (1, True), (2, True), (3, False)]) == set()
    assert went([(0, True), (1, True), (2, True), (3, True), (4, False)]) == {0}
