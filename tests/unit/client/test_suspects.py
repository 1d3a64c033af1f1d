"""If this fails, what a returned node keeps apart is lost, or put over what is newer, or shown as something else than it is."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest
from trio.testing import MockClock

from scenefold.base.errors import LocalFault
from scenefold.base.ids import node_id_of
from scenefold.base.location import LINE_LENGTH, Location
from scenefold.client.scene import Scene
from scenefold.crypto import RecordHeader
from scenefold.peer.purging.showing import check_order
from scenefold.peer.records.verification import KnownScene
from scenefold.scene.layout import GEOMETRY
from scenefold.wire import (
    DiscardSuspects,
    FetchSuspects,
    HandItem,
    HeldRecord,
    ListSuspects,
    Member,
    Packet,
    PutItem,
    RecordVersion,
    Role,
    SuspectsDiscarded,
    SuspectsFetched,
    SuspectsListed,
)
from unit.client.fake_nodes import FakeNodes
from unit.client.test_grants import Studio, card_of

HERE, THERE = "127.0.0.2", "127.0.0.3"
PLACES = [Location.from_number(LINE_LENGTH * index // 8) for index in range(8)]
PAGE = 2


@dataclass
class ReturnedNodes(FakeNodes):
    """Some of them keep records apart."""

    apart: dict[str, dict[Location, PutItem]] = field(default_factory=dict)
    endless: str = ""
    """It lists the same over and over."""

    def keep(self, address: str, location: Location) -> None:
        """What lies at a place is kept apart by a node, as it is now."""
        self.apart.setdefault(address, {})[location] = self.records[GEOMETRY, location]

    def _answer(self, address: str, packet: Packet) -> Packet:
        kept = self.apart.get(address, {})
        match packet:
            case ListSuspects():
                after = b"" if address == self.endless else packet.after
                places = [place for place in sorted(kept) if place > after][:PAGE]
                more = places[-1] if len(places) == PAGE else None
                return SuspectsListed(_member(address), tuple(_held(kept[place]) for place in places), more)
            case FetchSuspects():
                items = [kept[entry.location] for entry in packet.entries[:PAGE]]
                return SuspectsFetched(tuple(map(_handed, items)), ())
            case DiscardSuspects():
                check_order(packet.order, KnownScene.of(self.headers[packet.order.scene]))
                assert packet.order.holder == _member(address)
                gone = [item.location for item in packet.order.items if _held(kept[item.location]).version.digest == item.digest]
                for place in gone:
                    del kept[place]
                return SuspectsDiscarded(len(gone))
        return super()._answer(address, packet)


def _member(address: str) -> Member:
    return Member(node_id_of(address), address.encode().ljust(16))


def _held(item: PutItem) -> HeldRecord:
    header = RecordHeader.decode(item.header)
    version = RecordVersion(header.epoch, header.seq, header.writer, header.session, header.digest)
    return HeldRecord(item.scene, item.space, item.location, b"", version)


def _handed(item: PutItem) -> HandItem:
    return HandItem(item.scene, item.space, item.location, b"", item.signature, item.header, item.ciphertext)


@pytest.fixture
def nodes() -> ReturnedNodes:
    return ReturnedNodes()


@pytest.fixture
def studio(tmp_path: Path, nodes: ReturnedNodes) -> Studio:
    studio = Studio(tmp_path)
    studio.nodes = nodes
    return studio


async def returned(studio: Studio, nodes: ReturnedNodes) -> Scene:
    """At 0 and 1 nothing lies any more, at 2 something newer, at 3 a deletion; of 0 a second node keeps something older."""
    scene = await studio.scenes(1).create("kitchen")
    space = scene.space(GEOMETRY)
    await space.put(PLACES[0], b"oldest")
    nodes.keep(THERE, PLACES[0])
    for number in range(4):
        await space.put(PLACES[number], b"payload %d" % number)
        nodes.keep(HERE, PLACES[number])
    await space.put(PLACES[2], b"newer")
    await space.delete(PLACES[3])
    for number in (0, 1):
        del nodes.records[GEOMETRY, PLACES[number]]
    return scene


async def test_they_are_listed_as_what_they_are(autojump_clock: MockClock, studio: Studio, nodes: ReturnedNodes) -> None:
    scene = await returned(studio, nodes)
    report = await scene.strays()
    assert [(stray.location, stray.size, stray.is_replaced, stray.kept_by) for stray in report.listed] == [
        (PLACES[0], 9, False, (HERE, THERE)),
        (PLACES[1], 9, False, (HERE,)),
        (PLACES[2], 9, True, (HERE,)),
        (PLACES[3], 9, True, (HERE,)),
    ]
    assert (report.records, report.left, report.restored, report.discarded) == (4, 4, 0, 0)
    assert sum(map(len, nodes.apart.values())) == 5
    assert report.document()["strays"][0]["location"] == PLACES[0].hex()


async def test_what_is_restored_is_the_newest_and_goes_over_nothing(
    autojump_clock: MockClock, studio: Studio, nodes: ReturnedNodes
) -> None:
    scene = await returned(studio, nodes)
    report = await scene.strays(restore=True)
    assert (report.restored, report.discarded, report.left) == (2, 4, 0)
    assert not any(nodes.apart.values())
    fresh = await studio.kitchen(1)
    assert await fresh.space(GEOMETRY).get_many(PLACES[:4]) == [b"payload 0", b"payload 1", b"newer", None]
    assert (await scene.strays()).records == 0


async def test_what_is_discarded_is_written_nowhere(autojump_clock: MockClock, studio: Studio, nodes: ReturnedNodes) -> None:
    scene = await returned(studio, nodes)
    report = await scene.strays(discard=True)
    assert (report.restored, report.discarded, report.left) == (0, 4, 0)
    assert not any(nodes.apart.values())
    assert await (await studio.kitchen(1)).space(GEOMETRY).get_many(PLACES[:4]) == [None, None, b"newer", None]


async def test_a_deletion_that_was_kept_apart_is_not_undone(autojump_clock: MockClock, studio: Studio, nodes: ReturnedNodes) -> None:
    scene = await studio.scenes(1).create("kitchen")
    await scene.space(GEOMETRY).put(PLACES[0], b"a chair")
    await scene.space(GEOMETRY).delete(PLACES[0])
    nodes.keep(HERE, PLACES[0])
    del nodes.records[GEOMETRY, PLACES[0]]
    assert (await scene.strays()).listed[0].is_deletion
    report = await scene.strays(restore=True)
    assert (report.restored, report.discarded) == (0, 1)
    assert (GEOMETRY, PLACES[0]) not in nodes.records


async def test_what_no_writer_has_written_is_not_restored(autojump_clock: MockClock, studio: Studio, nodes: ReturnedNodes) -> None:
    scene = await returned(studio, nodes)
    forged = nodes.apart[HERE][PLACES[1]]
    nodes.apart[HERE][PLACES[1]] = replace(forged, ciphertext=forged.ciphertext[:-1] + bytes([forged.ciphertext[-1] ^ 1]))
    report = await scene.strays(restore=True)
    assert (report.unreadable, report.restored, report.left) == (1, 1, 1)
    assert list(nodes.apart[HERE]) == [PLACES[1]], "somebody may still make something of it"
    assert (await scene.strays(discard=True)).left == 0


async def test_who_lists_without_an_end_is_heard_no_further(autojump_clock: MockClock, studio: Studio, nodes: ReturnedNodes) -> None:
    scene = await returned(studio, nodes)
    nodes.endless = HERE
    report = await scene.strays()
    assert (report.silent, report.records) == ([HERE], PAGE)


async def test_a_silent_node_is_told_and_a_reader_changes_nothing(autojump_clock: MockClock, studio: Studio, nodes: ReturnedNodes) -> None:
    scene = await returned(studio, nodes)
    await scene.grant(card_of(2), Role.READER)
    nodes.away.add("127.0.0.4")
    ada = await studio.kitchen(2)
    report = await ada.strays()
    assert (report.silent, report.records) == (["127.0.0.4"], 4)
    with pytest.raises(LocalFault, match="reading only"):
        await ada.strays(discard=True)
    assert sum(map(len, nodes.apart.values())) == 5
